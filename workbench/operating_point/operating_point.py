"""Trim a model: the states and inputs at which it rests, or drifts in a known way.

A trim solves ``f(x, u) = drift d`` together with the values that are asked for. Without a
drifting direction d this is a true equilibrium. With one, the rates may differ from zero along it
and nowhere else: the mean pressure of two chambers behind one 5/3 valve leaks towards a mean of its
own, so any other mean can only be passed through, not held. A plant declares such sums in its
`Traits`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, islice
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.display import Rows, Shown
from workbench.errors import WorkbenchError, check_choice, check_finite, check_range
from workbench.model import EXACT, DriftingSum, Input, Model, Quantity, State
from workbench.model.quantities import shown_in
from workbench.model.units import from_si, of_difference, with_unit
from workbench.operating_point.derivatives import derivatives_of
from workbench.operating_point.trim import (
    RESIDUAL_TOLERANCE,
    Condition,
    Problem,
    Solution,
    clocks_of,
    conditions_of,
    input_named,
    limits_of,
    rate_sizes,
    solve,
    what_would_be_possible,
)
from workbench.plants.registry import model_of


@dataclass(frozen=True, repr=False)
class OperatingPoint(Shown):
    """States and inputs at which a model rests, and how well the equations are met.

    Args:
        x: States, shape (n_states,), in SI.
        u: Inputs, shape (n_inputs,), in SI.
        y: Measurements, shape (n_outputs,), in SI.
        rates: Rates of the states there, shape (n_states,), in SI per second; zero but for drift.
        given: The values that were asked for, by name, in SI.
        drift: Rates of the states that were allowed to drift, by name, in SI per second; empty
            for a true equilibrium.
        residual: Largest error of the equations, relative to the scales of states and measurements.
        condition_number: Ratio of the largest to the smallest singular value of the scaled
            equations, dimensionless.
        undetermined: States and inputs that rest at any value; they stand where they started.
    """

    model: Model
    x: Vector
    u: Vector
    y: Vector
    rates: Vector
    given: Mapping[str, float]
    drift: Mapping[str, float]
    residual: float
    condition_number: float
    undetermined: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Inputs, states and measurements by name, in SI; measured values come first."""
        model = self.model
        pairs = [
            *zip(model.inputs, self.u, strict=True),
            *zip(model.states, self.x, strict=True),
            *zip(model.outputs, self.y, strict=True),
        ]
        return {quantity.name: float(value) for quantity, value in pairs}

    def __getitem__(self, name: str) -> float:
        """Return a measurement, state or input by name, in SI; measurements come first."""
        values = self.values
        check_choice("quantity", name, values)
        return values[name]

    @property
    def is_equilibrium(self) -> bool:
        """Whether nothing drifts."""
        return not self.drift

    def tables(self) -> tuple[Rows, ...]:
        """Return inputs, measurements, states and drift in the units in which they are shown."""
        model = self.model
        rows = [_entry("input", q, v) for q, v in zip(model.inputs, self.u, strict=True)]
        rows += [_entry("output", q, v) for q, v in zip(model.outputs, self.y, strict=True)]
        rows += [_entry("state", q, v) for q, v in zip(model.states, self.x, strict=True)]
        for name, rate in self.drift.items():
            unit = shown_in(next(q for q in model.states if q.name == name))
            rate_unit = of_difference(unit)
            rows.append(("drift", name, float(from_si(rate, rate_unit)), f"{rate_unit}/s"))
        return (Rows("values at rest", ("kind", "name", "value", "unit"), rows),)

    def in_words(self) -> str:
        """Return inputs and measurements in one line, in the units in which they are shown."""
        rows = self.tables()[0].rows[: len(self.u) + len(self.y)]
        return ", ".join(f"{n} {with_unit(f'{v:.4g}', str(unit))}" for _, n, v, unit in rows)

    def drift_in_words(self) -> str:
        """Return how fast each state goes on that does not rest there."""
        drifting = [row for row in self.tables()[0].rows if row[0] == "drift"]
        return ", ".join(f"{n} by {with_unit(f'{v:.3g}', str(unit))}" for _, n, v, unit in drifting)

    def __str__(self) -> str:
        model = self.model
        lines = [f"operating point of {model.name}: {model.description}".rstrip(": ")]
        meanings = [q.description for q in (*model.inputs, *model.outputs, *model.states)]
        rows = self.tables()[0].rows
        # What drifts stands at the end and has no meaning of its own.
        for i, (kind, name, value, unit) in enumerate(rows):
            meaning = meanings[i] if i < len(meanings) else ""
            shown = "" if unit == "1" else unit
            lines.append(f"  {kind:<8} {name:<28} {value:>12.5g} {shown:<6} {meaning}".rstrip())
        lines.append(
            f"  residual {self.residual:.1g} of the states' scales,"
            f" condition number {self.condition_number:.2g}"
        )
        if self.undetermined:
            lines.append(f"  rests at any value of {', '.join(self.undetermined)}")
        return "\n".join(lines)


@dataclass(frozen=True)
class _Search:
    """Where rest is looked for: of a model, within bounds, near a point; as they are given."""

    model: Model
    bounds: Mapping[str, tuple[float, float]] | None = None
    near: OperatingPoint | None = None


def operating_point(
    model: Model | Any,
    given: Mapping[str, float] | None = None,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    near: OperatingPoint | None = None,
) -> OperatingPoint:
    """Find the states and inputs at which a model rests with given values.

    Solves ``f(x, u) = drift d`` and ``value = given`` by Newton's method on the exact equations
    with automatic derivatives, helped by the regularised equations where that fails.

    A name of ``given`` may also be a sum that the plant declares to drift, such as
    ``mean_pressure`` of the arm: it is then prescribed, everything else rests, and its drift is
    reported. Without one the result is a true equilibrium: of the arm, where the valve's leakage
    holds both pressures. What changes at a time, such as a jump of a parameter, has changed.

    Of a plant that declares no such sum and rests nowhere, as a roll that grows, a cell that is
    discharged or a rocket that burns, a state or two go on: they stand where they start, or where
    what is given puts them, and their rates are the drift.

    Args:
        model: The plant, or what stands for it, such as a system of python-control.
        given: Values of measurements, states or inputs by name, in SI, at most one per input (and
            one per drifting direction); measurements are looked up first. By default the inputs at
            rest, or in the middle of their ranges where a model that says nothing of rest stands at
            a root, as an empty tank does; where they do not hold the model, which grows away from
            there too, or no command declares a value at rest and a state starts elsewhere than at
            0, as many outputs as commands can as they start.
        bounds: Smallest and largest value of states and inputs by name, in SI, inside those of
            the model and the limits that the plant declares.

    Raises:
        WorkbenchError: If a name is unknown, a value is outside its range, or there is no such
            point; the message then says which neighbouring values are possible.

    Source:
        Equilibrium of the equations; leakage of a 5/3 valve as in the paper's Figure 3.

    Example:
        >>> from workbench.plants.arm import arm
        >>> point = operating_point(arm(3), {"angle": math.radians(20), "mean_pressure": 3e5})
        >>> [round(point[name] / 1e5, 2) for name in ("pressure_1", "pressure_2")]
        [2.54, 3.46]
        >>> free = operating_point(arm(3), {"angle": math.radians(30)})
        >>> round(free["pressure_1"] / 1e5, 1), free.is_equilibrium
        (4.2, True)
    """
    model = model_of(model)
    asked = _checked(model, given)
    idle = _idle(model).keys()
    if given and given.keys() <= idle:
        # Beside another wind, commands hold what they hold beside the usual one.
        inputs = tuple(
            replace(q, nominal=asked.get(input_named(model, q.name), q.nominal))
            for q in model.inputs
        )
        point = operating_point(replace(model, inputs=inputs), bounds=bounds, near=near)
        return replace(point, model=model)
    search = _Search(model, bounds, near)
    crowded = len(_with_disturbances(model, asked)) < len(_undisturbed(model, asked))
    if crowded and (passed := _passed_through(search, asked)):
        return passed
    try:
        return _resting(search, given)
    except _NoPointError:
        # What rests, but not where it shall, such as a rotor beyond its fastest speed, is told so.
        commands = _at_nominal(model, model.commands).keys()
        elsewhere = asked.keys() - idle and not asked.keys() & commands
        if crowded or (elsewhere and _rests(replace(search, near=None))):
            raise
        if passed := _passed_through(search, asked):
            return passed
        raise


def _rests(search: _Search) -> bool:
    """Say whether all of a model rests by what it declares, or held where it starts."""
    try:
        return _resting(search, None).is_equilibrium
    except _NoPointError:
        return False


def _resting(search: _Search, given: Mapping[str, float] | None) -> OperatingPoint:
    """Find where all of a model rests, but for the sums that it declares to drift."""
    model = search.model
    if _tells_where(model) and (held := _held_at_start(search, given)):
        return held
    wanted = _with_disturbances(model, _checked(model, given))
    sums = [total for total in model.traits.sums if total.name in _drifting(model, wanted)]
    conditions = _conditions(model, wanted, sums)
    problem = Problem(model, conditions, _directions(model, sums), *_bounds(search))
    x, u = _start(search, wanted, sums)
    x = np.clip(x, problem.lower[: len(x)], problem.upper[: len(x)])
    solution = solve(problem, x, u)
    # A saturation beside which nothing has a slope leads nowhere, nor does the root of nothing.
    beside = [(x, one) for one in _within_ranges(model, u)]
    beside.append((x + np.array([q.scale for q in model.states]), u))
    for start in beside if not solution.solved else ():
        if (other := solve(problem, *start)).solved:
            solution = other
            break
    if not solution.solved:
        # What nominal inputs do not carry, or fill and empty, is held where it starts. A command
        # that declares quite another value keeps that if all rests by it but what goes on slowly.
        held = None if given else _held_at_start(search)
        if held and _says_rest(model) and not _about_nominal(held):
            return _passed_through(search, wanted) or held
        if held:
            return held
        raise _NoPointError(lambda: _impossible(problem, solution, asked=bool(given)))
    # By itself it would not come to rest there, nor stay: a command that holds it does.
    leaves = not given and np.any(model.initial_state()) and _runs_away(model, solution)
    if leaves and (held := _held_at_start(search)):
        return held
    silent = not (given or _says_rest(model) or np.any(model.initial_state()))
    if silent and _rests_at_a_root(model, solution):
        for elsewhere in _within_ranges(model, u):
            middle = {q.name: float(v) for q, v in zip(model.inputs, elsewhere, strict=True)}
            with suppress(WorkbenchError):
                return _resting(search, middle)
    # What begins nowhere and rests anywhere would rest where chance lets it.
    anywhere = [q.name for q in model.states if q.name in solution.undetermined]
    started = derivatives_of(model, EXACT).values(x, u, model.values)
    if anywhere and not np.isfinite(started).all():
        raise _no_numbers(model, f"where {model.name!r} begins, and it rests anywhere,")
    if any("." in name for name in solution.undetermined):
        solution = _with_effects_at_start(problem, solution, x, u)
    return _point(problem, solution, wanted)


def _about_nominal(point: OperatingPoint) -> bool:
    """Say whether commands are about where they declare to be."""
    pairs = zip(point.u, point.model.inputs, strict=True)
    return all(abs(u - q.nominal) < _ABOUT * q.scale for u, q in pairs if q.commanded)


def _passed_through(search: _Search, asked: Mapping[str, float]) -> OperatingPoint | None:
    """Find where all rests but a state or two that go on slowly, such as the radius of a roll.

    They stand where they start, or where what is given puts them. Slow is what takes ten times as
    long to go its scale as any other state does when something moves by its own.
    """
    model = search.model
    if model.traits.sums:
        return None
    wanted = _undisturbed(model, dict(asked))
    found = _passing(search, wanted)
    if not found and len(wanted) <= len(model.inputs):
        # What is given is where a state goes by that the usual commands do not hold.
        wanted = _at_nominal(model, model.inputs) | wanted
        found = _passing(search, wanted)
    return _point(*found, wanted) if found else None


def _passing(search: _Search, wanted: Mapping[str, float]) -> tuple[Problem, Solution] | None:
    model = search.model
    conditions = _conditions(model, wanted, ())
    x, u = _start(search, wanted, ())
    size = np.array([q.scale for q in model.states])
    own = [i for i, q in enumerate(model.states) if "." not in q.name]
    limits = _bounds(search)
    x = np.clip(x, limits[0][: len(x)], limits[1][: len(x)])
    more = max(0, len(conditions) - len(model.inputs))
    for count in range(max(1, more), min(_PASSING, len(x) - 1) + 1):
        slowest, best = SLOW, None
        for going in map(list, combinations(own, count)):
            held = [(model.states[i].name, x[i]) for i in going[more:]]
            every = (*conditions, *conditions_of(model, held, states_first=True))
            problem = Problem(model, every, np.diag(size)[:, going], *limits)
            solution = solve(problem, x, u, robust=False)
            if not solution.solved:
                continue
            rates = derivatives_of(model, EXACT).values(solution.x, solution.u, model.values)
            others = np.delete(rate_sizes(model, solution.x, solution.u) / size, going)
            pace = float(np.max(np.abs(rates[going]) / size[going]) / others.min())
            if pace < slowest:
                slowest, best = pace, (problem, solution)
        if best:
            return best
    return None


_ABOUT = 0.1
"""Distance of a command from its nominal value, over its scale, that may be its rounding."""

_PASSING, SLOW = 2, 0.1
"""Most states that go on while the others rest, and how fast they may, over the pace of these."""


def _point(problem: Problem, solution: Solution, wanted: Mapping[str, float]) -> OperatingPoint:
    """Return what a trim found, without its round-off."""
    model = problem.model
    _snap(model, wanted, solution)
    values = derivatives_of(model, EXACT).values(solution.x, solution.u, model.values)
    # What is zero within the tolerance may be zero.
    x, u = (
        np.where(np.abs(found) < RESIDUAL_TOLERANCE * np.array([q.scale for q in of]), 0.0, found)
        for found, of in ((solution.x, model.states), (solution.u, model.inputs))
    )
    rounded = derivatives_of(model, EXACT).values(x, u, model.values)
    if not np.isfinite([values, rounded]).all():
        raise _no_numbers(model, f"where {model.name!r} would rest with {_asked(problem)},")
    at, measurements = values[: len(solution.x)], values[len(solution.x) :]
    return OperatingPoint(
        model=model,
        x=solution.x,
        u=solution.u,
        y=measurements,
        rates=at,
        given=wanted,
        drift={
            q.name: float(rate)
            for q, rate, weights in zip(model.states, at, problem.drifting, strict=True)
            if weights.any()
        },
        residual=solution.residual,
        condition_number=solution.condition_number,
        undetermined=solution.undetermined,
    )


def _no_numbers(model: Model, where: str) -> WorkbenchError:
    """Return what asks for another point of rest than where the equations have no numbers."""
    return WorkbenchError(
        f"{where} its equations divide by zero or leave the numbers; {_elsewhere(model)}"
    )


def _elsewhere(model: Model) -> str:
    """Return what may be given for a model to rest elsewhere."""
    names = ", ".join(q.name for q in model.outputs)
    return f"give values at rest (--at NAME=VALUE, of verify --from VALUE), such as of {names}"


def _runs_away(model: Model, solution: Solution) -> bool:
    """Tell whether a model that rests grows away from there by itself."""
    _, slopes = derivatives_of(model, EXACT)(solution.x, solution.u, model.values)
    n = len(solution.x)
    size = np.array([q.scale for q in model.states])
    A = slopes[:n, :n] * size / size[:, None]
    if not n or not np.isfinite(A).all():
        return False
    poles = np.linalg.eigvals(A)
    return bool(np.any(poles.real > GROWS * np.abs(poles).max()))


def _rests_at_a_root(model: Model, solution: Solution) -> bool:
    """Tell whether a slope beside a point of rest grows without end towards it, as of a root."""
    n, size = len(solution.x), np.array([q.scale for q in model.states])
    at = derivatives_of(model, EXACT)
    for side in (1.0, -1.0):
        far, near = (
            np.abs(at(solution.x + side * by * size, solution.u, model.values)[1][:n, :n]) * size
            for by in BESIDE
        )
        least = GROWS * far.max(axis=1, initial=0.0, keepdims=True)
        if np.any(near > GROWN * np.maximum(far, least)):
            return True
    return False


BESIDE, GROWN = (1e-6, 1e-9), 5.0
"""Distances from a point, in scales, between which the slope of a root is 30 times as large, and of
a power of 2/3 ten times; and the ratio from which on it is one."""

GROWS = 1e-6
"""Rate over that of the fastest mode from which on one grows and does not integrate."""


def _within_ranges(model: Model, u: Vector) -> Iterator[Vector]:
    """Yield inputs, in SI, with those that have a range elsewhere within it."""
    lower, upper = (np.array([getattr(q, end) for q in model.inputs]) for end in ("lower", "upper"))
    ranged = np.isfinite(upper - lower)
    for share in (0.5, 0.25, 0.75) if ranged.any() else ():
        yield np.where(ranged, lower + share * np.where(ranged, upper - lower, 0.0), u)


def _tells_where(model: Model) -> bool:
    """Say whether a model tells where its machine is, not what commands hold it there."""
    return bool(not _says_rest(model) and np.any(model.initial_state()))


def _says_rest(model: Model) -> bool:
    """Say whether a command declares its value at rest."""
    return any(q.nominal != q.unsaid for q in model.commands)


def usual_inputs(model: Model) -> dict[str, float]:
    """Return where inputs rest by default, in SI, by name.

    They are at their nominal values, or hold outputs as they start where no command declares one.
    """
    usual = {q.name: q.nominal for q in model.inputs}
    if _tells_where(model):
        with suppress(WorkbenchError):
            usual |= zip(usual, operating_point(model).u.tolist(), strict=True)
    return usual


def _held_at_start(
    search: _Search, given: Mapping[str, float] | None = None
) -> OperatingPoint | None:
    """Find where as many outputs as commands can hold rest as they start; None if nowhere.

    Commands hold what is given first.
    """
    model, asked = search.model, dict(given or {})
    start = model.read(model.initial_state(), model.nominal_input)
    others = len(asked.keys() - _at_nominal(model, model.inputs).keys())
    commands = [q for q in model.commands if input_named(model, q.name) not in asked][others:]
    idle = _idle(model)
    outputs = [
        (q.name, float(y)) for q, y in zip(model.outputs, start, strict=True) if q.name not in asked
    ]
    for count in range(min(len(commands), len(outputs)), 0, -1):
        left = _at_nominal(model, commands[count:])
        # The first outputs, or others where what is given leaves those nowhere else.
        for kept in islice(combinations(outputs, count), CHOICES):
            with suppress(WorkbenchError):
                return _resting(search, {**left, **idle, **dict(kept), **asked})
    return None


CHOICES = 6
"""Choices of so many outputs that are tried."""


def _drifting(model: Model, names: Iterable[str]) -> list[str]:
    """Return which of some names are drifting sums; an output of the name comes first."""
    outputs = {q.name for q in model.outputs}
    return [t.name for t in model.traits.sums if t.name in names and t.name not in outputs]


def _checked(model: Model, given: Mapping[str, float] | None) -> dict[str, float]:
    everything = [q.name for q in (*model.inputs, *model.states, *model.outputs)]
    everything += [*_at_nominal(model, model.inputs), *(t.name for t in model.traits.sums)]
    given = dict(given or {})
    sums = _drifting(model, given)
    if len(given) == len(sums):
        given |= _at_nominal(model, model.inputs)
    for name in given:
        check_choice("given quantity", name, dict.fromkeys(everything))
    if len(given) - len(sums) > len(model.inputs):
        raise WorkbenchError(
            f"{len(given)} values are given ({', '.join(given)}); {model.name!r} has"
            f" {len(model.inputs)} input(s) and can hold as many values: drop the others"
        )
    for name, value in given.items():
        check_value(model, name, value)
    return {name: float(value) for name, value in given.items()}


def _with_disturbances(model: Model, given: dict[str, float]) -> dict[str, float]:
    """Hold what nobody commands at its nominal value, as far as the inputs have room for it."""
    room = len(model.inputs) - len(given) if given else 0
    return dict(islice(_undisturbed(model, given).items(), len(given) + max(room, 0)))


def _undisturbed(model: Model, given: dict[str, float]) -> dict[str, float]:
    """Add to given values the nominal ones of all inputs that nobody commands."""
    idle = _idle(model)
    return given | {name: value for name, value in idle.items() if name not in given}


def _at_nominal(model: Model, inputs: Iterable[Input]) -> dict[str, float]:
    """Return the nominal values of inputs, in SI, by the names by which they are given."""
    return {input_named(model, q.name): q.nominal for q in inputs}


def _idle(model: Model) -> dict[str, float]:
    """Return the same of the inputs that nobody commands."""
    return _at_nominal(model, (q for q in model.inputs if not q.commanded))


def check_value(model: Model, name: str, value: float, *, what: str = "") -> None:
    """Check that an input, a state, an output or a sum of a plant can have a value, in SI."""
    check_finite(name, value)
    total = next((t for t in model.traits.sums if t.name == name), None)
    if total is not None:
        unit, si = total.display_unit, total.unit
        lower, upper = model.bound(total.lower), model.bound(total.upper)
    else:
        states = {q.name: q for q in model.states}
        known: dict[str, Quantity] = {input_named(model, q.name): q for q in model.inputs}
        quantity = (states | known | {q.name: q for q in model.outputs})[name]
        unit = shown_in(quantity)
        # The range of a state is that of the laws; a measurement shares it if it shows that state.
        bounded = states[name] if name in _shown_states(model) else quantity
        lower, upper = getattr(bounded, "lower", -math.inf), getattr(bounded, "upper", math.inf)
        si = quantity.unit
    check_range(
        what or (name.replace("_", " ") if total is not None else name),
        from_si(float(value), unit),
        from_si(lower, unit),
        from_si(upper, unit),
        unit,
        fix="" if unit == si else f"values are given in {si}",
    )


def _shown_states(model: Model) -> set[str]:
    """Return the states that an output of the same name shows as they are."""
    x = model.initial_state()
    read = dict(
        zip((q.name for q in model.outputs), model.read(x, model.nominal_input), strict=True)
    )
    return {
        q.name
        for q, value in zip(model.states, x, strict=True)
        if abs(read.get(q.name, value) - value) <= 1e-9 * q.scale
    }


def _conditions(
    model: Model, given: Mapping[str, float], sums: Sequence[DriftingSum]
) -> tuple[Condition, ...]:
    single = [(n, v) for n, v in given.items() if n not in {total.name for total in sums}]
    found = list(conditions_of(model, single))
    for total in sums:
        parts = conditions_of(model, [(name, 0.0) for name, _ in total.weights])
        weights = sum(
            (w * part.weights for (_, w), part in zip(total.weights, parts, strict=True)),
            np.zeros(len(parts[0].weights)),
        )
        found.append(Condition(total.name, weights, given[total.name], total.scale))
    return tuple(found)


def _directions(model: Model, sums: Sequence[DriftingSum]) -> Vector:
    """Return the directions in which the rates may differ from zero: those of drifting sums."""
    names = [q.name for q in model.states]
    directions = np.zeros((len(names), len(sums)))
    for column, total in enumerate(sums):
        for name, weight in total.drifting:
            # The drift is counted in scales of the states, so that it is of the size of the rest.
            i = names.index(name)
            directions[i, column] = weight * model.states[i].scale
    return directions


def _bounds(search: _Search) -> tuple[Vector, Vector]:
    model = search.model
    quantities: list[State | Input] = [*model.states, *model.inputs]
    lower, upper = limits_of(model)
    names = [q.name for q in quantities]
    for name, (low, high) in (search.bounds or {}).items():
        check_choice("bounded quantity", name, names)
        i = names.index(name)
        if math.isnan(low) or math.isnan(high) or max(low, lower[i]) > min(high, upper[i]):
            raise WorkbenchError(
                f"bounds of {name} are {low:g} to {high:g} {quantities[i].unit}; they must overlap"
                f" with {lower[i]:g} to {upper[i]:g} {quantities[i].unit}"
            )
        lower[i], upper[i] = max(low, lower[i]), min(high, upper[i])
    for i in clocks_of(model):
        lower[i] = upper[i] = _long_after(model, model.states[i])
    return lower, upper


def _long_after(model: Model, clock: State) -> float:
    """Return a time, in s, at which everything that happens at a time has happened."""
    own = clock.name.rpartition(".")[0]
    times = [q.value for q in model.parameters if q.name.startswith(f"{own}.") and q.unit == "s"]
    return 10.0 * max([clock.scale, *times])


def _start(
    search: _Search, given: Mapping[str, float], sums: Sequence[DriftingSum]
) -> tuple[Vector, Vector]:
    model, near = search.model, search.near
    names = [q.name for q in model.states]
    shown = _shown_states(model)
    u = model.nominal_input
    for i, quantity in enumerate(model.inputs):
        u[i] = given.get(quantity.name, u[i])
    known = {name: value for name, value in given.items() if name in shown}
    if near is not None and [q.name for q in near.model.states] == names:
        x = near.x.copy()
        for name, value in known.items():
            x[names.index(name)] = value
        return x, near.u.copy()
    x = model.initial_state(known, u=u)
    for total in sums:
        read = dict(zip((q.name for q in model.outputs), model.read(x, u), strict=True))
        missing = given[total.name] - sum(weight * read[name] for name, weight in total.weights)
        for name, weight in total.drifting:
            known[name] = x[names.index(name)] + weight * missing
        x = model.initial_state(known, u=u)
    if _tells_where(model):
        # Of several places of rest, the one where the machine is: an empty reactor rests as well.
        left = [i for i, q in enumerate(model.inputs) if q.name not in given]
        rates, slope = derivatives_of(model, EXACT)(x, u, model.values)
        n, size = len(x), np.array([q.scale for q in model.states])
        at, by = rates[:n] / size, slope[:n, n:][:, left] / size[:, None]
        if np.isfinite(by).all() and np.isfinite(at).all():
            scale = np.array([model.inputs[i].scale for i in left])
            u[left] += scale * np.linalg.lstsq(by * scale, -at, rcond=None)[0]
    return x, u


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


def _asked(problem: Problem) -> str:
    return ", ".join(
        f"{c.label.replace('_', ' ')} {_display(problem.model, c.label, c.value)}"
        for c in problem.conditions
    )


class _NoPointError(WorkbenchError):
    """There is no operating point; what would be possible is worked out when somebody reads it."""

    def __str__(self) -> str:
        if callable(self.args[0]):
            self.args = (self.args[0](),)
        return str(self.args[0])

    def __reduce__(self) -> tuple[type[WorkbenchError], tuple[str]]:
        return WorkbenchError, (str(self),)


def _impossible(problem: Problem, solution: Solution, *, asked: bool) -> str:
    model = problem.model
    advice = f"the {solution.worst} is no number there: divide by nothing that may be zero"
    if math.isfinite(solution.residual):
        advice = what_would_be_possible(problem, solution)
        advice = advice or ("change the given values" if asked else _elsewhere(model))
    return (
        f"there is no operating point of {model.name!r}"
        f"{f' ({model.description})' if model.description else ''} with"
        f" {_asked(problem)}; {advice}"
    )


def _display(model: Model, name: str, value: float) -> str:
    for total in model.traits.sums:
        if name == total.name and name not in {q.name for q in model.outputs}:
            return f"{from_si(value, total.display_unit):g} {total.display_unit}"
    quantity: Quantity = next(
        q for q in (*model.outputs, *model.states, *model.inputs) if q.name == name
    )
    unit = shown_in(quantity)
    return f"{from_si(value, unit):g} {unit}"


def _entry(kind: str, quantity: Quantity, value: float) -> tuple[str, str, float, str]:
    unit = shown_in(quantity)
    # Round-off is not worth reading.
    shown = from_si(float(value), unit) if abs(value) > 1e-12 * quantity.scale else 0.0
    return (kind, quantity.name, float(shown), unit)
