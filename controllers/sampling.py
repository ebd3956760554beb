"""Sampled linear systems in a law: matrices as numbers, sums of them, anti-windup."""

from __future__ import annotations

from typing import Any

import numpy as np

from controllers.arithmetic import Number, Numbers
from workbench.arrays import Matrix

Rows = tuple[tuple[float, ...], ...]


def anti_windup(A: Matrix, C: Matrix, pole: float) -> Matrix:
    """Return L, shape (n, m) in SI, for which A - L C has this pole of the z-plane for slower ones.

    Modes of A that integrate, or nearly do, as many as there are commands, so follow what is
    applied while a command is at its end (anti-windup in observer form). Zeros where no mode is
    slower.

    Source:
        Åström and Wittenmark, Computer-Controlled Systems, 1997, section 9.4.
    """
    values, vectors = np.linalg.eig(A)
    order = np.argsort(-np.abs(values), kind="stable")[: len(C)]
    slow = [k for k in order if not values[k].imag and abs(values[k]) > pole]
    seen = (C @ vectors[:, slow]).real
    if not slow or np.linalg.norm(seen, -2) < 1e-12 * np.linalg.norm(C, 2):
        return np.zeros((len(A), len(C)))
    moved = vectors[:, slow].real * (values[slow].real - pole)
    return np.asarray(moved @ np.linalg.pinv(seen))


def total(start: Number, factors: tuple[float, ...], values: Numbers) -> Number:
    """Return start + sum of factors times values (in any units), in their order, without zeros."""
    for factor, value in zip(factors, values, strict=True):
        if factor:
            start = start + factor * value
    return start


def product(matrix: Rows, values: Numbers, start: Numbers = ()) -> Numbers:
    """Return start, by default nothing, + matrix times values (in any units), in their order."""
    return tuple(total(start[i] if start else 0.0, row, values) for i, row in enumerate(matrix))


def rows(matrix: Any) -> Rows:
    """Return a matrix, in any units, as a tuple of rows."""
    return tuple(tuple(row) for row in np.atleast_2d(np.asarray(matrix, dtype=float)).tolist())
