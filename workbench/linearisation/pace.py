"""How fast a linear model is: how long its response takes to show, and how finely to sample it."""

from __future__ import annotations

import math

import numpy as np

from workbench.linearisation.linear_model import LinearModel
from workbench.model.sizes import horizon


def horizon_of(linear: LinearModel) -> float:
    """Return how long the response of a linear model takes to show, in s; see `horizon`."""
    return horizon(np.array([m.pole for m in linear.modes]))


def step_time(linear: LinearModel) -> float:
    """Return a round time, in s, in which a step shows: two horizons."""
    return rounded_up(2.0 * horizon_of(linear))


GROWN = 0.05
"""Most by which a mode may grow in a sample of a loop that shall hold it, as the exponent of e."""


def usual_sample_time(linear: LinearModel) -> float:
    """Return a sample time, in s, that shows the response: a thousandth of `step_time`.

    It is less where a mode of a plant that is unstable would grow too far in it.
    """
    growing = float(np.max(linear.poles.real, initial=0.0))
    shown = step_time(linear) / 1000.0
    # What grows by less within the whole step integrates.
    if growing * shown <= GROWN:
        return shown
    return rounded_up(0.4 * GROWN / growing)


def rounded_up(long: float) -> float:
    """Return a time, in s, up to 1, 2 or 5 times 10^n."""
    decade = 10.0 ** math.floor(math.log10(long))
    return float(f"{next(n for n in (1, 2, 5, 10) if n * decade >= long) * decade:.1g}")
