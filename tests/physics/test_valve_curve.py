"""Valve curve: the manufacturer's points, distance of the two forms of the equations."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from workbench.model.regularisation import EXACT, REGULARISED, Expression, Form
from workbench.physics.valve_curve import LINEAR, OPENING_FRACTION, OPENING_V, opening

FORMS = pytest.mark.parametrize("form", [EXACT, REGULARISED], ids=["exact", "regularised"])


def test_curve_is_interpolated_by_straight_lines() -> None:
    # independent route: NumPy's interpolation
    v = np.linspace(-2.0, 7.0, 2001)
    expected = np.interp(v, OPENING_V, OPENING_FRACTION)
    assert np.allclose(opening(v), expected, atol=1e-14)
    assert float(opening(5.0)) == pytest.approx(1.0)
    assert float(opening(12.0)) == pytest.approx(1.0)
    assert len(OPENING_V) == len(OPENING_FRACTION) == 22


def test_local_gain_spans_fifteen_to_one() -> None:
    gain = np.diff(OPENING_FRACTION) / np.diff(OPENING_V)
    below_two = np.array(OPENING_V[:-1]) < 2.0
    assert gain[below_two].max() / gain[0] == pytest.approx(17.5)
    assert gain[below_two].max() / gain[1] == pytest.approx(11.7, abs=0.05)


def test_linear_valve() -> None:
    v = np.linspace(-6, 6, 121)
    assert np.allclose(opening(v, curve=LINEAR), np.clip(v / 5, 0, 1))


@FORMS
def test_curve_is_monotone(form: Form) -> None:
    f = np.asarray(opening(np.linspace(-5, 5, 10001), form=form))
    assert np.all(np.diff(f) > -1e-15)


def test_distance_of_the_forms() -> None:
    v = np.linspace(-0.2, 6.0, 62001)
    difference = np.abs(opening(v, form=REGULARISED) - opening(v))
    near = np.min(np.abs(v[:, None] - np.array(OPENING_V)), axis=1) < 0.04 + 1e-9
    assert difference[~near].max() < 1e-12
    # 3/16 of the half-width times the change of slope, at most 0.3 per volt below 4.5 V
    assert difference.max() < 3 / 16 * 0.04 * 0.31


def _signed(v: Expression, form: Form) -> Expression:
    """Opening with the sign of the voltage."""
    return opening(v, form=form) - opening(-v, form=form)


def test_smooth_curve_has_a_gain_at_the_centre() -> None:
    # The two halves add up: the signed curve passes the centre with the slope of its first line.
    v = ca.SX.sym("v")
    slope = ca.Function("s", [v], [ca.jacobian(_signed(v, REGULARISED), v)])
    assert float(slope(0.0)) == pytest.approx(0.02)
    exact = ca.Function("s", [v], [ca.jacobian(_signed(v, EXACT), v)])
    assert float(exact(0.0)) == pytest.approx(0.02)


@FORMS
def test_arrays_and_expressions_agree(form: Form) -> None:
    x = ca.SX.sym("x")
    grid = np.linspace(-6, 6, 601)
    function = ca.Function("f", [x], [opening(x, form=form)])
    symbolic = np.array(function(grid[None, :])).ravel()
    assert np.allclose(symbolic, opening(grid, form=form), atol=1e-12)
