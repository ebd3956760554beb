"""How fast neighbouring trajectories part along a recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import expm

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.errors import NumericalError

GROWN = 2.0
"""Logarithm by which an error may grow in a run that is to tell how well its equations hold."""

_PARTS, _LOOKS = 20, 10
"""Parts of a recording that are looked at, and samples in each."""


def growth_along(fit: ProcessNoiseFit, observed: Observed) -> Observed:
    """Return a recording with the growth of a small error of the fitted model's states along it.

    Linearised where the filter finds the states, an error goes through each part of the recording
    by the product of the exponentials, and grows as its spectral radius. A plant that passes
    through unstable places, such as an ignition, may look stable where the recording starts: where
    an error grows e2 times in any stretch, the growth is that of the worst part; elsewhere it is
    that from the first sample to the last, of a constant system its slowest eigenvalue.

    Returns:
        The recording; the same one where the filter leaves the finite numbers.
    """
    model = fit.model
    if not model.states or len(observed.outputs) < _PARTS * _LOOKS:
        return observed
    try:
        states = filter_of(model, observed, fit.noise_scale).run(observed, model.values).states
    except NumericalError:
        return observed
    at = np.arange(_PARTS * _LOOKS) * len(states) // (_PARTS * _LOOKS)
    x, u = states[at], observed.inputs[at]
    rates = np.asarray(model.exact.jacobian_function(x.T, u.T, model.values)[0])
    each = rates.reshape(len(x[0]), len(at), -1).transpose(1, 0, 2)
    if not np.isfinite(each).all():
        return observed
    step = observed.sample_time * len(states) / len(at)
    parts = [_carried(part, step) for part in each.reshape(_PARTS, _LOOKS, *each.shape[1:])]
    alone = [_grown([part]) for part in parts]
    most = max(_grown(parts[i:k]) for i in range(_PARTS) for k in range(i + 1, _PARTS + 1))
    rate = max(alone) / (step * _LOOKS) if most > GROWN else _grown(parts) / (step * len(at))
    return replace(observed, growth=rate)


def _carried(rates: Vector, step: float) -> tuple[Vector, float]:
    """Return what rates, each held for a step, do to an error: a matrix and a logarithm before it.

    What all modes share stands in the logarithm: nothing overflows.
    """
    size = rates.shape[1]
    product, logarithm = np.eye(size), 0.0
    for rate in rates:
        shared = float(np.max(np.linalg.eigvals(rate).real))
        product = expm((rate - shared * np.eye(size)) * step) @ product
        product, logarithm = _scaled(product, logarithm + shared * step)
    return product, logarithm


def _grown(parts: Sequence[tuple[Vector, float]]) -> float:
    """Return the logarithm of the spectral radius of one part after the other."""
    product, logarithm = parts[0]
    for matrix, more in parts[1:]:
        product, logarithm = _scaled(matrix @ product, logarithm + more)
    return logarithm + math.log(max(float(np.abs(np.linalg.eigvals(product)).max()), 1e-300))


def _scaled(product: Vector, logarithm: float) -> tuple[Vector, float]:
    largest = float(np.abs(product).max()) or 1.0
    return product / largest, logarithm + math.log(largest)
