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

SOME = (0.1, 1e-3, 1e-5)
"""Parts of its scale by which a state is moved to see whether an end moves with it; the first that
leaves the command between its ends."""

STILL = 1e-6
"""Within this of where it was at rest, an end has not moved with a state, a ratio."""

FAR = 30
"""Octaves of a command's scale beyond rest within which its end is looked for."""


def with_command_ends(
    point: OperatingPoint, at: Callable[..., tuple[Vector, Vector]]
) -> tuple[Model, Vector | None]:
    """Return the model, each command ending where all slopes by it vanish, whatever the states.

    Equations that clip a command have none beyond: a controller that is told of no end winds up
    there. Ends that move with a state, as of an error that is clipped, are told by themselves.

    Args:
        at: Returns rates with measurements, and their slopes by states and inputs, called with
            states, inputs and parameters.

    Returns:
        The model, and the ends that move, as of `workbench.linearisation.LinearModel.ends`.
    """
    model = point.model
    found = list(model.inputs)
    moving = np.zeros((2, len(found), 1 + len(point.x)))
    moving[0, :, 0], moving[1, :, 0] = -math.inf, math.inf
    for k, q in enumerate(model.inputs):
        for side, (name, sign) in enumerate((("lower", -1.0), ("upper", 1.0))):
            if not q.commanded or math.isfinite(getattr(q, name)):
                continue
            end = _end(point, at, k, sign * (q.scale or 1.0))
            if end is None:
                continue
            if np.any(end[1:]):
                moving[side, k] = end
            else:
                changed: dict[str, Any] = {name: float(point.u[k] + end[0])}
                found[k] = replace(found[k], **changed)
    ends = moving if np.isfinite(moving[..., 0]).any() else None
    if found == list(model.inputs):
        return model, ends
    ended = copy.copy(model)
    object.__setattr__(ended, "inputs", tuple(found))
    return ended, ends


def _end(
    point: OperatingPoint, at: Callable[..., tuple[Vector, Vector]], k: int, size: float
) -> Vector | None:
    """Return from what change of an input on nothing answers it, with its slopes by states.

    Returns:
        Shape (1 + n_states,), in SI; None for none.
    """
    model, far = point.model, size * 2.0 ** np.arange(-FAR, FAR + 1)

    def slope(x: Vector, by: float) -> float:
        inputs = point.u + np.where(np.arange(len(point.u)) == k, by, 0.0)
        return float(np.abs(at(x, inputs, model.values)[1][:, len(x) + k]).max())

    def reached(x: Vector) -> float:
        # What is no number is no end.
        if not slope(x, far[-1]) <= FLAT * slope(x, 0.0):
            return math.nan
        slopes = np.array([slope(x, by) for by in (0.0, *far)])
        flat = FLAT * np.nanmax(slopes)
        answers = ~(slopes <= flat)
        if not answers.any():
            return math.nan
        last = int(np.flatnonzero(answers)[-1])
        low, high = (0.0, *far)[last], far[last]
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if slope(x, middle) <= flat else (middle, high)
        return float(high)

    def moved(x: Vector) -> float:
        before, beyond = (slope(x, share * end) for share in (1.0 - STILL, 1.0 + STILL))
        return 0.0 if beyond <= FLAT * before and before > 0.0 else reached(x) - end

    end, slopes = reached(point.x), np.zeros(len(point.x))
    for i, q in enumerate(model.states if math.isfinite(end) else ()):
        for by in (share * q.scale for share in SOME):
            up, down = (moved(point.x + to * np.eye(len(slopes))[i]) for to in (by, -by))
            slopes[i] = (up - down) / (2.0 * by)
            if math.isfinite(slopes[i]):
                break
    found = np.array([size * round(end / size, 12), *slopes])
    return found if np.isfinite(found).all() else None
