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

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from workbench.arrays import Matrix, Vector
from workbench.errors import WorkbenchError

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


Change = Callable[[Formulation], Formulation]
"""What a user makes of a formulation."""


def formulated(
    phi: Matrix,
    gamma: Matrix,
    C: Matrix,
    *,
    disturbances: int,
    target: Matrix,
    cost_to_go: Matrix,
    weights: tuple[Vector, Vector, Vector],
    blocks: tuple[int, ...],
    move_limit: Vector,
    output_limits: tuple[tuple[float, float], ...],
    slack_scale: float,
    softness: float,
) -> Formulation:
    """Write down a linear MPC problem, in SI, as `controllers.mpc.prediction.condense` has it.

    phi and gamma hold over a prediction sample for z = (x, w), whose last entries are disturbances;
    ``target`` is (xs, us) per (w, r), shape (n_x + m, n_w + p), ``cost_to_go`` P, shape (n_x, n_x).
    """
    (n_z, m), N, p = gamma.shape, sum(blocks), len(weights[0])
    n_u, n_x = m * len(blocks), n_z - disturbances
    q, r, s = (ca.sqrt(ca.DM(part)) for part in weights)
    symbols = ca.MX.sym("symbols", n_u + 1 + n_z + N * p + m)
    ends = np.cumsum([0, n_u, 1, n_z, N * p, m]).tolist()
    moves, slack, estimate, path, before = ca.vertsplit(symbols, ends)

    each = ca.vertsplit(moves, m)
    openings = ca.vcat([ca.repmat(each[i].T, length, 1) for i, length in enumerate(blocks)])
    phi, gamma = ca.DM(phi), ca.DM(gamma)
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
        + softness * slack**2
    )
    # Every other prediction sample is enough: pressures do not jump within 20 ms.
    checked = range(0, N, 2)
    limited = [ca.vec(outputs[p + i, ::2]) / slack_scale for i in range(len(output_limits))]
    soft = ca.vcat(limited) if limited else ca.MX(0, 1)
    low, high = (
        np.repeat([limits[i] / slack_scale for limits in output_limits], len(checked))
        for i in (0, 1)
    )
    endless = np.full(len(low), 1e9)
    steps = np.asarray(move_limit, dtype=float)
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
        rows=ca.vertcat(changes, soft + slack, soft - slack),
        lower=np.concatenate([-steps, low, -endless]),
        upper=np.concatenate([steps, endless, high]),
    )


def condensed(problem: Formulation) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix, Matrix]:
    """Return the matrices of the quadratic program of a formulation.

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
    slopes = ca.gradient(problem.cost, problem.symbols)[:n]
    both = ca.Function("condensed", [problem.symbols], [ca.vertcat(slopes, problem.rows)])
    count = problem.symbols.numel()
    # Linear in the symbols: the columns are the values at unit vectors; two points more tell.
    doubled = -2.0 * np.column_stack([np.arange(count) < n, np.ones(count)])
    points = np.hstack([np.zeros((count, 1)), np.eye(count), doubled])
    values = both.map(points.shape[1])(points).full()
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
