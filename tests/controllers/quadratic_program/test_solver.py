"""The quadratic-program solver in C, and that without a compiler, against others; refusals."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.quadratic_program.solver import (
    INFEASIBLE,
    LIMITED,
    NOT_FINITE,
    CompiledProgram,
    ConicProgram,
    factored,
    most_iterations,
    quadratic_program,
    solver_library,
)
from workbench.errors import WorkbenchError

IMPLEMENTATIONS = pytest.mark.parametrize("compiled", [False, True], ids=["daqp", "c"])


def in_c(variables: int, constraints: int, limit: int = 0) -> CompiledProgram:
    limit = limit or most_iterations(variables, constraints)
    library = solver_library(variables, variables + constraints, limit)
    if library is None:
        pytest.skip("no C compiler on this machine")
    return CompiledProgram(variables, constraints, library)


def solver(variables: int, constraints: int, compiled: bool) -> CompiledProgram | ConicProgram:
    if compiled:
        return in_c(variables, constraints)
    return ConicProgram(variables, constraints, "daqp")


def problem(seed: int, n: int = 6, m: int = 9, push: float = 3.0) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    return (
        root @ root.T + 0.1 * np.eye(n),
        push * rng.normal(size=n),
        rng.normal(size=(m, n)),
        -rng.uniform(0.1, 1.0, m),
        rng.uniform(0.1, 1.0, m),
        -np.ones(n),
        np.ones(n),
    )


def given(
    H: np.ndarray,
    g: np.ndarray,
    A: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """Return a problem with the limits of its rows, then those of its variables."""
    return H, g, A, np.append(lower, low), np.append(upper, high)


@IMPLEMENTATIONS
@pytest.mark.parametrize("seed", range(5))
def test_solution_agrees_with_sequential_programming(seed: int, compiled: bool) -> None:
    from scipy.optimize import LinearConstraint, minimize

    H, g, A, lower, upper, low, high = problem(seed)
    found = solver(6, 9, compiled).solve(*given(H, g, A, lower, upper, low, high))
    other = minimize(
        lambda x: 0.5 * x @ H @ x + g @ x,
        np.zeros(6),
        jac=lambda x: H @ x + g,
        method="SLSQP",
        bounds=list(zip(low, high, strict=True)),
        constraints=[LinearConstraint(A, lower, upper)],
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert found.solved
    np.testing.assert_allclose(found.x, other.x, atol=1e-5)


@pytest.mark.parametrize("size", [(4, 60), (12, 91), (21, 80)])
def test_both_solvers_agree(size: tuple[int, int]) -> None:
    n, m = size
    daqp, own, most = solver(n, m, False), in_c(n, m), 0.0
    for seed in range(20):
        told = problem(seed, n, m, push=3.0 * n)
        found, other = own.solve(*given(*told)), daqp.solve(*given(*told))
        assert found.solved and other.solved
        # Both end with an exact solution on the active set: condition (1e3) times rounding.
        np.testing.assert_allclose(found.x, other.x, atol=1e-10)
        most = max(most, found.iterations)
    # Many constraints were met, and the bound on iterations is not near.
    assert n < most < 0.7 * most_iterations(n, m)


@IMPLEMENTATIONS
def test_optimality_conditions_hold_where_rows_repeat(compiled: bool) -> None:
    # Every row twice, and bounds that rows repeat: active rows depend on each other.
    H, g, A, lower, upper, low, high = problem(7, 5, 4, push=20.0)
    A, lower, upper = (np.concatenate(2 * [part]) for part in (A, lower, upper))
    A = np.vstack([A, np.eye(5)])
    lower, upper = np.concatenate([lower, low]), np.concatenate([upper, high])
    found = solver(5, 13, compiled).solve(*given(H, g, A, lower, upper, low, high))
    assert found.solved
    rows = A @ found.x
    assert (rows >= lower - 1e-12).all() and (rows <= upper + 1e-12).all()
    # -gradient is a combination, with the right signs, of the active rows.
    from scipy.optimize import nnls

    at = 1e-9
    active = np.vstack([A[rows >= upper - at], -A[rows <= lower + at]])
    assert len(active)
    assert nnls(active.T, -(H @ found.x + g))[1] < 1e-9


@IMPLEMENTATIONS
def test_equal_limits_and_no_limits(compiled: bool) -> None:
    rows, three, far = np.ones((1, 2)), np.array([3.0]), np.full(2, np.inf)
    found = solver(2, 1, compiled).solve(
        *given(np.eye(2), np.zeros(2), rows, three, three, -far, far)
    )
    np.testing.assert_allclose(found.x, [1.5, 1.5], atol=1e-15)


@IMPLEMENTATIONS
def test_contradictory_constraints_are_reported(compiled: bool) -> None:
    one = np.ones(1)
    qp = solver(1, 1, compiled)
    # x >= 2 against x <= 1; then limits that cross within a row.
    found = qp.solve(*given(np.eye(1), 0 * one, np.eye(1), 2 * one, 3 * one, -one, one))
    assert (found.solved, found.status) == (False, INFEASIBLE)
    found = qp.solve(*given(np.eye(1), 0 * one, np.eye(1), one, 0.5 * one, -one, one))
    assert (found.solved, found.status) == (False, INFEASIBLE)
    assert qp.solve(*given(np.eye(1), 0 * one, np.eye(1), -one, one, -one, one)).solved


@IMPLEMENTATIONS
def test_contradictions_of_many_rows_are_those_that_linear_programming_finds(
    compiled: bool,
) -> None:
    from scipy.optimize import linprog

    qp, seen = solver(4, 12, compiled), set()
    for seed in range(40):
        H, g, A, lower, upper, low, high = problem(seed, 4, 12)
        lower = lower + np.random.default_rng(seed).uniform(0.0, 0.6, 12)
        upper = np.maximum(upper, lower + 0.01)
        found = qp.solve(*given(H, g, A, lower, upper, low, high))
        feasible = linprog(
            np.zeros(4),
            A_ub=np.vstack([A, -A]),
            b_ub=np.concatenate([upper, -lower]),
            bounds=list(zip(low, high, strict=True)),
        ).success
        assert found.solved == feasible
        assert found.solved or found.status == INFEASIBLE
        seen.add(feasible)
    assert seen == {True, False}


@IMPLEMENTATIONS
@pytest.mark.parametrize("where", range(7))
def test_numbers_that_are_not_finite_are_never_solved(where: int, compiled: bool) -> None:
    data = list(problem(0))
    data[where] = data[where] * np.nan
    found = solver(6, 9, compiled).solve(*given(*data))
    assert (found.solved, found.status) == (False, NOT_FINITE)
    assert solver(6, 9, compiled).solve(*given(*problem(0))).solved


def test_too_many_iterations_are_reported() -> None:
    told = problem(0, push=30.0)
    needed = in_c(6, 9).solve(*given(*told))
    assert needed.solved and needed.iterations > 3
    # Exactly as many as are needed are enough.
    assert in_c(6, 9, int(needed.iterations)).solve(*given(*told)).solved
    found = in_c(6, 9, int(needed.iterations) - 1).solve(*given(*told))
    assert (found.solved, found.status) == (False, LIMITED)


def test_a_hessian_without_minimum_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="not positive definite"):
        factored(-np.eye(2), np.zeros((0, 2)))


@pytest.mark.usefixtures("forgotten")
def test_without_a_compiler_daqp_solves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORKBENCH_CC", "none")
    assert solver_library(6, 15, 45) is None
    found = quadratic_program(6, 9)
    assert isinstance(found, ConicProgram) and found.solve(*given(*problem(0))).solved


@pytest.mark.usefixtures("forgotten")
def test_a_compiler_that_fails_leaves_it_to_daqp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORKBENCH_CC", "false")
    with pytest.warns(RuntimeWarning, match="could not build it"):
        assert solver_library(6, 15, 45) is None
