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
    """Return a round time, in s, in which a step shows: two horizons.

    A thousandth of it is a sample time that shows the response.
    """
    return rounded_up(2.0 * horizon_of(linear))


def rounded_up(long: float) -> float:
    """Return a time, in s, up to 1, 2 or 5 times 10^n."""
    decade = 10.0 ** math.floor(math.log10(long))
    return float(f"{next(n for n in (1, 2, 5, 10) if n * decade >= long) * decade:.1g}")
