"""Equations that stand in a nonlinear program many times, with exact sparse derivatives.

A collocation says the same in each interval. CasADi differentiates a mapped function along
directions, each through all intervals; here one interval is differentiated on symbols, and the
entries of all of them are put where they belong. The matrices are the same, ten times as fast.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt
import scipy

from workbench.arrays import Vector

_Places = npt.NDArray[np.int64]


class Entries(NamedTuple):
    """Entries of a matrix: the value times the factor is added at row and column.

    Args:
        rows: Shape (n,).
        columns: Shape (n,).
        factors: Shape (n,), in any unit.
        values: Shape (n,), in any unit.
    """

    rows: _Places
    columns: _Places
    factors: Vector
    values: ca.MX


class RepeatedEquations:
    """A vector function F(v) whose arguments are variables of a program, again and again.

    Args:
        v: Symbols, shape (m,), in any unit.
        expression: F(v), shape (r,), in any unit.
        columns: Which variables of the program each repetition takes for ``v``, shape (n, m).
        factors: By what they are multiplied, shape (n, m), in any unit.
        rows: Which equations of the program each repetition adds to, shape (n, r).
    """

    def __init__(
        self, v: ca.SX, expression: ca.SX, columns: _Places, factors: Vector, rows: _Places
    ) -> None:
        self._columns, self._factors, self._rows = columns, factors, rows
        weights = ca.SX.sym("weights", expression.numel())
        slopes = ca.jacobian(expression, v)
        bends = ca.jacobian(ca.jtimes(expression, v, weights, True), v)
        self._slopes, self._bends = slopes.sparsity(), bends.sparsity()

        def repeated(name: str, arguments: list[ca.SX], result: ca.SX) -> ca.Function:
            own = ca.Function(name, arguments, [ca.cse(ca.vertcat(*result.nonzeros()))])
            return own.map(len(columns))

        self._values_of = repeated("values", [v], ca.densify(expression))
        self._slopes_of = repeated("slopes", [v], slopes)
        self._bends_of = repeated("bends", [v, weights], bends)

    def _at(self, x: ca.MX) -> ca.MX:
        n, m = self._columns.shape
        taken = x[self._columns.ravel().tolist()] * ca.DM(self._factors.ravel())
        return ca.reshape(taken, m, n)

    def values(self, x: ca.MX) -> Entries:
        """Return what they add to the equations of a program, in any unit, at its variables."""
        rows = self._rows.ravel()
        found = ca.vec(self._values_of(self._at(x)))
        return Entries(rows, np.zeros_like(rows), np.ones(rows.size), found)

    def slopes(self, x: ca.MX) -> Entries:
        """Return what they add to the Jacobian of the equations, in any unit."""
        r, c = (np.array(places, dtype=np.int64) for places in self._slopes.get_triplet())
        found = ca.vec(self._slopes_of(self._at(x)))
        rows, columns = self._rows[:, r].ravel(), self._columns[:, c].ravel()
        return Entries(rows, columns, self._factors[:, c].ravel(), found)

    def bends(self, x: ca.MX, weights: ca.MX) -> Entries:
        """Return what they add to the Hessian of the weighted sum of the equations, in any unit."""
        r, c = (np.array(places, dtype=np.int64) for places in self._bends.get_triplet())
        own = ca.reshape(weights[self._rows.ravel().tolist()], self._rows.shape[1], -1)
        found = ca.vec(self._bends_of(self._at(x), own))
        factors = self._factors[:, r] * self._factors[:, c]
        return Entries(
            self._columns[:, r].ravel(), self._columns[:, c].ravel(), factors.ravel(), found
        )


def matrix(shape: tuple[int, int], parts: Iterable[Entries], *, upper: bool = False) -> ca.MX:
    """Return the sparse matrix of some entries, in any unit; what stands at one place is added.

    Args:
        upper: Whether only the triangle above the diagonal, with it, is wanted.
    """
    given = list(parts)
    rows, columns, factors = (np.concatenate(each) for each in list(zip(*given, strict=True))[:3])
    used = np.flatnonzero(rows <= columns) if upper else np.arange(rows.size)
    # By columns, as CasADi stores a matrix.
    places, of_place = np.unique(columns[used] * shape[0] + rows[used], return_inverse=True)
    sums = scipy.sparse.csc_matrix(
        (factors[used], (of_place, used)), shape=(places.size, rows.size)
    )
    begins = np.searchsorted(places, np.arange(shape[1] + 1) * shape[0])
    sparsity = ca.Sparsity(*shape, begins.tolist(), (places % shape[0]).tolist())
    return ca.MX(sparsity, ca.DM(sums) @ ca.vertcat(*(part.values for part in given)))


def program(
    x: ca.MX, f: ca.MX, repeated: Iterable[RepeatedEquations], linear: scipy.sparse.spmatrix
) -> tuple[dict[str, Any], dict[str, ca.Function]]:
    """Return a nonlinear program for `casadi.nlpsol`, and its derivatives, which are options of it.

    Args:
        x: Variables, shape (n,), in any unit.
        f: What is minimised, linear in the variables, in any unit.
        linear: What the equations have beside the repeated ones, over the variables, shape (m, n).
    """
    all_of, of_x = list(repeated), ca.DM(linear.tocsc())
    m, n = of_x.shape
    g = ca.densify(matrix((m, 1), (each.values(x) for each in all_of))) + of_x @ x
    own = linear.tocoo()
    fixed = Entries(
        own.row.astype(np.int64), own.col.astype(np.int64), own.data, ca.MX(np.ones(own.nnz))
    )
    slopes = matrix((m, n), [*(each.slopes(x) for each in all_of), fixed])
    p, weight, weights = ca.MX.sym("p", 0), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", m)
    bends = matrix((n, n), (each.bends(x, weights) for each in all_of), upper=True)
    return {"x": x, "f": f, "g": g}, {
        "jac_g": ca.Function("nlp_jac_g", [x, p], [g, slopes], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [x, p, weight, weights],
            [bends],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }
