"""Where equations no longer answer an input, as those that clip it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from workbench.arrays import Vector

_LITTLE = 0.05
"""Part of the steepest slope, and of all of an answer, that is left where it has ended: tanh ends
at 2.2, what a clip bounds at the clip, and a root or a logarithm nowhere."""

_FAR = 30
"""Octaves of an input's size beyond rest within which its end is looked for."""


def input_end(answer: Callable[[float], tuple[Vector, Vector]], size: float) -> float:
    """Return the change of an input, in SI, from which on nothing answers it; infinite for none.

    Args:
        answer: Returns values and their slopes by the input, each of any shape, after a change of
            it, in SI.
        size: Size of the input, in SI; its sign tells to which side.
    """
    tried = size * np.append(0.0, 2.0 ** np.arange(-_FAR, _FAR + 1))
    values, slopes = (np.stack(part) for part in zip(*map(answer, tried), strict=True))
    steep = np.abs(slopes).max(axis=1, initial=0.0)
    # What is no number is beyond all that has a meaning.
    known = np.logical_and.accumulate(np.isfinite(values).all(axis=1) & np.isfinite(steep))
    values, steep = values[known], steep[known]
    flat = _LITTLE * steep.max(initial=0.0)
    if not flat or steep[-1] > flat:
        return math.inf
    last = int(np.flatnonzero(steep > flat)[-1])
    low, high = tried[last], tried[last + 1]
    for _ in range(50):
        middle = 0.5 * (low + high)
        flat_there = float(np.abs(answer(middle)[1]).max()) <= flat
        low, high = (low, middle) if flat_there else (middle, high)
    left, whole = np.abs(answer(high)[0] - values[-1]), np.abs(values[0] - values[-1])
    if np.any((left > _LITTLE * whole) & np.any(slopes[known] != 0.0, axis=0)):
        return math.inf
    return float(size * round(high / size, 12))
