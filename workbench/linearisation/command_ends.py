"""Where commands end that a plant's own equations limit and whose author declares no end."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.model import Model
from workbench.operating_point import OperatingPoint

FLAT = 1e-9
"""Largest slope, over that at rest, of what answers a command no more, a ratio."""

SOME = 0.1
"""Part of their scales by which states are moved to see whether an end moves with them."""

FAR = 30
"""Octaves of a command's scale beyond rest within which its end is looked for."""


def with_command_ends(point: OperatingPoint, at: Callable[..., tuple[Vector, Vector]]) -> Model:
    """Return the model, each command ending where all slopes by it vanish, whatever the states.

    Equations that clip a command have none beyond: a controller that is told of no end winds up
    there. One whose ends move with a state, as of an error that is clipped, keeps none.

    Args:
        at: Returns rates with measurements, and their slopes by states and inputs, called with
            states, inputs and parameters.
    """
    model = point.model
    found = list(model.inputs)
    for k, q in enumerate(model.inputs):
        ends: dict[str, Any] = {
            name: end
            for name, sign in (("lower", -1.0), ("upper", 1.0))
            if q.commanded
            and not math.isfinite(getattr(q, name))
            and (end := _end(point, at, k, sign * (q.scale or 1.0))) is not None
        }
        found[k] = replace(q, **ends) if ends else q
    if found == list(model.inputs):
        return model
    ended = copy.copy(model)
    object.__setattr__(ended, "inputs", tuple(found))
    return ended


def _end(
    point: OperatingPoint, at: Callable[..., tuple[Vector, Vector]], k: int, size: float
) -> float | None:
    """Return the value of an input from which on nothing answers it, in its unit; None for none."""
    model, far = point.model, size * 2.0 ** np.arange(-FAR, FAR + 1)
    scales = np.array([q.scale for q in model.states])

    def slope(x: Vector, moved: float) -> float:
        inputs = point.u + np.where(np.arange(len(point.u)) == k, moved, 0.0)
        return float(np.abs(at(x, inputs, model.values)[1][:, len(x) + k]).max())

    ends = []
    for x in (point.x, point.x + SOME * scales, point.x - SOME * scales):
        # What is no number is no end.
        if not slope(x, far[-1]) <= FLAT * slope(x, 0.0):
            return None
        slopes = np.array([slope(x, moved) for moved in (0.0, *far)])
        flat = FLAT * np.nanmax(slopes)
        answers = ~(slopes <= flat)
        if not answers.any():
            return None
        last = int(np.flatnonzero(answers)[-1])
        low, high = (0.0, *far)[last], far[last]
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if slope(x, middle) <= flat else (middle, high)
        ends.append(float(point.u[k]) + high)
    alike = np.ptp(ends) <= 1e-6 * abs(ends[0] - point.u[k])
    return size * round(ends[0] / size, 12) if alike else None
