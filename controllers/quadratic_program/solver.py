"""Small dense quadratic programs, solved exactly by a dual active-set method.

    minimise 1/2 x' H x + g' x   subject to   lower <= (A x, x) <= upper

With H = R' R, u = R x + v, v = R'^-1 g and rows m_i of (A, 1) R^-1 scaled to length 1, this is

    minimise 1/2 |u|^2           subject to   low_i <= m_i u <= high_i

The method starts at u = 0 and takes in the constraint that is violated most, along the direction z
that keeps the active ones; a constraint whose multiplier would turn negative on the way is let go.
The active rows are kept as N = Q T^-1 with orthonormal Q (Gram-Schmidt, twice), so that u = Q y is
computed afresh for every active set and no rounding collects. H is positive definite, so that the
minimiser is unique: two correct solvers agree to rounding, whatever path they take. Every call
starts anew: the result depends on the data alone.

`solver.c` has the same method in C; it is what a controller takes to the rig.

Source: Goldfarb and Idnani, A numerically stable dual method for solving strictly convex quadratic
programs, Mathematical Programming 27, 1983, section 3; Giraud et al., The loss of orthogonality in
the Gram-Schmidt orthogonalization process, Computers and Mathematics with Applications 50, 2005.
"""

from __future__ import annotations

import ctypes
import time
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from controllers.quadratic_program.compiled import solver_library
from workbench.arrays import Matrix
from workbench.errors import WorkbenchError

SUCCESS, LIMITED, INFEASIBLE, NOT_FINITE = (
    "SOLVER_RET_SUCCESS",
    "SOLVER_RET_LIMITED",
    "SOLVER_RET_INFEASIBLE",
    "SOLVER_RET_NAN",
)
STATUSES = (SUCCESS, LIMITED, INFEASIBLE, NOT_FINITE)
"""Words for how a solution ended; in C their position is the status."""

ROUNDING = 1e-13
"""Violation that is rounding, as a fraction of |u| + |v|."""

DEPENDENT = 1e-9
"""Length of what is left of a row of length 1 from which it depends on the active rows."""

FORGIVEN = 1e-7
"""Violation, relative as above, of a dependent row that is taken for its rounding."""


class Solution(NamedTuple):
    """Result of a quadratic program.

    Args:
        x: Minimiser, shape (n,), in the problem's units; meaningless unless ``solved``.
        solved: Whether it is the minimiser, finite and within the constraints.
        iterations: Number of constraints taken in or let go (dimensionless).
        seconds: Time taken, in s.
    """

    x: Matrix
    solved: bool
    status: str
    iterations: float
    seconds: float


class Factored(NamedTuple):
    """What of a problem does not depend on the gradient and the limits.

    Args:
        inverse: R^-1, shape (n, n), upper triangle, dimensionless.
        rows: Rows of (A, 1) R^-1, scaled to length 1, shape (m + n, n), dimensionless.
        sizes: Their lengths before, shape (m + n,), dimensionless.
    """

    inverse: Matrix
    rows: Matrix
    sizes: Matrix


def factored(H: Matrix, A: Matrix) -> Factored:
    """Factor the matrices H, shape (n, n), and A, shape (m, n), of a problem in its units.

    Raises:
        WorkbenchError: If H is not positive definite or a number is not finite.
    """
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(H)).T
    except np.linalg.LinAlgError:
        inverse = np.full_like(H, np.nan)
    rows = np.vstack([A @ inverse, inverse])
    sizes = np.sqrt(np.einsum("ij,ij->i", rows, rows))
    if not np.isfinite(sizes).all():
        raise WorkbenchError(
            "the Hessian of a quadratic program is not positive definite, or a number is not"
            " finite; give every variable a weight"
        )
    sizes[sizes == 0.0] = 1.0
    return Factored(inverse, rows / sizes[:, None], sizes)


def most_iterations(variables: int, constraints: int) -> int:
    """Return the number of iterations after which a solution is given up."""
    return 5 * variables + constraints + variables


def solve(
    problem: Factored, g: Matrix, lower: Matrix, upper: Matrix, *, limit: int | None = None
) -> Solution:
    """Solve a factored problem, all in its units, within a number of iterations.

    The gradient is that at x = 0, shape (n,); limits, which may be infinite, are those of A x, then
    those of x, shape (m + n,).
    """
    began = time.perf_counter()
    rows, n = problem.rows, len(g)
    limit = most_iterations(n, len(rows) - n) if limit is None else limit
    v = g @ problem.inverse
    shift = rows @ v
    low, high = lower / problem.sizes + shift, upper / problem.sizes + shift
    base = float(np.sqrt(v @ v))
    active, multipliers, u, at = _ActiveSet(n), np.zeros(0), np.zeros(n), np.zeros(len(rows))
    closed = np.zeros(len(rows), dtype=bool)
    status, iterations = "", 0
    if not (low - high <= ROUNDING * base).all():
        crossed = np.isfinite(base) and not (np.isnan(low) | np.isnan(high)).any()
        status = INFEASIBLE if crossed else NOT_FINITE
    while not status:
        out = np.where(closed, -np.inf, np.maximum(low - at, at - high))
        p = int(out.argmax())
        size = base + float(np.sqrt(u @ u))
        if out[p] <= ROUNDING * size:
            status = SUCCESS
            break
        sign = 1.0 if low[p] - at[p] >= at[p] - high[p] else -1.0
        normal, wanted = sign * rows[p], float(low[p] if sign > 0.0 else -high[p])
        value = sign * float(at[p])
        while not status:
            if iterations == limit:
                status = LIMITED
                break
            iterations += 1
            along, left, length = active.split(normal)
            # Steps to where the row is met and to where the first multiplier is zero.
            free = length > DEPENDENT and active.count < n
            whole = (wanted - value) / length**2 if free else np.inf
            fall = active.T[: active.count, : active.count] @ along
            first, place = np.inf, -1
            for i, (multiplier, rate) in enumerate(
                zip(multipliers.tolist(), fall.tolist(), strict=True)
            ):
                if rate > 0.0 and max(multiplier, 0.0) < first * rate:
                    first, place = max(multiplier, 0.0) / rate, i
            if first < whole:
                value += first * length**2
                multipliers = np.delete(multipliers - first * fall, place)
                closed[:] = False
                active.drop(place, rows)
            elif whole < np.inf:
                active.add(p, sign, wanted, along, left, length)
                break
            elif wanted - value <= FORGIVEN * size:
                closed[p] = True
                break
            else:
                status = INFEASIBLE
        u, multipliers = active.point()
        at = rows @ u
        closed[active.rows] = True
    x = problem.inverse @ (u - v)
    if status == SUCCESS and not np.isfinite(x).all():
        status = NOT_FINITE
    seconds = time.perf_counter() - began
    return Solution(x, status == SUCCESS, status, float(iterations), seconds)


class QuadraticProgram:
    """A solver for problems of one size: the one in C where it could be built, else this one.

    Args:
        variables: Number n of variables.
        constraints: Number m of rows of A.
        compiled: Whether the solver in C is used where a compiler is present.

    Example:
        >>> one = np.ones(1)
        >>> qp = QuadraticProgram(1, 1)
        >>> qp.solve(np.eye(1), -3 * one, np.eye(1), -one, one, -9 * one, 9 * one).x
        array([1.])
    """

    def __init__(self, variables: int, constraints: int, *, compiled: bool = True) -> None:
        n, rows = variables, variables + constraints
        self.limit = most_iterations(variables, constraints)
        self._library = solver_library(n, rows, self.limit) if compiled else None
        self._inverse, self._rows = np.zeros((n, n)), np.zeros((rows, n))
        self._sizes = np.ones(rows)
        self._factored: Factored | None = None
        self._H, self._A, self._g = np.zeros((n, n)), np.zeros((constraints, n)), np.zeros(n)
        self._lower, self._upper, self._x = np.zeros(rows), np.zeros(rows), np.zeros(n)
        self._count = np.zeros(1, dtype=np.intc)
        kept = (self._inverse, self._rows, self._sizes)
        self._to_factor = [_pointer(array) for array in (self._H, self._A, *kept)]
        self._to_solve = [
            _pointer(array)
            for array in (*kept, self._g, self._lower, self._upper, self._x, self._count)
        ]

    def solve(
        self,
        H: Matrix,
        g: Matrix,
        A: Matrix,
        lower_a: Matrix,
        upper_a: Matrix,
        lower_x: Matrix,
        upper_x: Matrix,
    ) -> Solution:
        """Factor and solve one problem; limits are in the units of rows and variables."""
        began = time.perf_counter()
        if self._library is None:
            try:
                problem = factored(H, A)
            except WorkbenchError:
                return Solution(np.full(len(g), np.nan), False, NOT_FINITE, 0.0, 0.0)
        else:
            self._H[:], self._A[:] = H, A
            if self._library.factor(*self._to_factor):
                return Solution(np.full(len(g), np.nan), False, NOT_FINITE, 0.0, 0.0)
            problem = self._factored = Factored(self._inverse, self._rows, self._sizes)
        found = self.solve_factored(
            problem, g, np.concatenate([lower_a, lower_x]), np.concatenate([upper_a, upper_x])
        )
        return found._replace(seconds=time.perf_counter() - began)

    def solve_factored(
        self, problem: Factored, g: Matrix, lower: Matrix, upper: Matrix
    ) -> Solution:
        """Solve a factored problem, in its units, as the function `solve` does."""
        if self._library is None:
            return solve(problem, g, lower, upper, limit=self.limit)
        began = time.perf_counter()
        if problem is not self._factored:
            self._inverse[:], self._rows[:], self._sizes[:] = problem
            self._factored = problem
        self._g[:], self._lower[:], self._upper[:] = g, lower, upper
        word = STATUSES[self._library.solve(*self._to_solve)]
        seconds = time.perf_counter() - began
        return Solution(self._x.copy(), word == SUCCESS, word, float(self._count[0]), seconds)


def _pointer(array: npt.NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


@lru_cache(maxsize=32)
def quadratic_program(variables: int, constraints: int) -> QuadraticProgram:
    """Return the solver for problems of a size, made once."""
    return QuadraticProgram(variables, constraints)


class _ActiveSet:
    """Active rows, their basis Q, T, and the point Q y of least length on all of them."""

    def __init__(self, variables: int) -> None:
        self.rows: list[int] = []
        self.signs: list[float] = []
        self.wanted: list[float] = []
        self.Q = np.zeros((variables, variables))
        self.T = np.zeros((variables, variables))
        self.y = np.zeros(variables)

    @property
    def count(self) -> int:
        return len(self.rows)

    def split(self, normal: Matrix) -> tuple[Matrix, Matrix, float]:
        """Return the part of a row along the basis, what is left of it, and its length."""
        Q = self.Q[:, : self.count]
        along = normal @ Q
        left = normal - Q @ along
        again = left @ Q
        left = left - Q @ again
        return along + again, left, float(np.sqrt(left @ left))

    def add(
        self, row: int, sign: float, wanted: float, along: Matrix, left: Matrix, length: float
    ) -> None:
        k = self.count
        self.Q[:, k] = left / length
        self.T[:k, k] = self.T[:k, :k] @ along / -length
        self.T[k, k] = 1.0 / length
        self.y[k] = (wanted - float(along @ self.y[:k])) / length
        self.rows.append(row)
        self.signs.append(sign)
        self.wanted.append(wanted)

    def drop(self, place: int, rows: Matrix) -> None:
        """Let a row go; those that came after it are taken in again."""
        later = list(zip(self.rows, self.signs, self.wanted, strict=True))[place + 1 :]
        del self.rows[place:], self.signs[place:], self.wanted[place:]
        for row, sign, wanted in later:
            self.add(row, sign, wanted, *self.split(sign * rows[row]))

    def point(self) -> tuple[Matrix, Matrix]:
        """Return the point and the multipliers of the active rows."""
        k = self.count
        y = self.y[:k]
        return self.Q[:, :k] @ y, self.T[:k, :k] @ y
