"""Linear models as objects: names, selection, discretisation, modes."""

from __future__ import annotations

import math
import re

import control as ct
import numpy as np
import pytest

from workbench.linearisation import find_modes, linearise
from workbench.operating_point import operating_point
from workbench.plants.arm import arm

POINT = operating_point(arm(3.0), {"angle": math.radians(30), "mean_pressure": 3e5})
LINEAR = linearise(POINT, input="opening")


def test_system_carries_the_names() -> None:
    system = LINEAR.system
    assert isinstance(system, ct.StateSpace)
    assert system.input_labels == ["opening"]
    assert system.output_labels == ["angle", "pressure_1", "pressure_2", "load_cell"]
    assert system.state_labels[0] == "spool"


def test_discretisation_agrees_with_control() -> None:
    Ad, Bd, Cd, Dd = LINEAR.discretise(0.002)
    sampled = ct.c2d(LINEAR.system, 0.002, method="zoh")
    assert Ad == pytest.approx(sampled.A, rel=1e-9, abs=1e-9)
    assert Bd == pytest.approx(sampled.B, rel=1e-9, abs=1e-9)
    assert np.array_equal(Cd, LINEAR.C) and np.array_equal(Dd, LINEAR.D)


def test_response_agrees_with_control() -> None:
    time = 0.002 * np.arange(200)
    y = LINEAR.response(np.full(200, LINEAR.u0[0] + 0.01), 0.002)
    _, other = ct.step_response(LINEAR.system, time, input=0, output=0)
    assert y[:, 0] - LINEAR.y0[0] == pytest.approx(0.01 * np.ravel(other), rel=1e-6, abs=1e-12)


def test_selection_changes_the_order() -> None:
    swapped = LINEAR.select(outputs=("pressure_2", "angle"))
    assert np.array_equal(swapped.C, LINEAR.C[[2, 0]])
    assert swapped.y0.tolist() == LINEAR.y0[[2, 0]].tolist()


def test_modes_of_a_known_system() -> None:
    omega, zeta = 12.0, 0.1
    A = np.array([[0, 1, 0], [-(omega**2), -2 * zeta * omega, 0], [0, 0, -4.0]])
    slow, swing = find_modes(A, ("x", "v", "p"))
    assert slow.pole == pytest.approx(-4.0) and slow.main_states == ("p",)
    assert swing.frequency_hz == pytest.approx(omega / (2 * math.pi))
    assert swing.damping == pytest.approx(zeta)
    assert sum(swing.participation.values()) == pytest.approx(1.0)


def test_participation_does_not_depend_on_units() -> None:
    bar = np.diag([1, 1, 1e-5, 1, 1e-5, 1, 1, 1.0])
    other = find_modes(bar @ LINEAR.A @ np.linalg.inv(bar), LINEAR.state_names)
    for a, b in zip(LINEAR.modes, other, strict=True):
        assert a.share("angle") == pytest.approx(b.share("angle"), abs=1e-6)


def test_prints_modes_and_kinks() -> None:
    text = str(LINEAR)
    assert "Hz" in text and "kink in spool" in text and "over an oscillation" in text
    (kink,) = (line for line in text.splitlines() if "kink in spool" in line)
    assert re.search(r"slope of d pressure_1/dt by spool [\d.]+ bar/s per V below", kink)
