"""The free-form effect: natural splines against an independent implementation, and absence."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from workbench.errors import WorkbenchError
from workbench.physics.nonparametric_term import Curve, nonparametric_term
from workbench.plants.servo_axis import servo_axis

KNOTS = (-1.0, -0.3, 0.0, 0.2, 1.5)
ORDINATES = np.array([2.0, -1.0, 0.5, 0.7, -3.0])


def test_the_curve_is_the_natural_cubic_spline() -> None:
    curve = Curve("speed", "m/s", KNOTS)
    x = np.linspace(-1.0, 1.5, 101)
    expected = CubicSpline(KNOTS, ORDINATES, bc_type="natural")(x)
    # Sums of cubes lose some digits against a local form.
    assert np.allclose(curve.functions(x) @ ORDINATES, expected, atol=1e-9)


def test_symbols_and_numbers_give_the_same() -> None:
    curve = Curve("speed", "m/s", KNOTS, (0.1, 0.2, 0.3, 0.2, 0.2))
    x = ca.SX.sym("x")
    function = ca.Function("curve", [x], [curve.value(x, ORDINATES.tolist())])
    points = np.array([-3.0, -1.05, -0.2, 0.9, 1.6, 4.0])
    numbers = curve.functions(points) @ ORDINATES
    assert np.allclose([float(function(p)) for p in points], numbers, atol=1e-9)


def test_beyond_the_knots_straight_then_constant() -> None:
    curve = Curve("speed", "m/s", KNOTS)
    y = curve.functions(np.array([1.5, 1.6, 1.7, 1.75, 2.0, 9.0])) @ ORDINATES
    assert y[1] - y[0] == pytest.approx(y[2] - y[1], abs=1e-9)
    assert y[3] == pytest.approx(y[5], abs=1e-9) and y[4] == pytest.approx(y[5], abs=1e-9)


def test_zero_ordinates_change_nothing() -> None:
    axis = servo_axis()
    with_it = axis.with_effect(
        nonparametric_term("axis.force", (Curve("speed", "m/s", KNOTS),), unit="N")
    )
    assert np.allclose(with_it.rates([0.1, 0.3], [50.0]), axis.rates([0.1, 0.3], [50.0]))


def test_a_relative_curve_is_a_fraction_of_the_signal() -> None:
    bare = servo_axis().without("viscous_friction", "coulomb_friction")
    flat = {f"speed_{i}": 0.5 for i in (1, 2, 3)}
    curve = Curve("speed", "m/s", (-1.0, 0.0, 1.0))
    more = bare.with_effect(
        nonparametric_term("axis.force", (curve,), unit="N", relative=True, ordinates=flat)
    )
    assert more.rates([0.0, 0.2], [40.0])[1] == pytest.approx(
        1.5 * bare.rates([0.0, 0.2], [40.0])[1]
    )


def test_a_loop_tends_to_the_sign_of_the_rate() -> None:
    curve = Curve("position", "m", (-1.0, 0.0, 1.0))
    axis = servo_axis().with_effect(
        nonparametric_term("axis.force", (curve,), unit="N", loop=("speed", "m", 0.01))
    )
    place = [q.name for q in axis.states].index("nonparametric.memory_1")
    for memory, speed, rate in ((0.0, 0.1, 10.0), (1.0, 0.1, 0.0), (-1.0, -0.1, 0.0)):
        state = [0.0, speed, memory]
        assert axis.rates(state, [0.0])[place] == pytest.approx(rate, abs=1e-9)


def test_too_few_knots_and_double_arguments_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="at least 3"):
        Curve("speed", "m/s", (0.0, 1.0))
    curve = Curve("speed", "m/s", KNOTS)
    with pytest.raises(WorkbenchError, match="two curves"):
        nonparametric_term("axis.force", (curve, curve), unit="N")
