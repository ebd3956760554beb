"""Valve curve: the manufacturer's points, the four edges, the inverse, distance of the faces."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from workbench.model.face import EXACT, SMOOTH, Face
from workbench.physics.valve_curve import (
    LINEAR,
    MPYE,
    OPENING_FRACTION,
    OPENING_V,
    edge_openings,
    inverse_opening,
    opening,
    signed_opening,
)

FACES = pytest.mark.parametrize("face", [EXACT, SMOOTH], ids=["exact", "smooth"])


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


def test_positive_spool_fills_1_and_vents_2() -> None:
    supply_1, exhaust_1, supply_2, exhaust_2 = edge_openings(0.9, 0.004)
    assert float(supply_1) == pytest.approx(0.06)
    assert float(exhaust_2) == pytest.approx(0.06)
    assert float(exhaust_1) == float(supply_2) == pytest.approx(0.004)


def test_negative_spool_is_the_mirror_image() -> None:
    plus, minus = edge_openings(1.3), edge_openings(-1.3)
    assert np.allclose(plus, [minus[2], minus[3], minus[0], minus[1]])
    assert np.allclose(plus, [minus[1], minus[0], minus[3], minus[2]])


def test_every_edge_leaks_at_the_centre() -> None:
    assert np.allclose(edge_openings(0.0, 0.014), 0.014)
    assert np.allclose(edge_openings(0.0, 0.0), 0.0)


def test_linear_valve() -> None:
    v = np.linspace(-6, 6, 121)
    assert np.allclose(signed_opening(v, curve=LINEAR), np.clip(v / 5, -1, 1))
    assert np.allclose(inverse_opening(v / 5, curve=LINEAR), np.clip(v, -5, 5))


@pytest.mark.parametrize("curve", [MPYE, LINEAR], ids=["mpye", "linear"])
def test_inverse_undoes_the_curve_both_ways(curve: object) -> None:
    v = np.linspace(-5, 5, 1001)
    assert np.allclose(inverse_opening(signed_opening(v, curve=curve), curve=curve), v, atol=1e-10)  # type: ignore[arg-type]
    f = np.linspace(-1, 1, 1001)
    assert np.allclose(signed_opening(inverse_opening(f, curve=curve), curve=curve), f, atol=1e-12)  # type: ignore[arg-type]


@FACES
def test_inverse_is_monotone_odd_and_bounded(face: Face) -> None:
    f = np.linspace(-1.2, 1.2, 24001)
    v = np.asarray(inverse_opening(f, face=face))
    inside = np.abs(f) < 0.999
    assert np.all(np.diff(v[inside]) > 0)
    assert np.allclose(v, -v[::-1], atol=1e-12)
    # the smooth face adds the rounded corners of both halves at zero, none at the ends
    assert np.max(np.abs(v)) == pytest.approx(5.0, abs=1e-9)


@FACES
def test_signed_opening_is_monotone_and_odd(face: Face) -> None:
    v = np.linspace(-5, 5, 10001)
    f = np.asarray(signed_opening(v, face=face))
    assert np.all(np.diff(f) > -1e-15)
    assert np.allclose(f, -f[::-1], atol=1e-13)
    assert float(signed_opening(0.0, face=face)) == 0.0


def test_distance_of_the_faces() -> None:
    v = np.linspace(-0.2, 6.0, 62001)
    difference = np.abs(opening(v, face=SMOOTH) - opening(v))
    near = np.min(np.abs(v[:, None] - np.array(OPENING_V)), axis=1) < 0.04 + 1e-9
    assert difference[~near].max() < 1e-12
    # 3/16 of the half-width times the change of slope, at most 0.3 per volt below 4.5 V
    assert difference.max() < 3 / 16 * 0.04 * 0.31
    f = np.linspace(-1, 1, 20001)
    volts = np.abs(inverse_opening(f, face=SMOOTH) - inverse_opening(f))
    assert volts.max() < 0.004


def test_smooth_curve_has_a_gain_at_the_centre() -> None:
    # The two halves add up: the signed curve passes the centre with the slope of its first line.
    v = ca.SX.sym("v")
    slope = ca.Function("s", [v], [ca.jacobian(signed_opening(v, face=SMOOTH), v)])
    assert float(slope(0.0)) == pytest.approx(0.02)
    exact = ca.Function("s", [v], [ca.jacobian(signed_opening(v), v)])
    assert float(exact(0.0)) == pytest.approx(0.02)


@FACES
def test_arrays_and_expressions_agree(face: Face) -> None:
    x = ca.SX.sym("x")
    grid = np.linspace(-6, 6, 601)
    for law in (opening, signed_opening, inverse_opening):
        function = ca.Function("f", [x], [law(x, face=face)])
        argument = grid if law is not inverse_opening else grid / 5
        symbolic = np.array(function(argument[None, :])).ravel()
        assert np.allclose(symbolic, law(argument, face=face), atol=1e-12)
    function = ca.Function("f", [x], list(edge_openings(x, face=face)))
    for one, two in zip(function(grid[None, :]), edge_openings(grid, face=face), strict=True):
        assert np.allclose(np.array(one).ravel(), two, atol=1e-13)
