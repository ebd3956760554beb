"""D(q) and phi(q): the printed switch and its correction, the need for the branch."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.physics.force_polynomials import (
    PHI_FLOOR,
    PHI_SWITCH,
    PHI_SWITCH_PRINTED,
    continuous_switch,
    phi,
    pressure_gain,
)


def jump(switch: float) -> float:
    """Step of phi across its switch, N."""
    step = 1e-12
    return float(phi(switch + step, switch=switch) - phi(switch - step, switch=switch))


def test_printed_phi_jumps_at_its_switch_and_the_corrected_one_does_not() -> None:
    # At 1.6 mm the polynomial is still 5.88 N above the floor: the tension jumps by -5.88 N as
    # the muscle lengthens, by as much upwards as it shortens.
    assert jump(PHI_SWITCH_PRINTED) == pytest.approx(5.88, abs=0.005)
    assert jump(PHI_SWITCH) == pytest.approx(0.0, abs=1e-6)


def test_switch_is_where_the_polynomial_meets_the_floor() -> None:
    assert 1e3 * continuous_switch() == pytest.approx(1.757, abs=5e-4)
    assert continuous_switch() == pytest.approx(PHI_SWITCH, rel=1e-12)


def test_switch_of_a_polynomial_that_starts_below_its_floor_is_zero() -> None:
    assert continuous_switch((-20.0, -1.0)) == 0.0
    assert continuous_switch((20.0, 1.0)) == 0.0


def test_phi_needs_its_branch() -> None:
    # Without the branch the muscle would push with 61.6 N at no pressure and no contraction.
    assert float(phi(0.0, switch=-1.0)) == pytest.approx(61.62)
    assert float(phi(0.0)) == PHI_FLOOR
    q = np.linspace(0.0, 33e-3, 3301)
    assert np.all(phi(q) <= PHI_FLOOR + 1e-9)


def test_gain_has_its_minimum_at_33_mm() -> None:
    q = np.linspace(0.0, 0.05, 50001)
    assert 1e3 * q[np.argmin(pressure_gain(q))] == pytest.approx(33.33, abs=0.01)
