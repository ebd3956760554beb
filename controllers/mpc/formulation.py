"""A linear MPC problem in CasADi symbols: what is predicted, what it costs, what is limited.

Everything is an expression of the moves u, the slack eps, the estimate z = (x, w) of states and
disturbances now, the references over the horizon and the openings before. An opening is a command
as a fraction of its full one:

    x_{j+1} = Phi x_j + Gamma u_block(j) + Omega w,   y_j = C x_j
    cost    = sum_j q (y_j - r_j)^2 + R (u_j - us)^2 + S sum_i (u_i - u_{i-1})^2
              + |x_N - xs|^2_P + softness eps^2
    rows    : the changes of the moves, then the limited outputs + eps and - eps

Of several followed outputs and openings, the sums are over all of them.

A design hands its `Formulation` to a function of the user's, which may return another one: another
cost, other limits. `condensed` reads the matrices of the quadratic program off it, whatever it is,
as long as the cost is quadratic and the rows are linear.

Source: Maciejowski, Predictive Control with Constraints, 2002, chapters 2 and 3; Andersson et al.,
CasADi, Math. Programming Computation 11, 2019.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from workbench.arrays import Matrix, Vector
from workbench.errors import WorkbenchError
from workbench.registry import user_code

LINEAR = 1e-9
"""What rounding may leave of a part that has to vanish, relative to the rest."""


@dataclass(frozen=True, eq=False)
class Formulation:
    """A linear MPC problem in symbols; openings are deviations from the operating point.

    Args:
        symbols: Moves, slack, estimate, references and openings before, one below the other, in
            their units.
        moves: Blocked moves u, those of a block together, shape (n_u,), fractions.
        slack: Slack eps, in the unit of the limited outputs' rows.
        estimate: States and disturbances now, shape (n_z,), in SI.
        path: References over the horizon, one behind the other, shape (N * n_followed,),
            deviations in SI.
        before: Openings before, shape (n_openings,), fractions.
        states: Predicted states, shape (n_x, N), in SI.
        outputs: Predicted outputs, followed ones first, shape (n_followed + n_limited, N), in SI.
        openings: Openings over the horizon, shape (N, n_openings), fractions.
        cost: What is minimised, dimensionless.
        rows: What is limited beside the variables, shape (m,), fractions and the slack's unit; the
            first ones are the changes of the openings from those before, which nothing else
            depends on.
        lower: Lower limits of the rows, shape (m,), in their units.
        upper: Upper limits of the rows, shape (m,), in their units.
        numbers: Symbols in the place of numbers of plant and weights, in SI; none by default.
    """

    symbols: ca.MX
    moves: ca.MX
    slack: ca.MX
    estimate: ca.MX
    path: ca.MX
    before: ca.MX
    states: ca.MX
    outputs: ca.MX
    openings: ca.MX
    cost: ca.MX
    rows: ca.MX
    lower: Matrix
    upper: Matrix
    numbers: tuple[ca.MX, ...] = ()


ENDLESS = 1e9
"""Where a row without a limit is taken to have one, in its unit."""

CHECKED = 2
"""Every which prediction sample outputs are limited: pressures do not jump within 20 ms."""

Change = Callable[[Formulation], Formulation]
"""What a user makes of a formulation."""


@dataclass(frozen=True)
class Form:
    """What of a linear MPC problem is no number in its expressions.

    Args:
        blocks: Lengths of the moves, in prediction samples.
        limited: Number of limited outputs.
        slack_scale: Unit of the slack, in SI.
        softness: Cost of a violation by it, dimensionless.
    """

    blocks: tuple[int, ...]
    limited: int
    slack_scale: float
    softness: float


@lru_cache(maxsize=16)
def usual(shapes: tuple[tuple[int, ...], ...], form: Form) -> Formulation:
    """Return the problem of symbols in the place of numbers of these shapes."""
    return formulated(tuple(ca.MX.sym("", *shape) for shape in shapes), form)


def formulated(
    numbers: Sequence[Any], form: Form, limits: tuple[Vector, Vector] | None = None
) -> Formulation:
    """Write down a linear MPC problem, in SI, as `controllers.mpc.prediction.condense` has it.

    Args:
        numbers: phi and gamma over a prediction sample for z = (x, w), whose last entries are
            disturbances, shapes (n_z, n_z) and (n_z, m); C, shape (p + n_limited, n_x); (xs, us)
            per (w, r), shape (n_x + m, n_w + p); P, shape (n_x, n_x); and the weights of errors,
            shape (p,), openings and changes of openings, shape (m,). Numbers, or symbols of them.
        limits: Lower and upper limits of the rows.
    """
    known = [part if isinstance(part, ca.MX) else ca.DM(part) for part in numbers]
    phi, gamma, C, target, cost_to_go, *weights = known
    blocks = form.blocks
    (n_z, m), N, p = gamma.shape, sum(blocks), weights[0].numel()
    n_u, n_x = m * len(blocks), cost_to_go.shape[0]
    q, r, s = (ca.sqrt(part) for part in weights)
    symbols = ca.MX.sym(_SYMBOLS, n_u + 1 + n_z + N * p + m)
    ends = np.cumsum([0, n_u, 1, n_z, N * p, m]).tolist()
    moves, slack, estimate, path, before = ca.vertsplit(symbols, ends)

    each = ca.vertsplit(moves, m)
    openings = ca.vcat([ca.repmat(each[i].T, length, 1) for i, length in enumerate(blocks)])
    z, states = estimate, []
    for j in range(N):
        z = ca.mtimes(phi, z) + ca.mtimes(gamma, openings[j, :].T)
        states.append(z[:n_x])
    states = ca.hcat(states)
    outputs = ca.mtimes(C, states)

    wanted = ca.reshape(path, N, p)
    at_rest = ca.mtimes(target, ca.vertcat(estimate[n_x:], wanted[-1, :].T))
    end = states[:, -1] - at_rest[:n_x]
    changes = moves - ca.vertcat(before, moves[:-m])
    cost = (
        ca.sumsqr((outputs[:p, :].T - wanted) * ca.repmat(q.T, N, 1))
        + ca.sumsqr((openings - ca.repmat(at_rest[n_x:].T, N, 1)) * ca.repmat(r.T, N, 1))
        + ca.sumsqr(changes * ca.repmat(s, len(blocks), 1))
        + ca.bilin(cost_to_go, end, end)
        + form.softness * slack**2
    )
    limited = [ca.vec(outputs[p + i, ::CHECKED]) / form.slack_scale for i in range(form.limited)]
    soft = ca.vcat(limited) if limited else ca.MX(0, 1)
    rows = ca.vertcat(changes, soft + slack, soft - slack)
    lower, upper = limits or np.zeros((2, rows.numel()))
    return Formulation(
        symbols,
        moves,
        slack,
        estimate,
        path,
        before,
        states,
        outputs,
        openings,
        cost,
        rows,
        lower,
        upper,
        tuple(part for part in known if isinstance(part, ca.MX)),
    )


def changed_by(change: Change, problem: Formulation) -> Formulation:
    """Return what a user's function makes of a problem.

    Raises:
        WorkbenchError: If it fails, or returns no problem, one with other symbols, or limits of
            other lengths than its rows.
    """
    with user_code("change of an MPC's problem"):
        found = change(problem)
    if not isinstance(found, Formulation):
        raise WorkbenchError(
            f"change of an MPC's problem returns a {type(found).__name__}; return the Formulation,"
            " as replace(problem, cost=...) of dataclasses does"
        )
    foreign = [
        symbol.name()
        for symbol in ca.symvar(ca.vertcat(found.cost, found.rows))
        if symbol.name() != _SYMBOLS
    ]
    if foreign:
        raise WorkbenchError(
            f"cost or rows of an MPC's changed problem hold {', '.join(foreign)}, which nothing"
            " gives a value; write numbers, or moves, slack, estimate, path and before"
        )
    lower, upper = (np.asarray(ca.DM(ends)).ravel() for ends in (found.lower, found.upper))
    if not len(lower) == len(upper) == found.rows.numel():
        raise WorkbenchError(
            f"an MPC's changed problem has {found.rows.numel()} rows, {len(lower)} lower and"
            f" {len(upper)} upper limits; give each row one of both, 1e9 for none"
        )
    return replace(found, lower=lower, upper=upper)


_SYMBOLS = "symbols"


def limits_of(
    form: Form, move_limit: Vector, output_limits: Sequence[tuple[float, float]]
) -> tuple[Vector, Vector]:
    """Return lower and upper limits of the rows, in their units.

    Args:
        move_limit: Largest changes of the openings, shape (n_u,), fractions.
        output_limits: Lowest and highest value of each limited output, deviations in SI.
    """
    checked = len(range(0, sum(form.blocks), CHECKED))
    low, high = (
        np.repeat([ends[i] / form.slack_scale for ends in output_limits], checked) for i in (0, 1)
    )
    low, high = np.maximum(low, -ENDLESS), np.minimum(high, ENDLESS)
    endless = np.full(len(low), ENDLESS)
    lower = np.concatenate([-move_limit, low, -endless])
    return lower, np.concatenate([move_limit, endless, high])


@lru_cache(maxsize=16)
def _slopes_and_rows(problem: Formulation) -> ca.Function:
    count = problem.moves.numel() + 1
    slopes = ca.gradient(problem.cost, problem.symbols)[:count]
    both = ca.vertcat(slopes, problem.rows)
    return ca.Function("condensed", [problem.symbols, *problem.numbers], [both])


def condensed(
    problem: Formulation, numbers: Sequence[Matrix] = ()
) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix, Matrix]:
    """Return the matrices of the quadratic program of a formulation.

    Args:
        numbers: What stands in the place of its symbols for numbers.

    Returns:
        H, gradients per estimate, per references and per openings before, rows per variable and
        per estimate, in the units of the problem.

    Raises:
        WorkbenchError: If the cost is not quadratic, the rows are not linear, or they hold what the
            program cannot: constants, or the openings before in other rows than the first.
    """
    sizes = [part.numel() for part in (problem.moves, problem.slack, problem.estimate)]
    n_u, _, n_z = sizes
    n, N, m = n_u + 1, problem.path.numel(), problem.before.numel()
    count = problem.symbols.numel()
    # Linear in the symbols: the columns are the values at unit vectors; two points more tell.
    doubled = -2.0 * np.column_stack([np.arange(count) < n, np.ones(count)])
    points = np.hstack([np.zeros((count, 1)), np.eye(count), doubled])
    shared = list(range(1, 1 + len(numbers)))
    many = _slopes_and_rows(problem).map("many", "serial", points.shape[1], shared, [])
    values = many(points, *numbers).full()
    origin, table = values[:, 0], values[:, 1:-2] - values[:, :1]
    for point, value, part in zip(doubled.T, values[:, -2:].T, (n, count), strict=True):
        size = np.abs(table[:, :part]).sum(axis=1) + np.abs(origin)
        if np.any(np.abs(value - origin - table @ point) > LINEAR * size):
            raise WorkbenchError(
                "the cost of a linear MPC is not quadratic, or a row is not linear; give sums of"
                " squares and linear rows"
            )
    size = np.abs(table[:, :n]).sum(axis=1)
    per_before = table[:, -m:]
    first = -np.eye(len(table) - n, m)
    if (
        np.any(np.abs(origin) > LINEAR * size)
        or np.any(np.abs(per_before[n:] - first) > LINEAR * size[n:, None])
        or np.any(np.abs(table[n:, n + n_z : -m]) > LINEAR)
    ):
        raise WorkbenchError(
            "the cost or a row of a linear MPC has a part that the quadratic program does not"
            " hold: a constant, the reference in a row, or the opening before in another row than"
            " the first; put constants into the limits"
        )
    H = 0.5 * (table[:n, :n] + table[:n, :n].T)
    return (
        H,
        table[:n, n : n + n_z],
        table[:n, n + n_z : n + n_z + N],
        per_before[:n],
        table[n:, :n],
        table[n:, n : n + n_z],
    )
