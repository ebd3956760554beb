"""Arm geometry: printed defects, stated lengths, moment arms, agreement with CasADi."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.physics.numbers_of import on_symbols
from workbench.errors import WorkbenchError
from workbench.plants.arm.geometry import TRAVEL, ArmGeometry

ARM = ArmGeometry()
PRINTED = ArmGeometry(printing="as_printed")
ANGLES = np.linspace(0.0, TRAVEL, 61)


def test_length_is_the_distance_of_two_points() -> None:
    # Independent route: coordinates of the anchor and of the end of the lever.
    for angle in ANGLES:
        anchor = np.array([-0.0444, 0.416])
        lever_end = 0.032 * np.array([np.cos(angle), np.sin(angle)])
        assert float(ARM.lengths(angle)[0]) == pytest.approx(np.linalg.norm(anchor - lever_end))


def test_printed_constant_holds_the_lever_where_its_square_belongs() -> None:
    alpha = np.pi / 2  # beta = 210 deg: sin = -1/2
    constant = float(PRINTED.lengths(alpha)[1]) ** 2 - 26624e-6 / 2
    assert 1e6 * constant == pytest.approx(175059, abs=0.5)
    corrected = float(ARM.lengths(0.0)[0]) ** 2 - 2841.6e-6
    assert 1e6 * corrected == pytest.approx(176051.36, abs=0.01)
    # with everything else right the printed constant shortens the muscle by more than a millimetre
    short = np.sqrt(175059 + 2841.6)
    assert short == pytest.approx(421.78, abs=0.01)


def test_printed_angles_never_reach_423_mm() -> None:
    lengths = 1e3 * np.concatenate(PRINTED.lengths(ANGLES))
    assert lengths.max() == pytest.approx(420.1, abs=0.1)
    assert lengths.min() == pytest.approx(393.5, abs=0.1)


@pytest.mark.parametrize("arm", [ARM, PRINTED], ids=["corrected", "as_printed"])
def test_muscle_1_contracts_and_muscle_2_stretches(arm: ArmGeometry) -> None:
    one, two = arm.contractions(ANGLES)
    assert np.all(np.diff(one) > 0)
    assert np.all(np.diff(two) < 0)
    assert np.allclose(one, two[::-1])


def test_contractions_at_the_stops() -> None:
    for angle, expected in ((0.0, (0.04, 30.04)), (TRAVEL, (30.04, 0.04))):
        assert [1e3 * float(q) for q in ARM.contractions(angle)] == pytest.approx(
            expected, abs=0.005
        )


@pytest.mark.parametrize("arm", [ARM, PRINTED], ids=["corrected", "as_printed"])
def test_moment_arms_are_the_derivatives_of_the_lengths(arm: ArmGeometry) -> None:
    def symbolic(theta: Any) -> list[Any]:
        lengths = arm.lengths(theta)
        slopes = [ca.jacobian(length, theta) for length in lengths]
        return [*lengths, *slopes, *arm.moment_arms(theta)]

    values = on_symbols(symbolic, ANGLES)
    assert np.allclose(values[:2], arm.lengths(ANGLES), rtol=1e-13)
    assert np.allclose(values[2:4], values[4:], rtol=1e-11)
    assert np.allclose(values[4:], arm.moment_arms(ANGLES), rtol=1e-13)


def test_unknown_printing_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="printing"):
        ArmGeometry(printing="corected")  # type: ignore[arg-type]
