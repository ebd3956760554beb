"""How fast a linear model is: how long its response takes to show, and how finely to sample it."""

from __future__ import annotations

import math

from workbench.linearisation.linear_model import LinearModel

_INTEGRATES = 1e-6
"""Size of a pole, as a share of the largest, below which its mode integrates."""


def horizon_of(linear: LinearModel) -> float:
    """Return two periods of the slowest oscillation, or three of the slowest lag, in s.

    A model of integrators alone has no time of its own; its horizon is 1 s.
    """
    fastest = max((abs(m.pole) for m in linear.modes), default=0.0)
    own = [m for m in linear.modes if abs(m.pole) > _INTEGRATES * fastest]
    oscillations = [m.frequency_hz for m in own if m.pole.imag]
    if oscillations:
        return 2.0 / min(oscillations)
    return 3.0 / min((abs(m.pole) for m in own), default=3.0)


def step_time(linear: LinearModel) -> float:
    """Return a round time, in s, in which a step shows: two horizons, up to 1, 2 or 5 times 10^n.

    A thousandth of it is a sample time that shows the response.
    """
    long = 2.0 * horizon_of(linear)
    decade = 10.0 ** math.floor(math.log10(long))
    return float(f"{next(n for n in (1, 2, 5, 10) if n * decade >= long) * decade:.1g}")
