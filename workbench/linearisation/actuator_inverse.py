"""The curve of an actuator inverted: the plant that a controller sees behind the inverse.

Where a plant declares a static curve of its actuator, a controller may decide the curve's value, a
fraction, and send it through the inverse of the curve. What it then controls is the plant with a
straight line in the curve's place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model import EXACT, ActuatorCurve, Model, Trace
from workbench.operating_point import OperatingPoint, derivatives_of

_POINTS = 201
_PLANTS: WeakKeyDictionary[Trace, dict[tuple[str, bytes], Model]] = WeakKeyDictionary()
_MOST_PLANTS = 100


def straightened(model: Model, curve: ActuatorCurve | str) -> Model:
    """Return the plant as it is when a controller inverts the curve of its actuator.

    The actuator's dynamics and everything else stay.
    """
    if isinstance(curve, str):
        curve = model.traits.curve(curve)
    known = _PLANTS.setdefault(model.exact, {})
    key = curve.name, model.values.tobytes()
    if key not in known:
        if len(known) >= _MOST_PLANTS:
            known.clear()
        known[key] = replace(model, effects=(curve.straight(), *model.effects))
    return known[key]


def straightened_point(op: OperatingPoint, curves: Sequence[ActuatorCurve]) -> OperatingPoint:
    """Move an operating point to the plant with straight lines in the place of curves.

    Raises:
        WorkbenchError: If an effect keeps the state of a curve from following the command.
    """
    model, x, u = op.model, op.x.copy(), op.u.copy()
    for curve in curves:
        model = straightened(model, curve)
        i, k = places_of(op.model, curve)
        x[i] = curve.full * curve.value(op.model.signals(op.x, op.u))
        u[k] += x[i] - op.x[i]
    values, slopes = derivatives_of(model, EXACT)(x, u, model.values)
    rates, slopes = values[: len(x)], np.abs(slopes[: len(x)])
    scale = slopes @ np.array([q.scale for q in (*model.states, *model.inputs)])
    if np.any(np.abs(rates - op.rates) > 1e-4 * scale):
        raise WorkbenchError(
            f"the {' and the '.join(c.name for c in curves)} cannot be the input of {model.name!r}"
            f" here: an effect on the command keeps {' and '.join(c.state for c in curves)} from"
            " following it; use input='plant'"
        )
    return replace(op, model=model, x=x, u=u, rates=rates)


def places_of(model: Model, curve: ActuatorCurve) -> tuple[int, int]:
    """Return the places of a curve's state and of the input that it follows."""
    inputs = [q.name for q in model.inputs]
    state = [q.name for q in model.states].index(curve.state)
    return state, inputs.index(curve.input) if curve.input else 0


@dataclass(frozen=True)
class ActuatorInverse:
    """The inverse of an actuator's static curve, read off the model at its operating point."""

    operating_point: OperatingPoint
    curve: ActuatorCurve

    @cached_property
    def _table(self) -> tuple[Vector, Vector]:
        point, grid = self.operating_point, np.linspace(-1.0, 1.0, _POINTS) * self.curve.full
        x = point.x.copy()
        values = []
        index, _ = places_of(point.model, self.curve)
        for state in grid:
            x[index] = state
            values.append(self.curve.value(point.model.signals(x, point.u)))
        rising = np.concatenate([[True], np.diff(np.maximum.accumulate(values)) > 0.0])
        return np.array(values)[rising], grid[rising]

    def __call__(self, value: npt.ArrayLike) -> Vector:
        """Return the command, in SI and inside its range, that gives a value of the curve at rest.

        Args:
            value: Fraction, -1..1, any shape; beyond, the full command.
        """
        point = self.operating_point
        values, states = self._table
        i, k = places_of(point.model, self.curve)
        command = np.interp(np.asarray(value, dtype=float), values, states) + float(
            point.u[k] - point.x[i]
        )
        quantity = point.model.inputs[k]
        return np.asarray(np.clip(command, quantity.lower, quantity.upper))
