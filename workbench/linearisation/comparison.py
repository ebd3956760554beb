"""The full plant and a linear model behind the same held inputs.

Both runs get the same inputs, held between the same samples, so that holding itself is no
difference. Where the operating point drifts, the plant is compared with the rates of the point
taken off: the drift is known, and a linear model is not to be blamed for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from workbench.arrays import Vector
from workbench.errors import NumericalError, WorkbenchError
from workbench.linearisation.linear_model import LinearModel
from workbench.linearisation.pace import step_time
from workbench.linearisation.transfer import transfer_function
from workbench.model import Model, Output, Parameter, Scope
from workbench.model.trace import Equations
from workbench.operating_point import OperatingPoint
from workbench.simulation.stepper import Stepper

BLOCK = 250
"""Samples that are run at once; comparisons last whole blocks."""


class Comparison:
    """The first output of the exact plant and of a linear model, at changes of the first input.

    ``sample_time`` is the time between its samples, in s.
    """

    def __init__(self, linear: LinearModel) -> None:
        op = linear.operating_point
        self.model = linear
        self.sample_time = step_time(linear) / 1000
        outputs = [q.name for q in op.model.outputs]
        self.plant_index = outputs.index(linear.output_names[0])
        self.quantity: Output = op.model.outputs[self.plant_index]
        self.largest = self._largest()
        self.held_plant = _without_drift(op)
        self.steppers: dict[str, Stepper] = {}

    def _largest(self) -> float:
        u0 = float(self.model.u0[0])
        if self.model.inverse is not None:
            return 1.0 - abs(u0)
        op = self.model.operating_point
        quantity = next(q for q in op.model.inputs if q.name == self.model.input_names[0])
        room = min(quantity.upper - u0, u0 - quantity.lower)
        if room <= 0.0:
            raise WorkbenchError(
                f"{quantity.name} rests at an end of its range, {u0:g} {quantity.unit}; how far the"
                " linear model holds is tried in both directions: rest the plant elsewhere, with"
                " another output or input (--at NAME=VALUE)"
            )
        return room if math.isfinite(room) else 10.0 * quantity.scale

    def gain(self, s: complex) -> complex:
        """Compute the linear model's transfer function at a complex frequency, in rad/s."""
        m = self.model
        return complex(transfer_function(m.A, m.B, m.C, m.D, s)[0, 0])

    def linear(self, change: Vector) -> Vector:
        """Compute how the output of the linear model changes, shape (n,), in SI.

        Args:
            change: Change of the first input, shape (n,), in SI.
        """
        held = np.tile(self.model.u0, (len(change), 1))
        held[:, 0] += change
        response = self.model.response(held, self.sample_time)
        return np.asarray(response[:, 0] - self.model.y0[0])

    def plant(self, change: Vector) -> Vector:
        """Compute how the exact plant's output changes, shape (n,), with its first input, in SI.

        Raises:
            NumericalError: If the integrator gives up.
        """
        op = self.model.operating_point
        held = np.tile(op.u, (len(change), 1))
        i = 0
        if self.model.inverse is None:
            names = [q.name for q in op.model.inputs]
            i = names.index(self.model.input_names[0])
        held[:, i] = self.model.to_plant(self.model.u0[0] + change)
        try:
            return self._run("erk", held)
        except NumericalError:
            return self._run("rosenbrock", held)

    def _run(self, method: str, held: Vector) -> Vector:
        op = self.model.operating_point
        if method not in self.steppers:
            self.steppers[method] = Stepper(
                self.held_plant, self.sample_time, 1e-7, "erk" if method == "erk" else "rosenbrock"
            )
        stepper = self.steppers[method]
        x, read = op.x, []
        for start in range(0, len(held), BLOCK):
            block = held[start : start + BLOCK]
            after = stepper.run(x, block)
            for state, u in zip(np.vstack([x, after[:-1]]), block, strict=True):
                read.append(stepper.read(state, u)[self.plant_index])
            x = after[-1]
        return np.asarray(read, dtype=float) - float(op.y[self.plant_index])


@dataclass(frozen=True)
class _Held:
    """Equations with constant rates taken off."""

    equations: Callable[..., Equations]
    names: tuple[str, ...]

    def __call__(self, m: Scope) -> Equations:
        rates, outputs = self.equations(m)
        taken = {name: rates[name] - m.p[f"held_rate.{name}"] for name in self.names}
        return {**rates, **taken}, outputs


def _without_drift(op: OperatingPoint) -> Model:
    if not op.drift:
        return op.model
    # Parameters instead of numbers: the compiled plant then serves every operating point.
    units = {q.name: q.unit for q in op.model.states}
    extra = tuple(
        Parameter(f"held_rate.{name}", f"{units[name]}/s", value=rate)
        for name, rate in op.drift.items()
    )
    return replace(
        op.model,
        equations=_Held(op.model.equations, tuple(n for n in op.drift if "." not in n)),
        parameters=(*op.model.parameters, *extra),
    )
