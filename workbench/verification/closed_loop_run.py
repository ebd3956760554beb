"""The record of a closed-loop run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.display import Drawn, Rows
from workbench.errors import WorkbenchError, check_choice
from workbench.model import Input, Model, Output, Quantity
from workbench.model.units import in_time
from workbench.simulation.trajectory import what_moved
from workbench.verification.scenario import Scenario


class NoSignalError(WorkbenchError):
    """A run has no signal of that name."""


@dataclass(frozen=True, repr=False)
class Run(Drawn):
    """What happened in a closed loop, sample by sample.

    Row k holds the states and measurements at t = k h, and the command held from there to (k + 1)
    h.

    Args:
        time: Sample times, shape (n,), in s.
        references: Reference of each controlled output, shape (n,) each, in SI.
        states: States, shape (n, n_states), in SI.
        outputs: Outputs without noise and quantisation, shape (n, n_outputs), in SI.
        measured: What the controller's sensors read, shape (n, n_sensors), in SI.
        inputs: Commands that reached the plant, shape (n, n_inputs), in SI.
        parameters: Plant parameters, shape (n, n_parameters), in SI; no columns for a linear model.
        tolerance: Tolerance of the integrator, relative to the scales of the states.
        surface_layer: Boundary layer of a sliding controller, in the unit of its surface.
    """

    controller: str
    plant: str
    scenario: Scenario
    seed: int
    time: Vector
    references: Mapping[str, Vector]
    states: Vector
    outputs: Vector
    measured: Vector
    inputs: Vector
    parameters: Vector
    infos: tuple[Mapping[str, Any], ...]
    output_quantities: tuple[Output, ...]
    input_quantities: tuple[Input, ...]
    sensors: tuple[str, ...]
    controlled: tuple[str, ...]
    model: Model | None = None
    integrator: str = ""
    tolerance: float = 0.0
    state_names: tuple[str, ...] = field(default=())
    surface_layer: float = 1.0
    guarded: bool = False

    def __getitem__(self, name: str) -> Vector:
        """Return an output, input, state or signal over time, shape (n,), in SI."""
        for names, table in (
            ([q.name for q in self.output_quantities], self.outputs),
            ([q.name for q in self.input_quantities], self.inputs),
            (list(self.state_names), self.states),
        ):
            if name in names:
                return np.asarray(table[:, names.index(name)])
        known = [q.name for q in (*self.output_quantities, *self.input_quantities)]
        try:
            check_choice("signal", name, [*known, *self.state_names, *self.signal_names])
        except WorkbenchError as error:
            raise NoSignalError(str(error)) from None
        return self.derived(name, lambda run: self._signal(name))

    @cached_property
    def signal_names(self) -> tuple[str, ...]:
        """Names of the ports and published signals of the full plant."""
        return self.model.exact.signal_names if self.model else ()

    def measurement(self, name: str) -> Vector:
        """Return what one of the controller's sensors read, shape (n,), in SI."""
        check_choice("sensor", name, self.sensors)
        return np.asarray(self.measured[:, self.sensors.index(name)])

    def info(self, name: str) -> Vector:
        """Return a number that the steps told, shape (n,), in its own unit; NaN where none did."""
        return np.array([float(i.get(name, np.nan)) for i in self.infos])

    @cached_property
    def _derived(self) -> dict[str, Vector]:
        return {}

    def derived(self, name: str, compute: Callable[[Run], Vector]) -> Vector:
        """Return what a function makes of the run, computed once."""
        if name not in self._derived:
            self._derived[name] = compute(self)
        return self._derived[name]

    def _signal(self, name: str) -> Vector:
        assert self.model is not None
        traced = self.model.exact
        signal = traced.signals[traced.signal_names.index(name)]
        return traced.along(self.states, self.inputs, self.parameters, signal)[0][:, 0, 0]

    def tables(self) -> tuple[Rows, ...]:
        """Return between which values every output and input moved."""
        return (what_moved(self._moving),)

    def columns(self) -> dict[str, Vector]:
        """Return time, references, outputs, measurements and inputs over time, in SI."""
        inputs = dict(zip((q.name for q in self.input_quantities), self.inputs.T, strict=True))
        outputs = dict(zip((q.name for q in self.output_quantities), self.outputs.T, strict=True))
        measured = {f"{n} measured": self.measurement(n) for n in self.sensors}
        asked = {f"{n} reference": values for n, values in self.references.items()}
        return {"time": self.time, **asked, **outputs, **measured, **inputs}

    @property
    def _moving(self) -> list[tuple[Quantity, Vector]]:
        """Outputs and inputs, each with its values over time, in SI."""
        quantities = (*self.output_quantities, *self.input_quantities)
        return list(zip(quantities, (*self.outputs.T, *self.inputs.T), strict=True))

    def __str__(self) -> str:
        lines = [
            f"{self.controller} on {self.plant}: {self.scenario.name}, {len(self.time)} samples of"
            f" {in_time(self.scenario.sample_time, 6)}, seed {self.seed}, {self.integrator}"
        ]
        lines += [
            f"  {q.name:<20} {c.min():>12.5g} to {c.max():<12.5g} {q.unit}" for q, c in self._moving
        ]
        return "\n".join(lines)
