"""Whether a model forgets its start along a recording, keeps it, or runs away from it."""

from __future__ import annotations

import numpy as np

from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.model import Model

_LOST = 7.0
"""Time constants of an unstable mode after which a thousandth has grown to all of a signal."""


def growth_rate(model: Model, observed: Observed) -> float:
    """Return how fast a deviation grows at the start of a recording, in 1/s.

    The largest real part of the eigenvalues of the linearised equations; negative where the model
    forgets its start, minus infinity where it has no states or cannot be linearised there.
    """
    slope = model.exact.jacobian_function
    middle = observed.inputs[len(observed.inputs) // 2]
    rates = np.asarray(slope(observed.start, middle, model.values)[0])
    if not np.isfinite(rates).all():
        return -np.inf
    return float(np.max(np.linalg.eigvals(rates).real, initial=-np.inf))


def drifts(model: Model, observed: Observed) -> bool:
    """Say whether a model integrates or is unstable, so that its free run drifts off.

    Its slowest mode forgets nothing over the length of the recording.
    """
    return growth_rate(model, observed) > -1.0 / _length(observed)


def diverges(model: Model, observed: Observed) -> bool:
    """Say whether a model is so unstable that its run along a whole recording tells nothing."""
    return growth_rate(model, observed) > _LOST / _length(observed)


def _length(observed: Observed) -> float:
    return observed.sample_time * len(observed.outputs)
