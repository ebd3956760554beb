"""Where commands end that a plant's own equations limit, within what its author declares."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.model import Model
from workbench.model.sizes import input_end
from workbench.operating_point import OperatingPoint

SOME = (0.1, 1e-3, 1e-5)
"""Parts of its scale by which a state is moved to see whether an end moves with it; the first that
leaves the command between its ends."""

BENT = 0.9
"""Answer to all of a command, over that by the slope at rest, below which a curve bends."""

STILL = 1e-6
"""Within this of where it was at rest, an end has not moved with a state, a ratio."""


def with_command_ends(
    point: OperatingPoint, at: Callable[..., tuple[Vector, Vector]]
) -> tuple[Model, Vector | None]:
    """Return the model, each command ending where nothing answers it, whatever the states.

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
            if not q.commanded:
                continue
            own = float(point.u[k])
            room = getattr(q, name) - own
            moves, fixed = _ends(point, at, k, sign * (q.scale or 1.0))
            if abs(fixed) < abs(room):
                room = fixed
                changed: dict[str, Any] = {name: own + room}
                found[k] = replace(found[k], **changed)
            if abs(moves[0]) < abs(room):
                moving[side, k] = moves
                continue
            if room and math.isfinite(room):
                moving[side, k, 0] = _straight(point, at, k, room)
    ends = moving if np.isfinite(moving[..., 0]).any() else None
    if found == list(model.inputs):
        return model, ends
    ended = copy.copy(model)
    object.__setattr__(ended, "inputs", tuple(found))
    return ended, ends


def _straight(
    point: OperatingPoint, at: Callable[..., tuple[Vector, Vector]], k: int, end: float
) -> float:
    """Return the change of an input, in SI, that does as much by the slopes at the point.

    Infinite where what the equations answer to it hardly bends.
    """
    values, slopes = at(point.x, point.u, point.model.values)
    moved = at(point.x, point.u + end * np.eye(len(point.u))[k], point.model.values)[0] - values
    slope = slopes[:, len(point.x) + k]
    shares = moved[slope != 0.0] / (end * slope[slope != 0.0])
    least = float(np.min(shares, initial=1.0))
    return end * least if 0.0 < least < BENT else math.copysign(math.inf, end)


def _ends(
    point: OperatingPoint, at: Callable[..., tuple[Vector, Vector]], k: int, size: float
) -> tuple[Vector, float]:
    """Return from what changes of an input on nothing answers it, infinite for none, in SI.

    Returns:
        Where that moves with states, and its slopes by them, shape (1 + n_states,); and where,
        once they have moved with the input, it ends all the same.
    """
    model, inputs = point.model, np.eye(len(point.u))[k]

    def slope_at(x: Vector, by: float) -> tuple[Vector, Vector]:
        values, slopes = at(x, point.u + by * inputs, model.values)
        return values, slopes[:, len(x) + k]

    def reached(x: Vector) -> float:
        return input_end(partial(slope_at, x), size)

    end, slopes = reached(point.x), np.zeros(len(point.x))
    for i, q in enumerate(model.states if math.isfinite(end) else ()):
        for by in (share * q.scale for share in SOME):
            up, down = (reached(point.x + to * np.eye(len(slopes))[i]) - end for to in (by, -by))
            # Rounding moves what stays.
            still = max(abs(up), abs(down)) <= STILL * abs(end)
            slopes[i] = 0.0 if still else (up - down) / (2.0 * by)
            if math.isfinite(slopes[i]):
                break
    found = np.array([end, *slopes])
    if not np.isfinite(found).all():
        return np.append(math.inf, np.zeros(len(slopes))), math.inf
    if not np.any(slopes):
        return found, end

    def with_state(i: int, by: float) -> tuple[Vector, Vector]:
        # What a state moves by itself tells nothing of the input.
        values, slopes_there = slope_at(point.x + by / slopes[i] * np.eye(len(slopes))[i], by)
        return 0.0 * values, slopes_there

    return found, max(
        (input_end(partial(with_state, i), size) for i in np.flatnonzero(slopes).tolist()), key=abs
    )
