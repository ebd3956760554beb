"""For which value of one number a cost is least: in steps, between them, where it jumps.

Units: values, bounds and steps are in that of the number; costs are minus a log likelihood,
dimensionless.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize_scalar

from workbench.model import Parameter

STEP, _STEPS = 3.0, 6
"""Factor between values that are tried as long as the cost falls, and how many: the usual size of
an effect may be wrong by a hundred."""

_STRIDES = 5
"""Lengths of a stride that are tried where a search walks, each twice the one before."""

_FINE, _FINEST = 0.02, 8
"""Logarithm within which what was found in steps is searched between them, and in how many runs."""

_SCANNED, _SCANS = 13, 3
"""Values that are tried between steps where the cost jumps, ever closer, and how often."""

Cost = Callable[[float], float]


def stepped(cost: Cost, here: float, q: Parameter, least: float, step: float = STEP) -> float:
    """Go on from a value in steps, up or down within the bounds of q, as long as that gains."""
    for factor in (step, 1.0 / step):
        moved = False
        for _ in range(_STEPS):
            value = float(np.clip(factor * here, q.lower, q.upper))
            now = cost(value) if value != here else math.inf
            if not now < least:
                break
            least, here, moved = now, value, True
        if moved:
            break
    return here


def walked(cost: Cost, here: float, q: Parameter, step: float) -> float:
    """Go on from a value by steps and their doubles, within the bounds of q, as long as that gains.

    A cost that falls far away may rise, or waver, at the first step.

    Args:
        step: In the unit of the number.
    """

    @functools.cache
    def after(steps: int) -> float:
        value = here + steps * step
        return cost(value) if q.lower <= value <= q.upper else math.inf

    gone, strides = 0, [to * 2**k for k in range(_STRIDES) for to in (1, -1)]
    while after(nearer := min((gone + n for n in strides), key=after)) < after(gone):
        gone = nearer
    return here + gone * step


def between(cost: Cost, here: float, q: Parameter, enough: float) -> float:
    """Return the best value within a step of one, if it promises to gain enough."""
    for step in (STEP, math.sqrt(STEP)):
        points = [
            float(np.clip(v, q.lower, q.upper)) for v in (1.0 / step * here, here, step * here)
        ]
        costs = [cost(v) for v in points]
        apart = (1.0 + _FINE) * points[0] < here < points[2] / (1.0 + _FINE)
        if apart and all(map(math.isfinite, costs)):
            break
    else:
        return here
    x = np.log(points)
    # A parabola a x^2 + b x gains b^2 / (4 a) at its lowest point.
    curvature, slope, _ = np.polyfit(x - x[1], costs, 2)
    if curvature <= 0.0 or slope**2 < 4.0 * curvature * enough:
        return here
    place, least = least_between(lambda v: cost(math.exp(v)), x[0], x[2], _FINEST, _FINE)
    return math.exp(place) if least < costs[1] else here


def scanned(cost: Cost, here: float, q: Parameter) -> float:
    """Return the best value within a step of one, of a cost that jumps from value to value."""
    reach = math.log(STEP)
    for _ in range(_SCANS):
        points = here * np.exp(np.linspace(-reach, reach, _SCANNED))
        here = min((float(np.clip(v, q.lower, q.upper)) for v in points), key=cost)
        reach /= 0.5 * (_SCANNED - 1)
    return here


def least_between(
    cost: Cost, low: float, high: float, steps: int, within: float = 1e-5
) -> tuple[float, float]:
    """Return where a cost is least within bounds, and its value there.

    Where it is infinite, a parabola through three of its values is none.

    Args:
        steps: How often it is called at most.
        within: How close to the least value is close enough.
    """
    options = {"maxiter": steps, "xatol": within}
    with np.errstate(invalid="ignore"):
        found = minimize_scalar(cost, bounds=(low, high), method="bounded", options=options)
    return float(found.x), float(found.fun)
