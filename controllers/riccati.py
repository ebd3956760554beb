"""Gains of sampled linear systems from the discrete algebraic Riccati equation, in any units.

Source: Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, sections 6.4 and 6.5.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from workbench.arrays import Matrix


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
