"""The equations that a linear model is one of, sample by sample from its operating point."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.arrays import Vector
from workbench.linearisation.linear_model import LinearModel
from workbench.model.linear_system import LinearEquations
from workbench.simulation.integrators import Method, integrator_of


class FromRest:
    """A plant that leaves the rest of a linear model, inputs held between samples.

    Args:
        sample_time: Time between samples, in s.
        actuators: Inputs that are commanded; all others rest.
        sensors: Outputs that are read.
    """

    def __init__(
        self,
        linear: LinearModel,
        sample_time: float,
        actuators: Sequence[str],
        sensors: Sequence[str],
    ) -> None:
        self.point, self._sample_time = linear.operating_point, sample_time
        model = self.point.model
        inputs, outputs = ([q.name for q in own] for own in (model.inputs, model.outputs))
        self._acting = [inputs.index(name) for name in actuators]
        self._seen = [outputs.index(name) for name in sensors]
        self._ends = [(model.inputs[i].lower, model.inputs[i].upper) for i in self._acting]
        self.rest: list[float] = self.point.y[self._seen].tolist()
        self._x, self._u = self.point.x.copy(), self.point.u.copy()
        self._integrate_by("erk")
        self._at_rest = self._y.copy()

    def _integrate_by(self, method: Method) -> None:
        model = self.point.model
        scale = np.array([q.scale for q in model.states])
        own = integrator_of(method, model.exact, scale, self._sample_time, TOLERANCE)
        self._y = own.equations(1, self._x, self._u, model.values)
        self._hold = own.holding(self._x, self._u, model.values, self._y)
        self._stiff = method == "rosenbrock"

    def start(self) -> None:
        """Rest again."""
        self._x[:], self._u[:], self._y[:] = self.point.x, self.point.u, self._at_rest

    @property
    def command(self) -> tuple[float, ...]:
        """Commands that are held, in SI."""
        return tuple(self._u[self._acting].tolist())

    def read(self) -> Vector:
        """Return the measurements, without noise, shape (n_sensors,), in SI."""
        return self._y[self._seen]

    def hold(self, command: Sequence[float]) -> bool:
        """Hold commands, in SI, for a sample, within their ends; tell whether that went."""
        for i, value, end in zip(self._acting, command, self._ends, strict=True):
            self._u[i] = min(max(value, end[0]), end[1])
        before = self._x.copy()
        if self._hold():
            return math.isfinite(sum(self._x.tolist()))
        if self._stiff:
            return False
        # What is stiff, or sticks, is left to the other method from there on.
        self._x[:] = before
        self._integrate_by("rosenbrock")
        return self.hold(command)


def bends(linear: LinearModel) -> bool:
    """Tell whether there are equations that rest there, and that may be other than linear."""
    point = linear.operating_point
    return point.is_equilibrium and not isinstance(point.model.equations, LinearEquations)


TOLERANCE = 1e-5
"""Local error allowed in a step, relative to the scales of the states."""
