"""Small dense quadratic programs, solved with CasADi's interface to DAQP.

minimise 1/2 x' H x + g' x   subject to   lower_a <= A x <= upper_a, lower_x <= x <= upper_x
"""

from __future__ import annotations

import time
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]


class Solution(NamedTuple):
    """Result of a quadratic program.

    Args:
        x: Minimiser, shape (n,), in the problem's units; meaningless unless ``solved``.
        solved: Whether the solver says so, and the result is finite and keeps the constraints.
        status: The solver's own word.
        iterations: Number of iterations (dimensionless), NaN where the solver does not tell.
        seconds: Time taken, in s.
    """

    x: Matrix
    solved: bool
    status: str
    iterations: float
    seconds: float


class QuadraticProgram:
    """A solver for problems of one size.

    Called through CasADi's buffers, which is five times faster than passing matrices. Every call
    sets all data, so that one solver serves any number of controllers of the same size.

    Args:
        variables: Number of variables.
        constraints: Number of rows of A.
        solver: CasADi plugin. DAQP is a dual active-set method with a short worst case.

    Source:
        Arnström, Bemporad, Axehill: A dual active-set solver for embedded quadratic programming
        using recursive LDL' updates, IEEE Trans. AC-67, 2022.

    Example:
        >>> qp = QuadraticProgram(1, 1)
        >>> one = np.ones(1)
        >>> qp.solve(np.eye(1), -3 * one, np.eye(1), -one, one, -9 * one, 9 * one).x
        array([1.])
    """

    def __init__(self, variables: int, constraints: int, solver: str = "daqp") -> None:
        structure = {
            "h": ca.Sparsity.dense(variables, variables),
            "a": ca.Sparsity.dense(constraints, variables),
        }
        self._function = ca.conic("qp", solver, structure, {"error_on_fail": False})
        self._buffer, self._call = self._function.buffer()
        inputs = [np.zeros(self._function.nnz_in(i)) for i in range(self._function.n_in())]
        self._x = np.zeros(variables)
        for i, array in enumerate(inputs):
            if array.size:
                self._buffer.set_arg(i, memoryview(array.data))
        self._buffer.set_res(0, memoryview(self._x.data))
        self._inputs = inputs
        self._tolerance = 1e-5

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
        """Solve one problem.

        Args:
            H: Symmetric matrix, shape (n, n), dimensionless.
            g: Shape (n,), dimensionless.
            A: Shape (m, n), dimensionless.
            lower_a: Shape (m,), in the unit of the row.
            upper_a: Shape (m,), in the unit of the row.
            lower_x: Shape (n,), in the unit of the variable.
            upper_x: Shape (n,), in the unit of the variable.

        Returns:
            The minimiser (in the problem's units), whether it can be used, and how it was found.
        """
        began = time.perf_counter()
        into = self._inputs
        into[0][:] = H.ravel(order="F")
        into[1][:] = g
        into[2][:] = A.ravel(order="F")
        into[3][:], into[4][:], into[5][:], into[6][:] = lower_a, upper_a, lower_x, upper_x
        try:
            self._call()
            stats = self._buffer.stats()
            success, status = bool(stats["success"]), str(stats["unified_return_status"])
            iterations = float(stats.get("iter_count", -1))
        except RuntimeError as error:
            # CasADi refuses data that are not finite or bounds that cross.
            success, status, iterations = False, f"refused: {str(error)[-80:]}", -1.0
        x = self._x.copy()
        # The solver's word is not enough: a controller must never act on a point out of bounds.
        slack = self._tolerance
        rows = A @ x
        # Comparisons with NaN are false, so data or results that are not finite fail here too.
        usable = success and bool(
            ((x >= lower_x - slack) & (x <= upper_x + slack)).all()
            and ((rows >= lower_a - slack) & (rows <= upper_a + slack)).all()
            and -np.inf < float(x @ H @ x + g @ x) < np.inf
        )
        seconds = time.perf_counter() - began
        return Solution(x, usable, status, iterations if iterations >= 0 else np.nan, seconds)


@lru_cache(maxsize=32)
def quadratic_program(variables: int, constraints: int) -> QuadraticProgram:
    """Return the solver for problems of a size, built once.

    Args:
        variables: Number of variables.
        constraints: Number of rows of A.

    Example:
        >>> quadratic_program(2, 1) is quadratic_program(2, 1)
        True
    """
    return QuadraticProgram(variables, constraints)
