"""The mean pressure behind one 5/3 valve: predicted along a motion, and bounded over a box.

One 5/3 valve commands the difference of two pressures. Their mean is nobody's choice: it follows
from the motion. With the angle prescribed, the torques that move the arm prescribe the difference,
the opening must produce it, and what the two chambers then draw and give off moves the mean:

    J(theta) ddtheta/dt = torque(p_1, p_2, theta, dtheta/dt)    decides the opening
    d(p_1 + p_2)/dt                                             follows from the opening

The prediction steps the plant's own gas equations (and the states of its effects) along the motion,
with the opening found by Newton's method so that the equation of motion holds at the end of each
step. No controller takes part: any controller that makes the arm follow the motion moves the mean
like this. The bounds are the extremes over the corners of a box of parameters, such as leakage and
supply pressure.

Source: Ascher and Petzold, Computer Methods for Ordinary Differential Equations and
Differential-Algebraic Equations, 1998, chapter 9 (prescribed motion as an algebraic equation).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.errors import NumericalError, WorkbenchError, check_choice, check_finite
from workbench.linearisation.opening import FULL_STROKE, opening_plant
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.simulation.compiled import compiled

Vector = npt.NDArray[np.float64]

PRESCRIBED = ("angle", "speed", "spool", "spool_speed")
"""States that the motion and the opening prescribe."""

_NEWTON_STEPS = 30
_CORNERS = 256


@dataclass(frozen=True)
class MeanPressure:
    """Mean pressure along a motion.

    Args:
        time: Times, shape (n,), in s.
        angle: Angles, shape (n,), in rad.
        mean: Mean of both gauge pressures, shape (n,), in Pa.
        difference: Difference of the pressures, shape (n,), in Pa.
        opening: Signed opening of the valve, a fraction, shape (n,); the last is repeated.
        within_reach: Whether the valve was never asked for more than its full opening.

    Example:
        >>> "mean" in MeanPressure.__dataclass_fields__
        True
    """

    time: Vector
    angle: Vector
    mean: Vector
    difference: Vector
    opening: Vector
    within_reach: bool

    def __str__(self) -> str:
        """Return one line."""
        reach = "" if self.within_reach else ", beyond the full opening of the valve"
        return (
            f"mean pressure {self.mean[0] / 1e5:.3f} bar at the start, {self.mean.min() / 1e5:.3f}"
            f" to {self.mean.max() / 1e5:.3f} bar on the way, {self.mean[-1] / 1e5:.3f} bar at the"
            f" end{reach}"
        )


@dataclass(frozen=True)
class MeanPressureBounds:
    """Bounds of the mean pressure along a motion, over a box of parameters.

    Args:
        nominal: Prediction for the nominal plant.
        lowest: Lowest mean over the corners of the box, shape (n,), in Pa gauge.
        highest: Highest mean, shape (n,), in Pa gauge.
        corners: Number of corners, the nominal plant included.

    Example:
        >>> "lowest" in MeanPressureBounds.__dataclass_fields__
        True
    """

    nominal: MeanPressure
    lowest: Vector
    highest: Vector
    corners: int

    def __str__(self) -> str:
        """Return two lines."""
        return (
            f"{self.nominal}\n  over {self.corners} plants {self.lowest.min() / 1e5:.3f} to"
            f" {self.highest.max() / 1e5:.3f} bar"
        )


def mean_pressure(
    model: Model,
    time: npt.ArrayLike,
    angle: npt.ArrayLike,
    *,
    start: float | None = None,
) -> MeanPressure:
    """Predict the mean pressure while the arm follows a motion.

    Args:
        model: The arm with one 5/3 valve.
        time: Times, shape (n,), in s, evenly spaced and fine enough for the motion (2 ms).
        angle: Angles of the motion, shape (n,), in rad, twice differentiable.
        start: Mean gauge pressure at the start, in Pa; that of the equilibrium by default.

    Returns:
        The prediction.

    Raises:
        WorkbenchError: If the arrays do not fit or the model is no such arm.
        NumericalError: If no pressures make the arm follow the motion.

    Source:
        Ascher and Petzold 1998, chapter 9.

    Example:
        >>> from workbench.plants.arm import arm
        >>> t = 0.002 * np.arange(500)
        >>> resting = mean_pressure(arm(3), t, np.full(500, 0.5236))
        >>> bool(np.ptp(resting.mean) < 2e3)
        True
    """
    t, theta = check_finite("time", time).ravel(), check_finite("angle", angle).ravel()
    if t.shape != theta.shape or t.size < 10:
        raise WorkbenchError(
            f"there are {t.size} times and {theta.size} angles; give as many, ten or more"
        )
    h = float(t[1] - t[0])
    if h <= 0 or np.abs(np.diff(t) - h).max() > 1e-6 * h + 1e-12:
        raise WorkbenchError("the times are not evenly spaced and increasing; resample the motion")
    names = [q.name for q in model.states]
    for name in (*PRESCRIBED, "pressure_1", "pressure_2"):
        check_choice("state of the plant", name, names)
    speed = np.gradient(theta, h, edge_order=2)
    acceleration = np.gradient(speed, h, edge_order=2)
    point = operating_point(model, {"angle": float(theta[0])}, mean_pressure=start)
    free = [i for i, name in enumerate(names) if name not in PRESCRIBED]
    step = compiled(_step(model, h, free))
    size = np.array([model.states[i].scale for i in free])
    gas, values = point.x[free] / size, model.values
    kept, openings, reached = [gas], [], True
    opening = 0.0
    for k in range(t.size - 1):
        motion = [theta[k], speed[k], theta[k + 1], speed[k + 1]]
        gas, opening, inside = _advance(step, gas, opening, motion, acceleration[k + 1], values)
        reached = reached and inside
        kept.append(gas)
        openings.append(opening)
    if not np.isfinite(kept[-1]).all():
        raise NumericalError(
            "the pressures that the motion asks for are not finite; give a slower motion"
        )
    course = np.array(kept) * size
    order = [names[i] for i in free]
    one, two = (course[:, order.index(f"pressure_{i}")] for i in (1, 2))
    ambient = model.parameter("ambient_pressure").value
    return MeanPressure(
        t,
        theta,
        0.5 * (one + two) - ambient,
        one - two,
        np.array([*openings, openings[-1]]),
        reached,
    )


def mean_pressure_bounds(
    model: Model,
    time: npt.ArrayLike,
    angle: npt.ArrayLike,
    box: Mapping[str, tuple[float, float]],
    *,
    start: float | None = None,
) -> MeanPressureBounds:
    """Bound the mean pressure along a motion over a box of parameters.

    Args:
        model: The arm with one 5/3 valve.
        time: Times, shape (n,), in s, evenly spaced.
        angle: Angles of the motion, shape (n,), in rad, twice differentiable.
        box: Lowest and highest value of some parameters, by name, in SI.
        start: Mean gauge pressure at the start, in Pa; that of each plant's equilibrium by default.

    Returns:
        The prediction for the nominal plant and the extremes over the corners of the box.

    Raises:
        WorkbenchError: If the box has more than eight parameters, or as `mean_pressure` does.

    Source:
        Extremes at the corners: the mean depends monotonically on each of leakage, supply pressure
        and conductance.

    Example:
        >>> from workbench.plants.arm import arm
        >>> t = 0.002 * np.arange(250)
        >>> found = mean_pressure_bounds(
        ...     arm(3), t, np.full(250, 0.5236), {"supply_pressure": (5e5, 6e5)}
        ... )
        >>> found.corners, bool(found.lowest[0] < 0.9 * found.highest[0])
        (3, True)
    """
    if 2 ** len(box) > _CORNERS:
        raise WorkbenchError(
            f"the box has {len(box)} parameters and so {2 ** len(box)} corners; give at most eight"
        )
    nominal = mean_pressure(model, time, angle, start=start)
    means = [nominal.mean]
    if box:
        for corner in product(*box.values()):
            varied = model.with_parameters(dict(zip(box, corner, strict=True)))
            means.append(mean_pressure(varied, time, angle, start=start).mean)
    table = np.array(means)
    return MeanPressureBounds(nominal, table.min(axis=0), table.max(axis=0), len(means))


def _step(model: Model, h: float, free: list[int]) -> ca.Function:
    """Build (gas, opening, motion, p) -> gas a step later, acceleration there, its derivative."""
    proportional = opening_plant(model)
    # Exact: rounded corners at the shut valve would look like more leakage.
    traced = proportional.exact
    names = [q.name for q in model.states]
    size = np.array([model.states[i].scale for i in free])
    z, o = ca.SX.sym("z", len(free)), ca.SX.sym("o")
    angle, speed = ca.SX.sym("angle"), ca.SX.sym("speed")
    prescribed = {
        "angle": angle,
        "speed": speed,
        "spool": FULL_STROKE * o,
        "spool_speed": ca.SX(0.0),
    }
    x = [
        z[free.index(i)] * size[free.index(i)] if i in free else prescribed[name]
        for i, name in enumerate(names)
    ]
    nominal = float(model.nominal_input[0])
    rates = ca.substitute(
        traced.rates, ca.vertcat(traced.x, traced.u), ca.vertcat(*x, nominal + FULL_STROKE * o)
    )
    slow = ca.Function("gas_rates", [z, o, angle, speed, traced.p], [rates[free] / size])
    moving = rates[names.index("speed")]
    motion_rate = ca.Function("acceleration", [z, o, angle, speed, traced.p], [moving])
    motion = ca.SX.sym("motion", 4)
    middle = (
        0.5 * (motion[0] + motion[2]) + h / 8 * (motion[1] - motion[3]),
        0.5 * (motion[1] + motion[3]),
    )
    p = traced.p
    k1 = slow(z, o, motion[0], motion[1], p)
    k2 = slow(z + 0.5 * h * k1, o, *middle, p)
    k3 = slow(z + 0.5 * h * k2, o, *middle, p)
    k4 = slow(z + h * k3, o, motion[2], motion[3], p)
    end = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    found = motion_rate(end, o, motion[2], motion[3], p)
    return ca.Function(
        "motion_step", [z, o, motion, p], ca.cse([end, found, ca.jacobian(found, o)])
    )


def _advance(
    step: ca.Function,
    gas: Vector,
    opening: float,
    motion: list[float],
    acceleration: float,
    values: Vector,
) -> tuple[Vector, float, bool]:
    """Find the opening that gives the acceleration at the end of a step."""
    low, high = -1.0, 1.0
    for _ in range(_NEWTON_STEPS):
        end, found, slope = step(gas, opening, motion, values)
        miss = float(found) - acceleration
        if miss > 0:
            high = min(high, opening)
        else:
            low = max(low, opening)
        if high - low < 1e-9:
            break
        change = -miss / float(slope) if float(slope) > 0 else np.inf * -miss
        after = opening + change
        # A step of Newton's that leaves the bracket is replaced by halving it.
        if not low < after < high:
            after = low if after <= low == -1.0 else high if after >= high == 1.0 else after
            if not low <= after <= high or after == opening:
                after = 0.5 * (low + high)
        if abs(after - opening) < 1e-7:
            break
        opening = after
    return np.asarray(end).ravel(), opening, bool(abs(opening) < 1.0 - 1e-6)
