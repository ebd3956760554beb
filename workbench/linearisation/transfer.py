"""The transfer function of a linear system."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Complex
from workbench.linearisation.linear_model import LinearModel


def transfer_function(A: Any, B: Any, C: Any, D: Any, s: npt.ArrayLike) -> Complex:
    """Return ``C (s I - A)^-1 B + D``, in SI, shape (*shape of s, p, m).

    Args:
        A: State matrix, shape (n, n), in SI.
        B: Input matrix, shape (n, m), in SI.
        C: Output matrix, shape (p, n), in SI.
        D: Feedthrough, shape (p, m), in SI.
        s: Complex frequencies, any shape, in rad/s; z (dimensionless) of a sampled system.

    Example:
        >>> abs(transfer_function([[-1.0]], [[1.0]], [[1.0]], [[0.0]], 1j).item()).__round__(4)
        0.7071
    """
    a, b = np.asarray(A, dtype=complex), np.asarray(B, dtype=complex)
    inner = np.asarray(s, dtype=complex)[..., None, None] * np.eye(len(a)) - a
    return np.asarray(np.asarray(C) @ np.linalg.solve(inner, b) + np.asarray(D), dtype=complex)


def frequency_response(linear: LinearModel, output: str, frequency_Hz: npt.ArrayLike) -> Complex:
    """Return the response of an output to the first input, shape (n,), in SI per SI.

    Args:
        frequency_Hz: Frequencies, shape (n,), in Hz.
    """
    s = 2j * np.pi * np.asarray(frequency_Hz, dtype=float)
    row = linear.output_names.index(output)
    return transfer_function(linear.A, linear.B, linear.C, linear.D, s)[:, row, 0]
