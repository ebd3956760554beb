"""Arrays as annotations name them, stretches of masks, and products summed as C code sums them."""

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]


def runs(mask: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last index of every stretch in which a mask is true.

    Example:
        >>> runs(np.array([True, True, False, True]))
        [(0, 1), (3, 3)]
    """
    edges = np.flatnonzero(np.diff(mask.astype(int), prepend=0, append=0))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def product(matrix: Matrix, vector: npt.ArrayLike) -> Matrix:
    """Multiply a matrix (m, n) by a vector (n,) or (n, k), in any units, column after column.

    Library routines sum in the order that suits the processor, and round differently on each. Where
    a law shall give the same digits in Python and in C, its sums have one order: from the first
    column to the last.
    """
    factors = np.asarray(vector, dtype=float)
    if len(matrix) == 1 and factors.size == len(factors):
        # A sum of one row would be taken in pairs; a running sum is not.
        return np.cumsum(matrix[0] * factors.ravel())[-1:].reshape(1, *factors.shape[1:])
    # In this memory order the sum runs over whole rows, one after the other.
    table = matrix.T if factors.ndim == 1 else matrix.T[:, :, None]
    found: Matrix = np.add.reduce(np.multiply(table, factors[:, None], order="C"), axis=0)
    return found
