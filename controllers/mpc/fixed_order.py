"""Products of a matrix and a vector, summed in the order in which C code sums them.

Library routines sum in the order that suits the processor, and round differently on each. Where a
law shall give the same digits in Python and in C, its sums have one order: from the first column to
the last.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from workbench.arrays import Matrix


def product(matrix: Matrix, vector: npt.ArrayLike) -> Matrix:
    """Multiply a matrix (m, n) by a vector (n,) or (n, k), in any units, column after column."""
    factors = np.asarray(vector, dtype=float)
    if len(matrix) == 1 and factors.size == len(factors):
        # A sum of one row would be taken in pairs; a running sum is not.
        return np.cumsum(matrix[0] * factors.ravel())[-1:].reshape(1, *factors.shape[1:])
    # In this memory order the sum runs over whole rows, one after the other.
    table = matrix.T if factors.ndim == 1 else matrix.T[:, :, None]
    found: Matrix = np.add.reduce(np.multiply(table, factors[:, None], order="C"), axis=0)
    return found
