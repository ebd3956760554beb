"""Free runs over windows of a recording, for models whose run over all of it drifts off.

A model may have effects beyond the ``nominal`` one that the recording was observed with.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.error_growth import GROWN
from workbench.diagnosis.estimation.free_run import FreeRun, as_recorded, free_runs, run_along
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.process_noise import extended_start
from workbench.diagnosis.estimation.start import fitted_start
from workbench.errors import NumericalError
from workbench.model import Model

MILD = 0.3
"""Process-noise scale of a little trust in the equations, dimensionless."""

_START_SHARE, _START_SAMPLES = 1 / 40, 10
"""Part of a recording, and least number of samples, that tell where its hidden states start."""

_COUNT = 20
_LEAST_SAMPLES, _LEAST_UNSTABLE = 25, 5
"""Least number of samples of a window; the second for an unstable model."""


def settled(model: Model, nominal: Model, observed: Observed) -> Observed:
    """Return a recording with a start fitted to its first fortieth.

    Which is too short for slow hidden states: from there on they may lead the whole run farther
    away than the start as it was, which is returned then.
    """
    begun = extended_start(observed, nominal, model)
    wanted = max(_START_SAMPLES, round(_START_SHARE * len(begun.outputs)))
    fitted = fitted_start(model, begun, samples=min(window_samples(observed), wanted))
    if observed.growth > 0.0:
        return fitted
    runs = free_runs(model, [begun, fitted])
    away = [
        np.nansum((run.error / observed.noise_rms) ** 2) if run.finite else np.inf for run in runs
    ]
    return begun if away[0] < away[1] else fitted


def window_samples(observed: Observed) -> int:
    """Return the length of a window in samples.

    A twentieth of the recording; two time constants of the fastest unstable mode at the most, for
    after more a run tells how well its start was known, not how well its equations hold.
    """
    count = len(observed.outputs)
    size = max(_LEAST_SAMPLES, count // _COUNT)
    if observed.growth > 0.0:
        longest = GROWN / (observed.growth * observed.sample_time)
        size = min(size, max(_LEAST_UNSTABLE, math.floor(min(longest, count))))
    return min(count, size)


def expected_outputs(
    model: Model, nominal: Model, observed: Observed, noise_scale: float = MILD
) -> Vector:
    """Return the measurements that the filter of a model expects along a recording.

    Args:
        noise_scale: Process-noise scale, dimensionless.

    Returns:
        Shape (n, n_used), in SI; NaN where there was no measurement.

    Raises:
        NumericalError: If the filter leaves the finite numbers.
    """
    begun = extended_start(observed, nominal, model)
    filter_ = filter_of(model, begun, noise_scale)
    return begun.as_recorded(filter_.expected(begun, filter_.run(begun, model.values)))


def windows(
    model: Model, nominal: Model, observed: Observed, noise_scale: float = MILD
) -> list[Observed]:
    """Cut a recording into windows, each with the start that the filter has there.

    At the first sample the filter knows little of hidden states; they are fitted.

    Args:
        noise_scale: Process-noise scale, dimensionless.

    Raises:
        NumericalError: If the filter leaves the finite numbers.
    """
    begun = extended_start(observed, nominal, model)
    states = filter_of(model, begun, noise_scale).run(begun, model.values).states
    states[0] = settled(model, nominal, observed).start
    count, size = len(begun.outputs), window_samples(observed)
    starts = list(range(0, max(count - size // 2, 1), size))
    return [
        replace(begun.part(slice(k, end)), start=state)
        for k, end, state in zip(starts, [*starts[1:], count], states[starts], strict=True)
    ]


def windowed_run(
    model: Model, nominal: Model, observed: Observed, noise_scale: float = MILD
) -> FreeRun:
    """Run a model freely over window after window of a recording.

    Args:
        noise_scale: Process-noise scale of the filter that starts the windows, dimensionless.

    Returns:
        The run beside the measurements; with the reason if the filter or the integrator gives up.
    """
    try:
        cut = windows(model, nominal, observed, noise_scale)
    except (NumericalError, np.linalg.LinAlgError) as error:
        return run_along(model, observed, failure=str(error))
    parts = free_runs(model, cut)
    failure = next((part.failure for part in parts if part.failure), "")
    window = len(cut[0].outputs) * observed.sample_time if len(cut) > 1 else 0.0
    simulated = np.concatenate([part.simulated for part in parts])
    return as_recorded(run_along(model, observed, simulated, failure, window), cut[0], observed)
