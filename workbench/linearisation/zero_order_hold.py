"""Linear systems between samples."""

from __future__ import annotations

import numpy as np

from workbench.arrays import Matrix


def zero_order_hold(a: Matrix, b: Matrix, sample_time: float) -> tuple[Matrix, Matrix]:
    """Discretise dx/dt = a x + b u exactly, for inputs that are held over a sample, in s.

    Args:
        a: Shape (n, n), in SI.
        b: Shape (n, m), in SI.
        sample_time: Time between samples, in s.

    Source:
        Van Loan, IEEE Trans. AC-23, 1978.
    """
    from scipy.linalg import expm

    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a * sample_time, b * sample_time
    whole = expm(block)
    return whole[:n, :n], whole[:n, n:]
