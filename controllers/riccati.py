"""Gains of sampled linear systems from the discrete algebraic Riccati equation, in any units.

Source: Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, sections 6.4 and 6.5.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from workbench.arrays import Matrix, Vector
from workbench.errors import WorkbenchError


def regulator(
    F: Matrix, G: Matrix, weight: npt.ArrayLike, cost: npt.ArrayLike
) -> tuple[Matrix, Matrix]:
    """Return K, u = -K x of the least sum of x' weight x + u' cost u, and that sum, in any unit.

    Raises:
        ValueError: If there is no such gain.
    """
    from scipy.linalg import solve_discrete_are

    p = solve_discrete_are(F, G, weight, cost)
    return np.linalg.solve(cost + G.T @ p @ G, G.T @ p @ F), p


def kalman_gain(F: Matrix, C: Matrix, walk: npt.ArrayLike, noise: npt.ArrayLike) -> Matrix:
    """Return the stationary gain that corrects predictions of x, from covariances in any unit.

    Raises:
        ValueError: If there is no such gain.
    """
    from scipy.linalg import solve_discrete_are

    p = solve_discrete_are(F.T, C.T, walk, noise)
    return np.asarray(np.linalg.solve(C @ p @ C.T + noise, C @ p).T)


def balanced_regulator(F: Matrix, G: Matrix, weight: Matrix, size: Vector) -> Matrix:
    """Return K, shape (m, n), where u' u weighs 1, for states of some sizes, in any unit.

    Raises:
        WorkbenchError: If there is no such gain.

    Source: Laub, A Schur method for solving algebraic Riccati equations, IEEE Trans. AC-24, 1979;
    Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22, 2001.
    """
    from scipy.linalg.lapack import dgebal, dgges

    if not len(F):
        # Of what only passes commands on, such as a belt, there is nothing to estimate.
        return np.zeros(G.T.shape)
    f, g = F * size / size[:, None], G / size[:, None]
    q = weight * size * size[:, None]
    q = q + 1e-12 * np.trace(q) * np.eye(len(f))
    n, (left, right) = len(f), np.zeros((2, 2 * len(f), 2 * len(f)))
    left[:n, :n], left[n:, :n], left[n:, n:] = f, -q, np.eye(n)
    right[:n, :n], right[:n, n:], right[n:, n:] = np.eye(n), g @ g.T, f.T
    both = np.abs(left) + np.abs(right)
    np.fill_diagonal(both, 0.0)
    exponent = np.log2(dgebal(both, scale=1, permute=0)[3])
    even = np.exp2(np.round(0.5 * (exponent[n:] - exponent[:n])))
    scale = np.concatenate([even, 1.0 / even])
    left, right = left * scale[:, None] / scale, right * scale[:, None] / scale
    _, _, found, *_, ends, _, _ = dgges(
        lambda re, im, over: re * re + im * im < over * over, left, right, jobvsl=0, sort_t=1
    )
    ends = ends[:, :n] * np.concatenate([1.0 / even, even])[:, None]
    if found != n or not abs(np.linalg.det(ends[:n])) > 0.0:
        raise WorkbenchError(
            "no regulator exists for this linear model; a mode that grows or integrates is out of"
            " the commands' reach, or hardly shows in the outputs: follow another output, or take a"
            " PID"
        )
    p = np.linalg.solve(ends[:n].T, ends[n:].T)
    p = 0.5 * (p + p.T)
    return np.asarray(np.linalg.solve(np.eye(g.shape[1]) + g.T @ p @ g, g.T @ p @ f) / size)
