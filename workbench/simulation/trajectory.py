"""The result of a simulation: states, measurements and signals over time, and their accuracy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from workbench.arrays import Vector
from workbench.display import Drawn, Rows
from workbench.errors import check_choice
from workbench.model import EXACT, Form, Model, Quantity, Trace
from workbench.model.quantities import shown_in
from workbench.model.units import from_si, in_times
from workbench.simulation.equations import Equations
from workbench.simulation.integrators import at_every_row


@dataclass(frozen=True)
class RangeViolation:
    """A run that left the range within which a law of the model holds.

    Args:
        lower: Smallest valid value, in ``unit``.
        upper: Largest valid value, in ``unit``.
        extreme: The value farthest outside, in ``unit``.
        first_time: When it first left, in s.
        share: Fraction of the samples outside, dimensionless.

    Example:
        >>> print(RangeViolation("q", "m", 0.0, 0.033, 0.034, 1.5, 0.01))
        q left its valid range 0 to 0.033 m at 1.5 s: 0.034 m, 1.0 % of the run
    """

    signal: str
    unit: str
    lower: float
    upper: float
    extreme: float
    first_time: float
    share: float

    def __str__(self) -> str:
        return (
            f"{self.signal} left its valid range {self.lower:g} to {self.upper:g} {self.unit} at"
            f" {self.first_time:g} s: {self.extreme:.4g} {self.unit}, {100 * self.share:.1f} % of"
            " the run"
        )


@dataclass(frozen=True, repr=False)
class Trajectory(Drawn):
    """A simulated run of a model.

    Args:
        time: Sample times, shape (n,), in s.
        states: States, shape (n, n_states), in SI.
        inputs: Inputs, held from each sample to the next, shape (n, n_inputs), in SI.
        outputs: Measurements without noise and quantisation, shape (n, n_outputs), in SI.
        integrator: Name of the integrator, and whether it ran compiled.
        tolerance: Local error allowed in a step, relative to the scales of the states.
        error: Largest difference to a run with a ten times tighter tolerance, relative to the
            scales of the states; NaN if that run was not made.
        values: Parameter values used, shape (n_parameters,), in SI.
    """

    model: Model
    time: Vector
    states: Vector
    inputs: Vector
    outputs: Vector
    integrator: str
    tolerance: float
    error: float
    form: Form
    values: Vector

    @cached_property
    def violations(self) -> tuple[RangeViolation, ...]:
        """Where the run left the range within which a law of the model holds.

        One entry per state or published signal that left its range, empty if none did.
        """
        return _violations(self)

    @cached_property
    def signals(self) -> dict[str, Vector]:
        """Every port and published signal of the model, shape (n,) each, in SI, by name."""
        traced = self.model.form(self.form)
        table = _over(traced, "signals", self.states, self.inputs, self.values)
        return dict(zip(traced.signal_names, table.T, strict=True))

    def __getitem__(self, name: str) -> Vector:
        """Return a state, input, output, port or published signal over time, shape (n,), in SI."""
        for quantity, column in self._moving:
            if quantity.name == name:
                return np.asarray(column)
        if name not in self.signals:
            known = [quantity.name for quantity, _ in self._moving]
            check_choice("signal", name, [*known, *self.signals])
        return self.signals[name]

    @property
    def _moving(self) -> list[tuple[Quantity, Vector]]:
        """Outputs, states and inputs, each with its values over time, in SI."""
        model = self.model
        quantities = (*model.outputs, *model.states, *model.inputs)
        columns = (*self.outputs.T, *self.states.T, *self.inputs.T)
        return list(zip(quantities, columns, strict=True))

    def tables(self) -> tuple[Rows, ...]:
        """Return between which values every output, state and input moved."""
        return (what_moved(self._moving),)

    def columns(self) -> dict[str, Vector]:
        """Return time, outputs, states and inputs over time, in SI."""
        return {"time": self.time} | {q.name: self[q.name] for q, _ in self._moving}

    def __str__(self) -> str:
        (begin, end), unit_of_time = in_times([float(self.time[0]), float(self.time[-1])], 6)
        lines = [
            f"{self.model.name}: {len(self.time)} samples, {begin} to {end} {unit_of_time}",
            f"  {self.integrator}, tolerance {self.tolerance:g}, difference to a ten times tighter"
            f" run {self.error:.1g} of the states' scales",
        ]
        for q, column in zip(self.model.states, self.states.T, strict=True):
            unit = shown_in(q)
            said = "" if unit == "1" else unit
            low, high = (float(from_si(v, unit)) for v in (column.min(), column.max()))
            text = f"  {q.name:<28} {low:>12.5g} to {high:<12.5g} {said:<6} {q.description}"
            lines.append(text.rstrip())
        return "\n".join(lines + [f"  ! {violation}" for violation in self.violations])


def what_moved(moving: Iterable[tuple[Quantity, Vector]]) -> Rows:
    """Return between which values quantities moved, each in the unit in which it is shown.

    Args:
        moving: Quantities, each with its values over time, in SI.
    """
    rows = []
    for quantity, column in moving:
        unit = shown_in(quantity)
        shown = from_si(column, unit)
        rows.append((quantity.name, float(shown.min()), float(shown.max()), unit))
    return Rows("what moved", ("name", "smallest", "largest", "unit"), rows)


def read_outputs(
    model: Model, states: Vector, inputs: Vector, *, form: Form = EXACT, values: Vector
) -> Vector:
    """Compute what the sensors would read along a run, in SI, without noise and quantisation.

    Args:
        states: States, shape (n, n_states), in SI.
        inputs: Inputs, shape (n, n_inputs), in SI.
        values: Parameter values, shape (n_parameters,), in SI.
    """
    return _over(model.form(form), "outputs", states, inputs, values)


def _violations(run: Trajectory) -> tuple[RangeViolation, ...]:
    traced = run.model.form(run.form)
    checks = [(q.name, q.unit, q.lower, q.upper) for q in run.model.states]
    columns = [*run.states.T]
    checks += [(r.signal, r.unit, r.lower, r.upper) for r in traced.ranges]
    columns += [run.signals[r.signal] for r in traced.ranges]
    found = []
    for (name, unit, lower, upper), column in zip(checks, columns, strict=True):
        excess = np.maximum(lower - column, column - upper)
        outside = excess > 0
        if outside.any():
            found.append(
                RangeViolation(
                    name,
                    unit,
                    lower,
                    upper,
                    float(column[np.argmax(excess)]),
                    float(run.time[np.argmax(outside)]),
                    float(outside.mean()),
                )
            )
    return tuple(found)


def _over(traced: Trace, name: str, states: Vector, inputs: Vector, values: Vector) -> Vector:
    """Evaluate the outputs or the signals at every sample, one row each."""
    # Outputs are built with the rates that a run is made of.
    outputs = traced.rates_function, traced.outputs_function
    functions = outputs if name == "outputs" else (traced.signals_function,)
    return at_every_row(Equations(functions), len(functions) - 1, states, inputs, values)
