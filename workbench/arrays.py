"""Arrays as annotations name them, whose shapes stand where they are used; stretches of masks."""

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
