"""The transfer function of a linear system."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Complex, Vector
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


def zeros_of(A: Any, b: Any, c: Any) -> Complex:
    """Return the zeros of ``c (s I - A)^-1 b``, in rad/s; z (dimensionless) of a sampled system.

    Args:
        A: State matrix, shape (n, n), in SI.
        b: Input column, shape (n,), in SI.
        c: Output row, shape (n,), in SI.

    Example:
        >>> zeros_of([[0.0, 1.0], [-2.0, -3.0]], [0.0, 1.0], [5.0, 1.0]).real.round(6)
        array([-5.])
    """
    from scipy.linalg import eigvals

    a = np.asarray(A, dtype=float)
    whole = np.block([[a, np.reshape(b, (-1, 1))], [np.reshape(c, (1, -1)), np.zeros((1, 1))]])
    with np.errstate(divide="ignore", invalid="ignore"):
        found = eigvals(whole, np.diag([1.0] * len(a) + [0.0]))
    return np.asarray(found[np.isfinite(found)], dtype=complex)


_NARROW, _BESIDE = 0.1, 12
"""Damping below which a resonance may fall between frequencies, and how many are added on each of
its sides."""


def with_modes(frequency: Vector, roots: npt.ArrayLike) -> Vector:
    """Return frequencies with more of them about lightly damped poles and zeros, in one unit.

    Args:
        frequency: Increasing frequencies, shape (n,).
        roots: Poles and zeros, shape (m,), in rad where the frequencies are.

    Example:
        >>> added = with_modes(np.array([1.0, 2.0]), [-1e-3 + 1.5j])
        >>> len(added), bool(np.abs(added - 1.5).min() == 0.0)
        (27, True)
    """
    found = np.asarray(roots, dtype=complex)
    narrow = found[(found.imag > 0.0) & (np.abs(found.real) < _NARROW * found.imag)]
    beside = [
        w + side * np.append(0.0, np.geomspace(max(abs(s), 1e-9 * w) / 4.0, _NARROW * w, _BESIDE))
        for s, w in zip(narrow.real, narrow.imag, strict=True)
        for side in (-1.0, 1.0)
    ]
    every = np.unique(np.concatenate([frequency, *beside]))
    return np.asarray(every[(every >= frequency[0]) & (every <= frequency[-1])])
