"""Trim a model: the states and inputs at which it rests, or drifts in a known way.

A trim solves ``f(x, u) = drift d`` together with the values that are asked for. Without a
drifting direction d this is a true equilibrium. With one, the rates may differ from zero along it
and nowhere else: the mean pressure of two muscles behind one 5/3 valve leaks towards a mean of its
own, so any other mean can only be passed through, not held.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError, check_choice, check_finite, check_range
from workbench.model import EXACT, Input, Model, Output, Quantity, State
from workbench.model.units import from_si
from workbench.operating_point.derivatives import derivatives_of
from workbench.operating_point.reach import what_would_be_possible
from workbench.operating_point.trim import (
    Condition,
    Problem,
    Solution,
    conditions_of,
    solve,
)

Vector = npt.NDArray[np.float64]

CHAMBERS = ("pressure_1", "pressure_2")
"""States and readings whose mean ``mean_pressure`` prescribes."""


@dataclass(frozen=True)
class OperatingPoint:
    """States and inputs at which a model rests, and how well the equations are met.

    Args:
        model: The plant.
        x: States, shape (n_states,), in SI.
        u: Inputs, shape (n_inputs,), in SI.
        y: Readings, shape (n_outputs,), in SI.
        rates: Rates of the states there, shape (n_states,), in SI per second; zero but for drift.
        given: The values that were asked for, by name, in SI.
        mean_pressure: The mean gauge pressure that was asked for, in Pa, or None.
        drift: Rates of the states that were allowed to drift, by name, in SI per second; empty
            for a true equilibrium.
        residual: Largest error of the equations, relative to the scales of states and readings.
        condition_number: Ratio of the largest to the smallest singular value of the scaled
            equations, dimensionless.
        undetermined: States and inputs that rest at any value; they stand where they started.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> operating_point(servo_axis(), {"position": 0.2}).x.tolist()
        [0.2, 0.0]
    """

    model: Model
    x: Vector
    u: Vector
    y: Vector
    rates: Vector
    given: Mapping[str, float]
    mean_pressure: float | None
    drift: Mapping[str, float]
    residual: float
    condition_number: float
    undetermined: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Inputs, states and readings by name, in SI; a reading hides a state of its name."""
        model = self.model
        pairs = [
            *zip(model.inputs, self.u, strict=True),
            *zip(model.states, self.x, strict=True),
            *zip(model.outputs, self.y, strict=True),
        ]
        return {quantity.name: float(value) for quantity, value in pairs}

    def __getitem__(self, name: str) -> float:
        """Return a reading, state or input by name, in SI; readings come first."""
        values = self.values
        check_choice("quantity", name, values)
        return values[name]

    @property
    def is_equilibrium(self) -> bool:
        """Whether nothing drifts."""
        return not self.drift

    def __str__(self) -> str:
        """Return a short aligned table of inputs, readings, states, drift and residual."""
        model = self.model
        lines = [f"operating point of {model.name}: {model.description}".rstrip(": ")]
        lines += [_row("input", q, v) for q, v in zip(model.inputs, self.u, strict=True)]
        lines += [_row("reading", q, v) for q, v in zip(model.outputs, self.y, strict=True)]
        lines += [_row("state", q, v) for q, v in zip(model.states, self.x, strict=True)]
        for name, rate in self.drift.items():
            quantity = next(q for q in model.states if q.name == name)
            unit = "bar" if quantity.unit == "Pa" else quantity.unit
            lines.append(f"  drift    {name:<28} {from_si(rate, unit):>12.5g} {unit}/s")
        lines.append(
            f"  residual {self.residual:.1g} of scale, condition number {self.condition_number:.2g}"
        )
        if self.undetermined:
            lines.append(f"  rests at any value of {', '.join(self.undetermined)}")
        return "\n".join(lines)


def operating_point(
    model: Model,
    given: Mapping[str, float] | None = None,
    *,
    mean_pressure: float | None = None,
    drifting: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    near: OperatingPoint | None = None,
) -> OperatingPoint:
    """Find the states and inputs at which a model rests with given values.

    Solves ``f(x, u) = drift d`` and ``value = given`` by Newton's method on the exact equations
    with automatic derivatives, helped by the smooth equations where that fails.

    Without ``mean_pressure`` the result is a true equilibrium: of the arm, the one at which the
    leakage of the valve holds both pressures. With it, the mean of the two gauge pressures is
    prescribed and its drift is reported: angle, pressure difference and temperatures rest, the
    mean moves with ``drift`` towards the one that leakage holds.

    Args:
        model: The plant.
        given: Values of readings, states or inputs by name, in SI, at most one per input (and one
            per drifting direction); readings are looked up first, so ``pressure_1`` of the arm is
            the gauge pressure. By default the inputs at rest.
        mean_pressure: Mean of the readings ``pressure_1`` and ``pressure_2``, in Pa (gauge), for
            models that have both.
        drifting: Direction in which the rates may differ from zero, as weights of states by name,
            in SI; with ``mean_pressure``, both pressures alike.
        bounds: Smallest and largest value of states and inputs by name, in SI, inside those of
            the model; chamber pressures stay between ambient and supply.
        near: An operating point of a similar model to start from.

    Returns:
        The operating point.

    Raises:
        WorkbenchError: If a name is unknown, a value is outside its range, or there is no such
            point; the message then says which neighbouring values are possible.

    Source:
        Equilibrium of the equations; leakage of a 5/3 valve as in the paper's Figure 3.

    Example:
        >>> from workbench.plants.arm import arm
        >>> point = operating_point(arm(3), {"angle": math.radians(20)}, mean_pressure=3e5)
        >>> [round(point[name] / 1e5, 2) for name in ("pressure_1", "pressure_2")]
        [2.54, 3.46]
        >>> free = operating_point(arm(3), {"angle": math.radians(30)})
        >>> round(free["pressure_1"] / 1e5, 1), free.is_equilibrium
        (4.2, True)
    """
    wanted = _checked(model, given, mean_pressure)
    direction = _direction(model, mean_pressure, drifting)
    problem = Problem(
        model,
        _conditions(model, wanted, mean_pressure),
        direction,
        *_bounds(model, bounds),
    )
    x, u = _start(model, wanted, mean_pressure, near)
    solution = solve(problem, x, u)
    if not solution.solved:
        raise _impossible(problem, solution)
    if any("." in name for name in solution.undetermined):
        solution = _with_effects_at_start(problem, solution, x, u)
    _snap(model, wanted, solution)
    values = derivatives_of(model, EXACT).values(solution.x, solution.u, model.values)
    at, readings = values[: len(solution.x)], values[len(solution.x) :]
    return OperatingPoint(
        model=model,
        x=solution.x,
        u=solution.u,
        y=readings,
        rates=at,
        given=wanted,
        mean_pressure=mean_pressure,
        drift={
            q.name: float(rate)
            for q, rate, weight in zip(model.states, at, direction, strict=True)
            if weight
        },
        residual=solution.residual,
        condition_number=solution.condition_number,
        undetermined=solution.undetermined,
    )


def _checked(
    model: Model, given: Mapping[str, float] | None, mean_pressure: float | None
) -> dict[str, float]:
    everything: dict[str, Quantity] = {q.name: q for q in model.inputs}
    everything |= {q.name: q for q in model.states}
    states = dict(everything)
    everything |= {q.name: q for q in model.outputs}
    if given is None or not given:
        given = {q.name: q.nominal for q in model.inputs}
    if len(given) > len(model.inputs):
        raise WorkbenchError(
            f"{len(given)} values are given ({', '.join(given)}); {model.name!r} has"
            f" {len(model.inputs)} input(s) and can hold as many values: drop the others"
        )
    result = {}
    for name, value in given.items():
        check_choice("given quantity", name, everything)
        # The range of a state is that of the laws; a reading shares it if it shows that state.
        quantity = everything[name]
        same = states.get(name, quantity)
        bounded = same if same.unit == quantity.unit and quantity.unit != "Pa" else quantity
        unit = quantity.display_unit if isinstance(quantity, Output) else quantity.unit
        lower, upper = getattr(bounded, "lower", -math.inf), getattr(bounded, "upper", math.inf)
        check_finite(name, value)
        fix = "angles are in rad, use math.radians" if quantity.unit == "rad" else ""
        check_range(
            name,
            from_si(float(value), unit),
            from_si(lower, unit),
            from_si(upper, unit),
            unit,
            fix=fix,
        )
        result[name] = float(value)
    if mean_pressure is not None:
        names = {q.name for q in model.outputs}
        if not set(CHAMBERS) <= names:
            raise WorkbenchError(
                f"mean_pressure is given, but {model.name!r} has no readings pressure_1 and"
                " pressure_2; leave it out"
            )
        supply = {q.name: q.value for q in model.parameters}.get("supply_pressure", math.inf)
        check_finite("mean pressure", mean_pressure)
        check_range(
            "mean pressure",
            mean_pressure / 1e5,
            0.0,
            supply / 1e5,
            "bar gauge",
            fix="pressures are in Pa, between ambient and supply",
        )
    return result


def _conditions(
    model: Model, given: Mapping[str, float], mean_pressure: float | None
) -> tuple[Condition, ...]:
    found = list(conditions_of(model, list(given.items())))
    if mean_pressure is not None:
        one, two = conditions_of(model, [(name, 0.0) for name in CHAMBERS])
        weights = 0.5 * (one.weights + two.weights)
        found.append(Condition("mean pressure", weights, float(mean_pressure), one.scale))
    return tuple(found)


def _direction(
    model: Model, mean_pressure: float | None, drifting: Mapping[str, float] | None
) -> Vector:
    names = [q.name for q in model.states]
    if drifting is None:
        drifting = dict.fromkeys(CHAMBERS, 1.0) if mean_pressure is not None else {}
    direction = np.zeros(len(names))
    for name, weight in drifting.items():
        check_choice("drifting state", name, names)
        check_finite(f"weight of {name}", weight)
        # The drift is counted in scales of the states, so that it is of the size of the rest.
        direction[names.index(name)] = weight * model.states[names.index(name)].scale
    return direction


def _bounds(model: Model, given: Mapping[str, tuple[float, float]] | None) -> tuple[Vector, Vector]:
    quantities: list[State | Input] = [*model.states, *model.inputs]
    lower = np.array([q.lower for q in quantities])
    upper = np.array([q.upper for q in quantities])
    names = [q.name for q in quantities]
    values = {q.name: q.value for q in model.parameters}
    if {"ambient_pressure", "supply_pressure"} <= values.keys():
        for name in CHAMBERS:
            if name in names:
                i = names.index(name)
                lower[i] = max(lower[i], values["ambient_pressure"])
                upper[i] = min(upper[i], values["ambient_pressure"] + values["supply_pressure"])
    for name, (low, high) in (given or {}).items():
        check_choice("bounded quantity", name, names)
        i = names.index(name)
        if math.isnan(low) or math.isnan(high) or max(low, lower[i]) > min(high, upper[i]):
            raise WorkbenchError(
                f"bounds of {name} are {low:g} to {high:g} {quantities[i].unit}; they must overlap"
                f" with {lower[i]:g} to {upper[i]:g} {quantities[i].unit}"
            )
        lower[i], upper[i] = max(low, lower[i]), min(high, upper[i])
    return lower, upper


def _start(
    model: Model,
    given: Mapping[str, float],
    mean_pressure: float | None,
    near: OperatingPoint | None,
) -> tuple[Vector, Vector]:
    states = {q.name for q in model.states}
    readings = {q.name: q.unit for q in model.outputs}
    u = model.nominal_input
    for i, quantity in enumerate(model.inputs):
        u[i] = given.get(quantity.name, u[i])
    known = {
        name: value
        for name, value in given.items()
        # A gauge reading of a pressure is not the absolute pressure of the state.
        if name in states and readings.get(name) != "Pa"
    }
    if near is not None and [q.name for q in near.model.states] == [q.name for q in model.states]:
        x = near.x.copy()
        for name, value in known.items():
            x[[q.name for q in model.states].index(name)] = value
        return x, near.u.copy()
    ambient = {q.name: q.value for q in model.parameters}.get("ambient_pressure", 0.0)
    if mean_pressure is not None:
        known |= {name: mean_pressure + ambient for name in CHAMBERS if name in states}
    return model.initial_state(known, u=u), u


def _snap(model: Model, given: Mapping[str, float], solution: Solution) -> None:
    """Take the round-off away that would put a point on one side of a kink that it stands on.

    Without it an arm at 0 deg stands behind its stop, and a centred spool fills or vents.
    """
    for values, quantities in ((solution.x, model.states), (solution.u, model.inputs)):
        size = np.array([q.scale for q in quantities])
        values[np.abs(values) < 1e-12 * size] = 0.0
    for i, quantity in enumerate(model.states):
        value = given.get(quantity.name, math.nan)
        if abs(solution.x[i] - value) <= 1e-9 * quantity.scale:
            solution.x[i] = value


def _with_effects_at_start(problem: Problem, found: Solution, x: Vector, u: Vector) -> Solution:
    """Put states of effects that rest at any value, as hysteresis does, back to their start."""
    names = [q.name for q in problem.model.states]
    pinned = tuple(name for name in found.undetermined if "." in name)
    lower, upper = problem.lower.copy(), problem.upper.copy()
    for name in pinned:
        i = names.index(name)
        lower[i] = upper[i] = x[i]
    solution = solve(replace(problem, lower=lower, upper=upper), x, u)
    if not solution.solved:
        return found
    return replace(solution, undetermined=pinned) if pinned else solution


def _impossible(problem: Problem, solution: Solution) -> WorkbenchError:
    asked = ", ".join(
        f"{c.label} {_display(problem.model, c.label, c.value)}" for c in problem.conditions
    )
    model = problem.model
    return WorkbenchError(
        f"there is no operating point of {model.name!r} ({model.description}) with {asked};"
        f" {what_would_be_possible(problem, solution)}"
    )


def _display(model: Model, name: str, value: float) -> str:
    if name == "mean pressure":
        return f"{value / 1e5:g} bar gauge"
    quantity: Quantity = next(
        q for q in (*model.outputs, *model.states, *model.inputs) if q.name == name
    )
    unit = quantity.display_unit if isinstance(quantity, Output) else quantity.unit
    return f"{from_si(value, unit):g} {unit}"


def _row(kind: str, quantity: Quantity, value: float) -> str:
    unit = quantity.unit
    if isinstance(quantity, Output):
        unit = quantity.display_unit
    elif unit == "Pa":
        unit = "bar"
    # Round-off is not worth reading.
    shown = from_si(float(value), unit) if abs(value) > 1e-12 * quantity.scale else 0.0
    return f"  {kind:<8} {quantity.name:<28} {shown:>12.5g} {unit}"
