"""Linear systems between samples."""

from __future__ import annotations

import numpy as np

from workbench.arrays import Matrix
from workbench.errors import WorkbenchError


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


def before_hold(a: Matrix, b: Matrix, sample_time: float) -> tuple[Matrix, Matrix]:
    """Return the continuous matrices, in SI, of which a sampled model with held inputs is made.

    Of those with the same samples it is the one that swings least in between.

    Args:
        a: Shape (n, n), dimensionless.
        b: Shape (n, m), in SI.
        sample_time: Time between samples, in s.

    Raises:
        WorkbenchError: If there is none.

    Source:
        Åström and Wittenmark, Computer-Controlled Systems, 1997, section 2.3 (inverse of sampling).
    """
    from scipy.linalg import logm

    n, m = b.shape
    poles = np.linalg.eigvals(a)
    late = int(np.sum(np.abs(poles) < _GONE))
    turning = poles[(np.abs(poles) >= _GONE) & (np.abs(np.angle(-poles)) < _TURNING)]
    if late:
        raise WorkbenchError(
            f"{late} pole{'s' if late > 1 else ''} at z = 0 {'are' if late > 1 else 'is'} a delay"
            " of whole samples, which no continuous model of this order has; leave the delay out"
            " and tell it to the design (delay)"
        )
    if len(turning):
        raise WorkbenchError(
            f"a pole at z = {turning[0].real:.3g} changes its sign at each sample, which no"
            " continuous model of this order does; give the continuous plant"
        )
    whole = np.vstack([np.hstack([a, b]), np.hstack([np.zeros((m, n)), np.eye(m)])])
    found = np.real(logm(whole)) / sample_time
    return found[:n, :n], found[:n, n:]


_GONE, _TURNING = 1e-4, 1e-6
"""What is left after a sample of what is gone, a ratio, and angle, in rad, from the negative axis
within which a pole lies on it."""
