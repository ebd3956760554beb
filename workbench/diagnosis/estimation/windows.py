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
from workbench.diagnosis.estimation.start import fitted_start, moved_starts
from workbench.errors import NumericalError
from workbench.model import Model

MILD = 0.3
"""Process-noise scale of a little trust in the equations, dimensionless."""

_START_SHARE, _MOST_SHARE, _START_SAMPLES = 1 / 40, 1 / 4, 10
"""Usual and largest part of a recording, and least number of samples, that tell where its hidden
states start."""

_START_PART = 0.1
"""Part of the error's square that a deviation of an unknown start has to make."""

_COUNT = 20
_LEAST_SAMPLES, _LEAST_UNSTABLE = 25, 5
"""Least number of samples of a window; the second for an unstable model."""


def settled(model: Model, nominal: Model, observed: Observed) -> Observed:
    """Return a recording with a start fitted to its first fortieth, or to as much as it shows in.

    A fortieth is too short for slow hidden states, such as the cells of a pipe: from there on they
    may lead the whole run farther away than the start as it was. Where what is not known of the
    start could be a part of the run's error, it is fitted to as many samples as that shows in. Of
    what was tried the start is returned whose run comes closest.
    """
    begun = extended_start(observed, nominal, model)
    count = len(begun.outputs)
    samples = min(window_samples(observed), max(_START_SAMPLES, round(_START_SHARE * count)))
    fitted = fitted_start(model, begun, samples=samples)
    if observed.growth > 0.0 or not begun.start.size:
        return fitted
    tried = [begun, fitted]
    runs = free_runs(model, [*tried, *moved_starts(model, fitted, samples=samples)])
    away = [_away(run, observed) for run in runs[:2]]
    off = [(run.simulated - runs[1].simulated) / observed.noise_rms for run in runs[2:]]
    moved = np.sum(np.square(off), axis=0)
    if np.sum(moved) > _START_PART * min(away):
        shows = int(np.flatnonzero(np.append(True, (moved > 1.0).any(axis=1)))[-1])
        if (most := min(shows, round(_MOST_SHARE * count))) > samples:
            tried.append(fitted_start(model, begun, samples=most))
            away += [_away(run, observed) for run in free_runs(model, tried[2:])]
    return tried[int(np.argmin(away))]


def _away(run: FreeRun, observed: Observed) -> float:
    """Return the sum of squares of a run's error over the noise."""
    return float(np.nansum((run.error / observed.noise_rms) ** 2)) if run.finite else math.inf


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
