"""Replacing the gas volume of the muscles by a constant or by the printed one."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.plants.arm import arm
from workbench.plants.arm.laws import constant_volume, printed_volume


def volumes(model: Model) -> np.ndarray:
    rows = []
    for angle in (0.0, 0.5, 1.0):
        signals = model.signals(model.initial_state({"angle": angle}), [5.0])
        rows.append([signals[f"chamber_{k}.volume"] for k in (1, 2)])
    return np.array(rows)


def test_constant_volume_is_constant_and_does_no_work() -> None:
    model = arm(3.0).with_effect(constant_volume().with_parameters({"volume": 8e-5}))
    assert volumes(model) == pytest.approx(8e-5 + 1.5e-5)  # and the dead volume
    moving = model.initial_state({"speed": 3.0})
    resting = model.initial_state({"speed": 0.0})
    assert model.rates(moving, [5.0])[2:6] == pytest.approx(model.rates(resting, [5.0])[2:6])


def test_constant_volume_lies_between_those_of_the_travel() -> None:
    nominal, constant = volumes(arm(3.0)), volumes(arm(3.0).with_effect(constant_volume()))
    assert nominal.min() < constant[0, 0] < nominal.max()


def test_printed_volume_is_that_of_the_printed_variant() -> None:
    # At the 170 mm of a contracted muscle the paper's lines give 352 cm3 instead of 118.
    model = arm(3.0).with_effect(printed_volume())
    contracted = model.signals(model.initial_state({"angle": 0.0}), [5.0])
    assert contracted["muscle_2.contraction"] == pytest.approx(0.03004, abs=1e-5)
    assert contracted["muscle_2.volume"] == pytest.approx(352e-6, abs=2e-6)


def test_a_volume_of_nothing_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="volume is 0 m3"):
        constant_volume().with_parameters({"volume": 0.0})
