"""The equations that a linear model is one of, sample by sample from its operating point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.errors import NumericalError
from workbench.linearisation.linear_model import LinearModel
from workbench.model.linear_system import LinearEquations
from workbench.simulation.stepper import Stepper


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
        self.point = linear.operating_point
        model = self.point.model
        inputs, outputs = ([q.name for q in own] for own in (model.inputs, model.outputs))
        self._stepper = Stepper(model, sample_time, tolerance=TOLERANCE)
        self._acting = [inputs.index(name) for name in actuators]
        self._seen = [outputs.index(name) for name in sensors]
        self._ends = [(model.inputs[i].lower, model.inputs[i].upper) for i in self._acting]
        self.rest: list[float] = self.point.y[self._seen].tolist()
        self.start()

    def start(self) -> None:
        """Rest again."""
        self._x, self._u = self.point.x, self.point.u.copy()

    @property
    def command(self) -> tuple[float, ...]:
        """Commands that are held, in SI."""
        return tuple(self._u[self._acting].tolist())

    def read(self) -> Vector:
        """Return the measurements, without noise, shape (n_sensors,), in SI."""
        return self._stepper.read(self._x, self._u)[self._seen]

    def hold(self, command: Sequence[float]) -> bool:
        """Hold commands, in SI, for a sample, within their ends; tell whether that went."""
        for i, value, end in zip(self._acting, command, self._ends, strict=True):
            self._u[i] = min(max(value, end[0]), end[1])
        try:
            self._x = self._stepper.step(self._x, self._u)
        except NumericalError:
            if self._stepper.method == "rosenbrock":
                return False
            # What is stiff, or sticks, is left to the other method from there on.
            self._stepper = replace(self._stepper, method="rosenbrock")
            return self.hold(command)
        return math.isfinite(float(np.sum(self._x)))


def bends(linear: LinearModel) -> bool:
    """Tell whether there are equations that rest there, and that may be other than linear."""
    point = linear.operating_point
    return point.is_equilibrium and not isinstance(point.model.equations, LinearEquations)


TOLERANCE = 1e-5
"""Local error allowed in a step, relative to the scales of the states."""
