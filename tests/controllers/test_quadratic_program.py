"""The quadratic-program solver against another method, and its refusals."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.quadratic_program import QuadraticProgram, quadratic_program


def problem(seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    n, m = 6, 9
    root = rng.normal(size=(n, n))
    return (
        root @ root.T + 0.1 * np.eye(n),
        3 * rng.normal(size=n),
        rng.normal(size=(m, n)),
        -rng.uniform(0.1, 1.0, m),
        rng.uniform(0.1, 1.0, m),
        -np.ones(n),
        np.ones(n),
    )


@pytest.mark.parametrize("seed", range(5))
def test_solution_agrees_with_sequential_programming(seed: int) -> None:
    from scipy.optimize import LinearConstraint, minimize

    H, g, A, lower, upper, low, high = problem(seed)
    found = quadratic_program(6, 9).solve(H, g, A, lower, upper, low, high)
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


def test_contradictory_constraints_are_reported() -> None:
    one = np.ones(1)
    qp = QuadraticProgram(1, 1)
    # x >= 2 against x <= 1.
    found = qp.solve(np.eye(1), 0 * one, np.eye(1), 2 * one, 3 * one, -one, one)
    assert not found.solved
    assert "SUCCESS" not in found.status
    assert qp.solve(np.eye(1), 0 * one, np.eye(1), -one, one, -one, one).solved


@pytest.mark.parametrize("where", range(7))
def test_numbers_that_are_not_finite_are_never_solved(where: int) -> None:
    data = list(problem(0))
    data[where] = data[where] * np.nan
    assert not quadratic_program(6, 9).solve(*data).solved
    assert quadratic_program(6, 9).solve(*problem(0)).solved
