"""The condensed problem of a linear MPC: states eliminated, moves blocked.

With z = (x, w) the states and disturbances now, u the blocked moves and j = 1..N,

    y_j = C Phi^j z + sum_i C Phi^(j-1-i) Gamma u_block(i)

so that cost and constraints become a small dense quadratic program in the moves and one slack.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from controllers.mpc.formulation import (
    Change,
    Form,
    changed_by,
    condensed,
    formulated,
    limits_of,
    usual,
)
from controllers.quadratic_program.solver import Factored, factored
from controllers.riccati import regulator
from workbench.arrays import Matrix, Vector, product
from workbench.errors import WorkbenchError
from workbench.linearisation.zero_order_hold import zero_order_hold

SLACK_SCALE = 1e4
"""The slack is counted in 0.1 bar, so that the variables of the problem are of one size."""

_LEAST = 1e-12
"""Weight of each state, over that of the outputs, with which a regulator exists."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Matrices of the condensed problem; openings are deviations from the operating point.

    The variables are the moves (fractions of the full openings), those of a block together, and the
    slack. There are k openings and p followed outputs.

    Args:
        H: Hessian, shape (n, n), dimensionless.
        g_estimate: Gradient per estimate (x, w), shape (n, n_z), per SI.
        g_reference: Gradient per deviation of the references, one behind the other, shape
            (n, N * p), per SI.
        g_before: Gradient per openings before, shape (n, k), per fraction.
        A: Rows of the constraints, shape (m, n): first the changes of the openings (fractions),
            then the limited outputs (in units of the slack's).
        rows_estimate: Part of the rows that the estimate decides, shape (m, n_z), in the units of
            the rows per SI.
        lower: Lower limits of rows, then of variables, shape (m + n,), in their units.
        upper: Upper limits of rows, then of variables, shape (m + n,), in their units.
        gain: Regulator K, shape (k, n_x), fractions per SI.
        target: (xs, us) per (w, r), shape (n_x + k, n_w + p), in SI.
        preview_index: Sample of the controller at which each prediction sample lies.
        slack_scale: Unit of the slack, in that of the limited outputs.
    """

    H: Matrix
    g_estimate: Matrix
    g_reference: Matrix
    g_before: Matrix
    A: Matrix
    rows_estimate: Matrix
    lower: Matrix
    upper: Matrix
    gain: Matrix
    target: Matrix
    preview_index: tuple[int, ...]
    slack_scale: float = SLACK_SCALE

    @property
    def samples(self) -> int:
        """Number N of prediction samples."""
        return len(self.preview_index)

    @property
    def size(self) -> tuple[int, int]:
        """Numbers of variables and of rows."""
        return len(self.H), len(self.A)

    @cached_property
    def factors(self) -> Factored:
        """The factored matrices, for problems whose matrices do not change."""
        return factored(self.H, self.A)

    def regulator(self, estimate: Matrix, reference: Matrix) -> Matrix:
        """Return the unconstrained regulator's openings, ``us - K (x - xs)``, shape (k,).

        They are fractions; the estimate (x, w), shape (n_z,), and the references, shape (p,), are
        deviations in SI.
        """
        n = self.gain.shape[1]
        at_rest = product(self.target, np.append(estimate[n:], reference))
        return np.asarray(at_rest[n:] - product(self.gain, estimate[:n] - at_rest[:n]))


def condense(
    A: Matrix,
    B: Matrix,
    E: Matrix,
    C: Matrix,
    *,
    weights: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike],
    prediction_time: float,
    sample_time: float,
    blocks: tuple[int, ...],
    opening_limits: tuple[npt.ArrayLike, npt.ArrayLike],
    move_limit: npt.ArrayLike,
    output_limits: tuple[tuple[float, float], ...],
    softness: float,
    slack_scale: float = SLACK_SCALE,
    change: Change | None = None,
) -> Prediction:
    """Eliminate the states of a linear MPC problem, which `controllers.mpc.formulation` states.

    Args:
        A: Dynamics, shape (n_x, n_x), in SI.
        B: Effect of the openings, shape (n_x, k), in SI.
        E: Effect of the disturbances, shape (n_x, n_w), in SI.
        C: Followed outputs, then the limited ones, shape (p + n_limited, n_x), in SI.
        weights: Weights of the errors of the followed outputs, shape (p,), per SI squared; of
            openings and of changes of openings, shape (k,), dimensionless.
        prediction_time: Time between prediction samples, in s.
        sample_time: Time between samples of the controller, in s.
        blocks: Lengths of the moves, in prediction samples.
        opening_limits: Lowest and highest openings, shape (k,), deviations, fractions.
        move_limit: Largest changes of the openings from block to block, shape (n_blocks * k,),
            fractions; one number holds for all, as of the weights and limits.
        output_limits: Lowest and highest value of each limited output, deviations in SI.
        softness: Cost of a violation by the slack's unit, dimensionless.
        slack_scale: The slack's unit, in that of the limited outputs.
        change: What the user makes of the formulation; nothing by default.

    Raises:
        WorkbenchError: If the regulator's Riccati equation has no solution or the followed outputs
            cannot be led to references.

    Source:
        Maciejowski, Predictive Control with Constraints, 2002, sections 2.6 and 3.1.
    """
    (n_x, k), n_w, N = B.shape, E.shape[1], sum(blocks)
    q = np.atleast_1d(np.asarray(weights[0], dtype=float))
    r, s = (np.broadcast_to(np.asarray(part, dtype=float), k) for part in weights[1:])
    p = len(q)
    joined = np.block([[A, E], [np.zeros((n_w, n_x + n_w))]])
    phi, gamma = zero_order_hold(joined, np.vstack([B, np.zeros((n_w, k))]), prediction_time)
    target = _target(A, B, E, C[:p])
    gain, cost_to_go = _regulator(phi[:n_x, :n_x], gamma[:n_x], C[:p], q, r, N)

    form = Form(blocks, len(output_limits), slack_scale, softness)
    moves = np.broadcast_to(np.asarray(move_limit, dtype=float), k * len(blocks))
    lower, upper = limits_of(form, moves, output_limits)
    numbers = phi, gamma, C, target, cost_to_go, q, r, s
    if change is None:
        found = condensed(usual(tuple(np.shape(part) for part in numbers), form), numbers)
    else:
        problem = changed_by(change, formulated(numbers, form, (lower, upper)))
        lower, upper, found = problem.lower, problem.upper, condensed(problem)
        least = float(np.linalg.eigvalsh(found[0])[0])
        if not least > -_LEAST * float(np.abs(found[0]).max()):
            raise WorkbenchError(
                "the cost of an MPC's changed problem has no minimum: its Hessian has the"
                f" eigenvalue {least:.3g}; add squares, take none away"
            )
    stride = max(1, round(prediction_time / sample_time))
    lowest, highest = (np.tile(np.broadcast_to(ends, k), len(blocks)) for ends in opening_limits)
    return Prediction(
        *found,
        lower=np.concatenate([lower, lowest, [0.0]]),
        upper=np.concatenate([upper, highest, [1e6]]),
        gain=gain,
        target=target,
        preview_index=tuple(stride * (j + 1) for j in range(N)),
        slack_scale=slack_scale,
    )


def _target(A: Matrix, B: Matrix, E: Matrix, C: Matrix) -> Matrix:
    """Return (xs, us) per (w, r): A xs + B us + E w = 0 with C xs = r, us of least size."""
    (n, k), p = B.shape, len(C)
    matrix = np.block([[A, B], [C, np.zeros((p, k))]])
    right = np.zeros((n + p, E.shape[1] + p))
    right[:n, : E.shape[1]] = -E
    right[n:, E.shape[1] :] = np.eye(p)
    rows = np.max(np.abs(matrix), axis=1, keepdims=True)
    matrix, right = matrix / rows, right / rows
    columns = np.max(np.abs(matrix), axis=0)
    columns = np.where(columns > 0.0, columns, 1.0)
    if np.linalg.matrix_rank(matrix / columns) < n + p:
        raise WorkbenchError(
            "the controlled output of the linear model cannot be led to a reference by its input;"
            " follow another output, or check the operating point"
        )
    if k == p:
        return np.asarray(np.linalg.solve(matrix / columns, right) / columns[:, None])
    return np.asarray(np.linalg.lstsq(matrix / columns, right, rcond=None)[0] / columns[:, None])


def _regulator(
    phi: Matrix, gamma: Matrix, c: Matrix, q: Vector, r: Vector, samples: int
) -> tuple[Matrix, Matrix]:
    """Return the gain and the cost to go of the unconstrained regulator.

    What does not show in the outputs costs next to nothing, lest a slow state be led where it
    belongs at rest within a horizon.
    """
    # Scaled by what one unit of opening does over the horizon, states count alike.
    reached, size = gamma, np.abs(gamma)
    for _ in range(samples - 1):
        reached = phi @ reached + gamma
        size = np.maximum(size, np.abs(reached))
    size = np.max(size, axis=1)
    size = np.maximum(size, 1e-9 * float(np.max(size)))
    f, g, h = phi * size[None, :] / size[:, None], gamma / size[:, None], c * size[None, :]
    weight = (q[:, None] * h).T @ h
    try:
        gain, p = regulator(f, g, weight + _LEAST * np.trace(weight) * np.eye(len(f)), np.diag(r))
    except ValueError as error:
        raise WorkbenchError(
            f"no regulator exists for this linear model ({str(error).rstrip('.')}); a mode that"
            " grows is out of the input's reach"
        ) from None
    return np.asarray(gain / size), np.asarray(p / np.outer(size, size))
