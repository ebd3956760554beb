"""CasADi's solvers of quadratic programs behind the call of the own one, to compare with it."""

from __future__ import annotations

import time
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from controllers.quadratic_program.solver import (
    LIMITED,
    SUCCESS,
    Factored,
    QuadraticProgram,
    Solution,
    quadratic_program,
)
from workbench.arrays import Matrix
from workbench.errors import check_choice

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
        """Solve one problem, as `controllers.quadratic_program.solver.QuadraticProgram.solve`."""
        began = time.perf_counter()
        found = self._solver(h=H, g=g, a=A, lba=lower_a, uba=upper_a, lbx=lower_x, ubx=upper_x)
        x, stats = found["x"].full().ravel(), self._solver.stats()
        solved = bool(stats["success"]) and bool(np.isfinite(x).all())
        return Solution(
            x,
            solved,
            SUCCESS if solved else LIMITED,
            float(stats.get("iter_count", 0)),
            time.perf_counter() - began,
        )

    def solve_factored(
        self, problem: Factored, g: Matrix, lower: Matrix, upper: Matrix
    ) -> Solution:
        """Solve a factored problem, in its units, as the own solver does."""
        root = np.linalg.inv(problem.inverse)
        rows = (problem.rows * problem.sizes[:, None])[: self._rows] @ root
        m = self._rows
        return self.solve(root.T @ root, g, rows, lower[:m], upper[:m], lower[m:], upper[m:])


_made = lru_cache(maxsize=32)(ConicProgram)


def program(variables: int, constraints: int, solver: str = OWN) -> QuadraticProgram | ConicProgram:
    """Return a solver for n variables and m rows, made once: ``"own"`` or one of `OPTIONS`."""
    check_choice("solver", solver, (OWN, *OPTIONS))
    if solver == OWN:
        return quadratic_program(variables, constraints)
    return _made(variables, constraints, solver)
