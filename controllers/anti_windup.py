"""The gain by which a sampled controller follows what is applied, in place of winding up."""

from __future__ import annotations

import numpy as np

from workbench.arrays import Matrix


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
