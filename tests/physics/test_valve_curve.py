"""Valve curve: the manufacturer's points, distance of the two forms of the equations."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from tests.physics.numbers_of import on_symbols, slope_of
from workbench.model.regularisation import EXACT, REGULARISED, Expression, Form
from workbench.plants.arm.servovalve import LINEAR, OPENING_FRACTION, OPENING_V, opening

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


@FORMS
def test_signed_curve_has_a_gain_at_the_centre(form: Form) -> None:
    # The two halves add up: the signed curve passes the centre with the slope of its first line.
    assert slope_of(lambda v: _signed(v, form), 0.0) == pytest.approx(0.02)


@FORMS
def test_arrays_and_expressions_agree(form: Form) -> None:
    law, grid = partial(opening, form=form), np.linspace(-6, 6, 601)
    assert np.allclose(on_symbols(law, grid), law(grid), atol=1e-12)
