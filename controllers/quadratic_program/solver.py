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

`solver.c` has the method; it is what a controller takes to the rig, and what simulations run where
there is a C compiler. Without one DAQP solves, a dual active-set method too, by CasADi; other
solvers of CasADi's are offered to compare with.

Source: Goldfarb and Idnani, A numerically stable dual method for solving strictly convex quadratic
programs, Mathematical Programming 27, 1983, section 3; Giraud et al., The loss of orthogonality in
the Gram-Schmidt orthogonalization process, Computers and Mathematics with Applications 50, 2005;
Arnström, Bemporad and Axehill, A dual active-set solver for embedded quadratic programming using
recursive LDL' updates, IEEE Transactions on Automatic Control 67, 2022 (DAQP).
"""

from __future__ import annotations

import ctypes
import time
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Matrix
from workbench.computing.machine_code import built
from workbench.errors import WorkbenchError, check_choice

SUCCESS, LIMITED, INFEASIBLE, NOT_FINITE = (
    "SOLVER_RET_SUCCESS",
    "SOLVER_RET_LIMITED",
    "SOLVER_RET_INFEASIBLE",
    "SOLVER_RET_NAN",
)
STATUSES = (SUCCESS, LIMITED, INFEASIBLE, NOT_FINITE)
"""Words for how a solution ended; in C their position is the status."""


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


class CompiledProgram:
    """The solver in C for n variables and m rows of A.

    Args:
        library: The solver for this size, as `solver_library` builds it.
    """

    def __init__(self, variables: int, constraints: int, library: ctypes.PyDLL) -> None:
        n, rows = variables, variables + constraints
        self._library = library
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

    def solve(self, H: Matrix, g: Matrix, A: Matrix, lower: Matrix, upper: Matrix) -> Solution:
        """Factor and solve one problem, with limits as in `solve_factored`."""
        began = time.perf_counter()
        self._H[:], self._A[:] = H, A
        if self._library.factor(*self._to_factor):
            return Solution(np.full(len(g), np.nan), False, NOT_FINITE, 0.0, 0.0)
        self._factored = Factored(self._inverse, self._rows, self._sizes)
        found = self.solve_factored(self._factored, g, lower, upper)
        return found._replace(seconds=time.perf_counter() - began)

    def solve_factored(
        self, problem: Factored, g: Matrix, lower: Matrix, upper: Matrix
    ) -> Solution:
        """Solve a factored problem, in its units.

        The gradient is that at x = 0, shape (n,); limits, which may be infinite, are those of A x,
        then those of x, shape (m + n,).
        """
        began = time.perf_counter()
        if problem is not self._factored:
            self._inverse[:], self._rows[:], self._sizes[:] = problem
            self._factored = problem
        self._g[:], self._lower[:], self._upper[:] = g, lower, upper
        word = STATUSES[self._library.solve(*self._to_solve)]
        seconds = time.perf_counter() - began
        return Solution(self._x.copy(), word == SUCCESS, word, float(self._count[0]), seconds)


OWN = "own"

OPTIONS: dict[str, dict[str, Any]] = {
    "daqp": {"daqp": {"primal_tol": 1e-10, "dual_tol": 1e-12}},
    "osqp": {
        "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 50_000, "polish": True},
        "warm_start_primal": False,
        "warm_start_dual": False,
    },
    "qpoases": {"printLevel": "none", "sparse": False},
}
"""CasADi's plugins that are offered, with what makes them as exact as the own solver."""

_NO_POINT = -1
"""What DAQP returns where the constraints contradict each other."""


class ConicProgram:
    """A solver of CasADi's, one of `OPTIONS`, for problems of n variables and m rows of A."""

    def __init__(self, variables: int, constraints: int, plugin: str) -> None:
        check_choice("solver", plugin, OPTIONS)
        sparsity = {
            "h": ca.Sparsity.dense(variables, variables),
            "a": ca.Sparsity.dense(constraints, variables),
        }
        options = {"error_on_fail": False, "print_time": False, **OPTIONS[plugin]}
        if plugin == "osqp":
            options["osqp"] = {**options["osqp"], "verbose": False}
        self._solver = ca.conic("program", plugin, sparsity, options)
        self._rows = constraints

    def solve(self, H: Matrix, g: Matrix, A: Matrix, lower: Matrix, upper: Matrix) -> Solution:
        """Solve one problem, as `CompiledProgram.solve`."""
        began, x, count = time.perf_counter(), np.full(len(g), np.nan), 0
        m = self._rows
        given = {"h": H, "g": g, "a": A, "lba": lower[:m], "uba": upper[:m]}
        given |= {"lbx": lower[m:], "ubx": upper[m:]}
        if any(np.isnan(value).any() for value in given.values()):
            status = NOT_FINITE
        elif np.any(lower > upper):
            status = INFEASIBLE
        else:
            x, stats = self._solver(**given)["x"].full().ravel(), self._solver.stats()
            count = max(0, stats.get("iter_count", 0))
            status = SUCCESS if stats["success"] and np.isfinite(x).all() else LIMITED
            if status == LIMITED and stats.get("return_status") == _NO_POINT:
                status = INFEASIBLE
        took = time.perf_counter() - began
        return Solution(x, status == SUCCESS, status, float(count), took)

    def solve_factored(
        self, problem: Factored, g: Matrix, lower: Matrix, upper: Matrix
    ) -> Solution:
        """Solve a factored problem, in its units, as `CompiledProgram.solve_factored`."""
        root = np.linalg.inv(problem.inverse)
        rows = (problem.rows * problem.sizes[:, None])[: self._rows] @ root
        return self.solve(root.T @ root, g, rows, lower, upper)


@lru_cache(maxsize=32)
def quadratic_program(
    variables: int, constraints: int, solver: str = OWN
) -> CompiledProgram | ConicProgram:
    """Return a solver for n variables and m rows of A, made once: ``"own"`` or one of `OPTIONS`.

    Example:
        >>> one = np.ones(1)
        >>> qp = quadratic_program(1, 1)
        >>> qp.solve(np.eye(1), -3 * one, np.eye(1), np.array([-1, -9]), np.array([1, 9])).x
        array([1.])
    """
    check_choice("solver", solver, (OWN, *OPTIONS))
    if solver != OWN:
        return ConicProgram(variables, constraints, solver)
    limit = most_iterations(variables, constraints)
    library = solver_library(variables, variables + constraints, limit)
    if library is None:
        return ConicProgram(variables, constraints, "daqp")
    return CompiledProgram(variables, constraints, library)


def _pointer(array: npt.NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


TEXT = Path(__file__).with_name("solver.c")
"""The solver, for sizes that are defined before it."""

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
"""Flags of the compiler: no operation may be fused, so that every machine rounds alike."""


def solver_source(variables: int, rows: int, *, limit: int, factor: bool = True) -> str:
    """Return the solver for problems of one size as C source."""
    return (
        f"#define QP_N {variables} /* variables */\n"
        f"#define QP_ROWS {rows} /* constraints, then variables */\n"
        f"#define QP_LIMIT {limit} /* iterations after which it is given up */\n"
        + ("#define QP_FACTOR /* the matrices change from call to call */\n" if factor else "")
        + TEXT.read_text(encoding="utf-8")
    )


def solver_bytes(variables: int, rows: int, *, factor: bool = True) -> int:
    """Return the solver's own memory, in bytes, with 4 bytes for an integer."""
    numbers = (2 + factor) * variables**2 + 9 * variables + 3 * rows
    return 8 * numbers + 4 * (variables + 1) + rows


@lru_cache(maxsize=32)
def solver_library(variables: int, rows: int, limit: int) -> ctypes.PyDLL | None:
    """Return the built solver for problems of one size, or None without a compiler."""
    source = solver_source(variables, rows, limit=limit) + _ENTRIES
    library = built("quadratic_program", source, FLAGS)
    return None if library is None else ctypes.PyDLL(str(library))


_ENTRIES = """
int factor(const double *H, const double *A, double *inverse, double *rows, double *sizes) {
  return qp_factor(H, A, inverse, rows, sizes);
}

int solve(const double *inverse, const double *rows, const double *sizes, const double *g,
          const double *lower, const double *upper, double *x, int *iterations) {
  return qp_solve(inverse, rows, sizes, g, lower, upper, x, iterations);
}
"""
