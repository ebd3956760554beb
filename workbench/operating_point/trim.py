"""The trim itself: a scaled Newton method with bounds, regularised first, then exact.

Unknown are all states, all inputs and, where one is allowed, the drift. Each step is the shortest
one in scaled variables, so that whatever the equations leave open stays where the search started.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.arrays import Vector
from workbench.model import EXACT, REGULARISED, Form, Input, Model, State
from workbench.model.quantities import shown_in
from workbench.model.units import from_si, same_dimension, shown_unit
from workbench.operating_point.derivatives import derivatives_of

RESIDUAL_TOLERANCE = 1e-8
"""Largest residual: of a rate relative to what states and inputs make of it when each moves by its
scale, of a measurement relative to its scale."""

_MAX_STEPS = 60
_SINGULAR = 1e-10


@dataclass(frozen=True)
class Condition:
    """One value that the trim has to meet: a weighted sum of measurements, states and inputs.

    Args:
        weights: Weights of measurements, states and inputs, in this order, shape (n_y + n_x +
            n_u,), in SI units of the condition per unit of each.
        value: What the sum has to be, in SI.
        scale: Typical size of the sum, in SI.
    """

    label: str
    weights: Vector
    value: float
    scale: float


@dataclass(frozen=True)
class Problem:
    """What a trim has to solve.

    Args:
        drifting: Directions in which the rates may differ from zero, shape (n_x, n_drift), in SI
            per unit of drift.
        lower: Smallest states and inputs, shape (n_x + n_u,), in SI.
        upper: Largest states and inputs, shape (n_x + n_u,), in SI.
    """

    model: Model
    conditions: tuple[Condition, ...]
    drifting: Vector
    lower: Vector
    upper: Vector


@dataclass(frozen=True)
class Solution:
    """What a trim found, whether or not it is good enough.

    Args:
        x: States, shape (n_x,), in SI.
        u: Inputs, shape (n_u,), in SI.
        residual: Largest remaining error, relative to the scales.
        worst: Name of the equation that the error is in.
        condition_number: Ratio of the largest to the smallest singular value of the scaled
            equations, dimensionless, without what they leave open.
        undetermined: States and inputs that the equations leave open.
    """

    x: Vector
    u: Vector
    residual: float
    worst: str
    condition_number: float
    undetermined: tuple[str, ...]
    steps: int

    @property
    def solved(self) -> bool:
        """Whether the residual is within tolerance."""
        return self.residual <= RESIDUAL_TOLERANCE


def solve(problem: Problem, x: Vector, u: Vector, *, robust: bool = True) -> Solution:
    """Solve a trim from a starting point.

    Args:
        x: States to start from, shape (n_x,), in SI.
        u: Inputs to start from, shape (n_u,), in SI.
        robust: Whether to fall back to a bounded least-squares search where Newton's method ends
            outside its tolerance.
    """
    exact = _Equations(problem, EXACT, rate_sizes(problem.model, x, u))
    # The search weighs all rates alike, lest the fastest lead it; each is judged as it is.
    own = exact.size[: exact.n_x]
    alike = own * (np.median(exact.rate_size / own) if exact.n_x else 1.0)
    even, rounded = (_Equations(problem, form, alike) for form in (EXACT, REGULARISED))

    def finished(z: Vector) -> tuple[Vector, int]:
        near, first = even.newton(z)
        last, more = exact.newton(near)
        return last, first + more

    z0 = exact.scaled(x, u)
    z, steps = finished(z0)
    if exact.error(z) > RESIDUAL_TOLERANCE:
        # The rounded kinks guide the search, the exact equations then finish it.
        start, more = rounded.newton(z0)
        better, last = finished(start)
        steps += more + last
        if exact.error(better) < exact.error(z):
            z = better
    if robust and RESIDUAL_TOLERANCE < exact.error(z) < math.inf:
        better, more = finished(rounded.least_squares(z))
        steps += more
        if exact.error(better) < exact.error(z):
            z = better
    return exact.solution(z, steps)


def rate_sizes(model: Model, x: Vector, u: Vector) -> Vector:
    """Return what each rate is when one state or input moves by its scale, in SI per second.

    A rate that nothing moves there has the pace of the fastest.
    """
    own = np.array([q.scale for q in model.states])
    unknowns = np.concatenate([own, [q.scale for q in model.inputs]])
    slope = derivatives_of(model, EXACT)(x, u, model.values)[1][: len(own)] * unknowns
    found = np.abs(np.where(np.isfinite(slope), slope, 0.0)).max(axis=1, initial=0.0)
    pace = float(np.max(found / own, initial=0.0)) or 1.0
    return np.asarray(np.where(found > 0.0, found, pace * own))


class _Equations:
    """The equations of a trim on one form, in scaled variables."""

    def __init__(self, problem: Problem, form: Form, rate_size: Vector) -> None:
        self.problem = problem
        model = problem.model
        self.at = derivatives_of(model, form)
        self.p = model.values
        self.n_x, self.n_u = len(model.states), len(model.inputs)
        drifts = problem.drifting.shape[1]
        own = [q.scale for q in (*model.states, *model.inputs)]
        self.size = np.array(own + drifts * [1.0])
        self.lower = np.append(problem.lower, np.full(drifts, -np.inf)) / self.size
        self.upper = np.append(problem.upper, np.full(drifts, np.inf)) / self.size
        self.rate_size = rate_size
        self.weights = np.array([c.weights for c in problem.conditions]).reshape(
            len(problem.conditions), len(model.outputs) + self.n_x + self.n_u
        )
        self.wanted = np.array([c.value for c in problem.conditions])
        self.wanted_size = np.array([c.scale for c in problem.conditions])
        self.n_y = len(model.outputs)
        self.ticking = np.zeros(self.n_x)
        for i, rate in clocks_of(model).items():
            self.ticking[i] = rate

    def scaled(self, x: Vector, u: Vector) -> Vector:
        z = np.concatenate([x, u, np.zeros(self.problem.drifting.shape[1])]) / self.size
        return np.asarray(np.clip(z, self.lower, self.upper))

    @np.errstate(over="ignore", invalid="ignore")
    def evaluate(self, z: Vector) -> tuple[Vector, Vector]:
        """Return the scaled errors and their derivatives by the scaled unknowns."""
        full = z * self.size
        x, u = full[: self.n_x], full[self.n_x : self.n_x + self.n_u]
        values, jacobian = self.at(x, u, self.p)
        rates, measurements = values[: self.n_x], values[self.n_x :]
        error = (rates - self.ticking) / self.rate_size
        slope = jacobian[: self.n_x] / self.rate_size[:, None]
        drifting = self.problem.drifting / self.rate_size[:, None]
        error = error - drifting @ full[self.n_x + self.n_u :]
        slope = np.column_stack([slope, -drifting])
        if len(self.wanted):
            everything = np.concatenate([measurements, x, u])
            of_y, of_z = self.weights[:, : self.n_y], self.weights[:, self.n_y :]
            met = (self.weights @ everything - self.wanted) / self.wanted_size
            rows = (of_y @ jacobian[self.n_x :] + of_z) / self.wanted_size[:, None]
            rows = np.column_stack([rows, np.zeros((len(rows), drifting.shape[1]))])
            error, slope = np.concatenate([error, met]), np.vstack([slope, rows])
        return error, slope * self.size

    def error(self, z: Vector) -> float:
        worst = np.max(np.abs(self.evaluate(z)[0]), initial=0.0)
        return float(worst) if np.isfinite(worst) else float("inf")

    @np.errstate(over="ignore", invalid="ignore")  # a step too far is halved
    def newton(self, z: Vector) -> tuple[Vector, int]:
        """Take damped shortest steps inside the bounds until nothing improves.

        Where the equations have no numbers, none is taken.
        """
        error, slope = self.evaluate(z)
        if not (np.isfinite(error).all() and np.isfinite(slope).all()):
            return z, 0
        cost = float(error @ error)
        for steps in range(_MAX_STEPS):
            if np.max(np.abs(error), initial=0.0) <= 1e-3 * RESIDUAL_TOLERANCE:
                return z, steps
            step = self._step(z, error, slope)
            for halving in range(12):
                trial = np.clip(z + step * 0.5**halving, self.lower, self.upper)
                new_error, new_slope = self.evaluate(trial)
                new_cost = float(new_error @ new_error)
                if np.isfinite(new_cost) and np.isfinite(new_slope).all() and new_cost < cost:
                    break
            else:
                return z, steps
            stalled = new_cost > 0.999 * cost and new_cost > RESIDUAL_TOLERANCE**2
            z, error, slope, cost = trial, new_error, new_slope, new_cost
            if stalled:
                return z, steps
        return z, _MAX_STEPS

    def _step(self, z: Vector, error: Vector, slope: Vector) -> Vector:
        """Return the shortest step that solves the linearised equations inside the bounds."""
        step = np.zeros_like(z)
        free = np.ones(len(z), dtype=bool)
        # Unknowns that stand on a bound and want to leave it are held, at most all but one.
        for _ in range(len(z)):
            solved = np.linalg.lstsq(slope[:, free], -error, rcond=_SINGULAR)[0]
            step[:] = 0.0
            step[free] = solved
            leaving = free & (
                ((z <= self.lower) & (step < 0.0)) | ((z >= self.upper) & (step > 0.0))
            )
            if not leaving.any():
                return step
            free &= ~leaving
            if not free.any():
                break
        return step

    def least_squares(self, z: Vector) -> Vector:
        """Search with a trust region, which is slower and more robust."""
        from scipy.optimize import least_squares

        # It asks far beyond where the equations have numbers.
        with np.errstate(over="ignore", invalid="ignore"):
            found = least_squares(
                lambda v: self.evaluate(v)[0],
                np.clip(z, self.lower, self.upper),
                jac=lambda v: self.evaluate(v)[1],
                bounds=(self.lower - 1e-12, self.upper + 1e-12),
                x_scale=1.0,
                xtol=1e-12,
                ftol=1e-12,
                gtol=1e-12,
                max_nfev=100,
            )
        return np.asarray(np.clip(found.x, self.lower, self.upper), dtype=float)

    def solution(self, z: Vector, steps: int) -> Solution:
        error, slope = self.evaluate(z)
        names = [q.name for q in (*self.problem.model.states, *self.problem.model.inputs)]
        labels = [f"rate of {q.name}" for q in self.problem.model.states]
        labels += [c.label for c in self.problem.conditions]
        singular, right = _singular_values(slope)
        kept = singular[singular > _SINGULAR * singular[0]]
        null = right[len(kept) :]
        open_ = tuple(
            name
            for name, share, free in zip(
                names, np.sqrt((null**2).sum(axis=0)), self.lower < self.upper, strict=False
            )
            if share > 0.1 and free
        )
        full = z * self.size
        worst = int(np.argmax(np.abs(error)))
        return Solution(
            x=full[: self.n_x],
            u=full[self.n_x : self.n_x + self.n_u],
            residual=float(np.abs(error[worst])),
            worst=labels[worst],
            condition_number=float(kept[0] / kept[-1]) if len(kept) else math.inf,
            undetermined=open_,
            steps=steps,
        )


def _singular_values(slope: Vector) -> tuple[Vector, Vector]:
    slope = np.where(np.isfinite(slope), slope, 0.0)
    # Rows scaled to length one: a row's size is a matter of its unit, not of conditioning.
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    _, singular, right = np.linalg.svd(slope / np.where(length > 0.0, length, 1.0))
    return singular, right


def conditions_of(
    model: Model, given: Sequence[tuple[str, float]], *, states_first: bool = False
) -> tuple[Condition, ...]:
    """Turn given values, in SI, into conditions: of measurements, inputs, then states by name."""
    everything = [*model.outputs, *model.states, *model.inputs]
    names = [q.name for q in everything]
    read, states = len(model.outputs), len(model.states)
    # Of a name that several have, the first place counts that is looked at.
    order = [*range(read), *range(read + states, len(names)), *range(read, read + states)]
    places = {names[i]: i for i in reversed(order)}
    places |= {f"{_OF_INPUTS}{names[i]}": i for i in range(read + states, len(names))}
    if states_first:
        places |= {names[i]: i for i in range(read, read + states)}
    found = []
    for name, value in given:
        index = places[name]
        weights = np.zeros(len(names))
        weights[index] = 1.0
        found.append(Condition(name, weights, float(value), everything[index].scale))
    return tuple(found)


_OF_INPUTS = "u."


def input_named(model: Model, name: str) -> str:
    """Return the name by which the value of an input is given at rest.

    It is its own, but where a measurement has that too and would be meant: a command of a blade's
    pitch, and what its sensor reads.
    """
    return f"{_OF_INPUTS}{name}" if any(q.name == name for q in model.outputs) else name


def clocks_of(model: Model) -> dict[int, float]:
    """Return the rates, in SI per second, of times that go on whatever happens, by their place.

    Nothing rests at a time, but everything else may: before what happens at a time, or after it.
    """
    timed = [i for i, q in enumerate(model.states) if same_dimension(q.unit, "s")]
    rates = {i: model.exact.rates[i] for i in timed}
    return {i: float(r) for i, r in rates.items() if r.is_constant() and float(r) != 0.0}


def limits_of(model: Model) -> tuple[Vector, Vector]:
    """Return the smallest and largest states and inputs, each of shape (n_x + n_u,), in SI."""
    quantities: list[State | Input] = [*model.states, *model.inputs]
    lower = np.array([q.lower for q in quantities], dtype=np.float64)
    upper = np.array([q.upper for q in quantities], dtype=np.float64)
    names = [q.name for q in quantities]
    for name, low, high in model.traits.limits:
        i = names.index(name)
        lower[i] = max(lower[i], model.bound(low))
        upper[i] = min(upper[i], model.bound(high))
    return lower, upper


_GRID = 13
_BISECTIONS = 7


def what_would_be_possible(problem: Problem, failed: Solution) -> str:
    """Say which values of each given quantity and each chosen parameter would have a solution.

    Changes one of them at a time, over its range, and keeps the others as asked. Nothing is said
    where none has.
    """
    clauses = []
    for name, unit, lower, upper, changed in _alternatives(problem):
        interval = _solvable(changed, lower, upper, failed)
        if interval is not None:
            low, high = (from_si(value, unit) for value in interval)
            clauses.append(f"{name} from {_short(low)} to {_short(high)} {unit}")
    return "with the rest as asked, possible would be " + ", or ".join(clauses) if clauses else ""


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
    sums = {total.name: total for total in model.traits.sums}
    for i, condition in enumerate(problem.conditions):
        if condition.label in sums and condition.label not in measurements:
            total = sums[condition.label]
            low, high = model.bound(total.lower), model.bound(total.upper)
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
