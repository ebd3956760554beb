"""The curve of an actuator inverted: the plant that a controller sees behind the inverse.

Where a plant declares a static curve of its actuator, a controller may decide the curve's value, a
fraction, and send it through the inverse of the curve. What it then controls is the plant with a
straight line in the curve's place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model import ActuatorCurve, Model, Trace
from workbench.operating_point import OperatingPoint

_POINTS = 201
_PLANTS: WeakKeyDictionary[Trace, dict[tuple[str, bytes], Model]] = WeakKeyDictionary()
_MOST_PLANTS = 100


def straightened(model: Model, curve: ActuatorCurve | str) -> Model:
    """Return the plant as it is when a controller inverts the curve of its actuator.

    The actuator's dynamics and everything else stay.

    Raises:
        WorkbenchError: If the plant has several inputs, or not the ports of the curve.
    """
    if isinstance(curve, str):
        curve = model.traits.curve(curve)
    if len(model.inputs) != 1:
        raise WorkbenchError(
            f"{model.name!r} has {len(model.inputs)} inputs; the {curve.name} can stand for one"
        )
    known = _PLANTS.setdefault(model.exact, {})
    key = curve.name, model.values.tobytes()
    if key not in known:
        if len(known) >= _MOST_PLANTS:
            known.clear()
        known[key] = replace(model, effects=(curve.straight(), *model.effects))
    return known[key]


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
        for state in grid:
            x[self._index] = state
            values.append(self.curve.value(point.model.signals(x, point.u)))
        rising = np.concatenate([[True], np.diff(np.maximum.accumulate(values)) > 0.0])
        return np.array(values)[rising], grid[rising]

    @property
    def _index(self) -> int:
        return [q.name for q in self.operating_point.model.states].index(self.curve.state)

    def __call__(self, value: npt.ArrayLike) -> Vector:
        """Return the command that gives a value of the curve at rest.

        Args:
            value: Fraction, -1..1, any shape; beyond, the full command.

        Returns:
            Command, same shape, in SI, inside the range of the input.
        """
        point = self.operating_point
        values, states = self._table
        command = np.interp(np.asarray(value, dtype=float), values, states) + float(
            point.u[0] - point.x[self._index]
        )
        quantity = point.model.inputs[0]
        return np.asarray(np.clip(command, quantity.lower, quantity.upper))
