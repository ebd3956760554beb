"""Derivatives of repeated equations, against those that CasADi takes of the whole program."""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.sparse

from workbench.verification.repeated_equations import RepeatedEquations, program


def test_derivatives_are_those_of_the_whole_program() -> None:
    # Three repetitions share the first variable, the last two add to one equation.
    v = ca.SX.sym("v", 3)
    bent = ca.vertcat(ca.sin(v[0] * v[1]) + v[2] ** 3, v[0] / (2.0 + v[1]))
    columns = np.array([[0, 1, 2], [0, 3, 4], [4, 2, 0]])
    factors = np.array([[0.5, 1.0, 1.0], [0.25, 1.0, -2.0], [1.0, 3.0, 1.0]])
    rows = np.array([[0, 1], [2, 3], [4, 3]])
    linear = scipy.sparse.csc_matrix(np.diag([1.0, 0.0, -1.0, 0.0, 2.0]))
    x = ca.MX.sym("x", 5)
    repeated = RepeatedEquations(v, bent, columns, factors, rows)
    problem, derivatives = program(x, ca.sum1(x), [repeated], linear)

    def plain(values: ca.MX) -> ca.MX:
        g = [ca.mtimes(ca.DM(linear), values)[i] for i in range(5)]
        for taken, by, to in zip(columns.tolist(), factors.tolist(), rows.tolist(), strict=True):
            a, b, c = (values[i] * k for i, k in zip(taken, by, strict=True))
            g[to[0]] += ca.sin(a * b) + c**3
            g[to[1]] += a / (2.0 + b)
        return ca.vertcat(*g)

    weights = ca.MX.sym("weights", 5)
    of_all = ca.Function(
        "of_all",
        [x, weights],
        [
            plain(x),
            ca.jacobian(plain(x), x),
            ca.triu(ca.hessian(ca.dot(weights, plain(x)), x)[0]),
        ],
    )
    at, weighing = np.random.default_rng(1).uniform(0.2, 1.0, (2, 5))
    g, slopes = derivatives["jac_g"](at, [])
    bends = derivatives["hess_lag"](at, [], 1.0, weighing)
    own = ca.Function("own", [x], [problem["g"]])(at)
    for found, wanted in zip((g, slopes, bends), of_all(at, weighing), strict=True):
        np.testing.assert_allclose(found.full(), wanted.full(), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(own.full(), g.full(), rtol=0.0, atol=1e-14)
    assert bends.sparsity().is_triu()
