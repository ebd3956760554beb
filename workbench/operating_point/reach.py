"""What a trim could reach when it cannot reach what was asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from workbench.model.quantities import shown_in
from workbench.model.traits import bound_value
from workbench.model.units import from_si, shown_unit
from workbench.operating_point.trim import Problem, Solution, limits_of, solve

_GRID = 13
_BISECTIONS = 7


def what_would_be_possible(problem: Problem, failed: Solution) -> str:
    """Say which values of each given quantity and each chosen parameter would have a solution.

    Changes one of them at a time, over its range, and keeps the others as asked.
    """
    clauses = []
    for name, unit, lower, upper, changed in _alternatives(problem):
        interval = _solvable(changed, lower, upper, failed)
        if interval is not None:
            low, high = (from_si(value, unit) for value in interval)
            clauses.append(f"{name} from {_short(low)} to {_short(high)} {unit}")
    if not clauses:
        return "change the given values"
    return "with the rest as asked, possible would be " + ", or ".join(clauses)


def _alternatives(
    problem: Problem,
) -> Iterator[tuple[str, str, float, float, Callable[[float], Problem]]]:
    """Yield name, unit, range and the changed problem for everything that could be different."""
    model = problem.model
    measurements = {q.name: q for q in model.outputs}
    bounded = {
        q.name: (low, high, shown_in(q))
        for q, low, high in zip(
            (*model.states, *model.inputs), problem.lower, problem.upper, strict=True
        )
    }
    values = {q.name: q.value for q in model.parameters}
    sums = {total.name: total for total in model.traits.sums}
    for i, condition in enumerate(problem.conditions):
        if condition.label in sums and condition.label not in measurements:
            total = sums[condition.label]
            low, high = bound_value(total.lower, values), bound_value(total.upper, values)
            unit = total.display_unit
        elif condition.label in measurements:
            quantity = measurements[condition.label]
            low, high, unit = quantity.lower, quantity.upper, quantity.display_unit
            if math.isinf(high) and condition.label in bounded:
                low, high, _ = bounded[condition.label]
        else:
            low, high, unit = bounded[condition.label]
        if math.isfinite(low) and math.isfinite(high):

            def with_value(value: float, i: int = i) -> Problem:
                conditions = list(problem.conditions)
                conditions[i] = replace(conditions[i], value=value)
                return replace(problem, conditions=tuple(conditions))

            yield condition.label.replace("_", " "), unit, low, high, with_value
    for parameter in model.parameters:
        if parameter.name in model.traits.choices:

            def with_parameter(value: float, name: str = parameter.name) -> Problem:
                changed = model.with_parameters({name: value})
                # The limits of states move along with a parameter that they depend on.
                before, after = limits_of(model)[1], limits_of(changed)[1]
                moved = np.where(np.isfinite(before), after, 0.0)
                moved -= np.where(np.isfinite(before), before, 0.0)
                return replace(problem, model=changed, upper=problem.upper + moved)

            name = parameter.name.replace("_", " ")
            unit = shown_unit(parameter.unit)
            yield name, unit, parameter.lower, parameter.upper, with_parameter


def _solvable(
    changed: Callable[[float], Problem], lower: float, upper: float, failed: Solution
) -> tuple[float, float] | None:
    """Return the interval of values that can be solved, or None; it is searched on a grid."""
    reached: dict[float, Solution] = {}

    def works(value: float) -> bool:
        problem = changed(value)
        start = min(reached.items(), key=lambda item: abs(item[0] - value), default=(0.0, failed))[
            1
        ]
        solution = solve(problem, start.x, start.u, robust=False)
        if solution.solved:
            reached[value] = solution
        return solution.solved

    grid = np.linspace(lower, upper, _GRID)
    solved = [value for value in grid.tolist() if works(value)]
    if not solved:
        return None
    ends = []
    for end, step in ((solved[0], -1), (solved[-1], 1)):
        inside, outside = end, float(np.clip(end + step * (grid[1] - grid[0]), lower, upper))
        for _ in range(_BISECTIONS if inside != outside else 0):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if works(middle) else (inside, middle)
        ends.append(inside)
    return ends[0], ends[1]


def _short(value: float) -> str:
    return f"{value:.3g}"
