"""Judging on recordings that nothing was fitted on: prediction errors, then free runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from workbench.diagnosis.estimation.free_run import FreeRun, free_run
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    gain_interval,
)
from workbench.diagnosis.estimation.start import fitted_start
from workbench.model import Model

Vector = npt.NDArray[np.float64]

Runs = Mapping[str, FreeRun]
"""Free runs by recording."""

_START_S = 0.5
_BLOCK_S = 0.5


def settled_run(model: Model, nominal: Model, observed: Observed) -> FreeRun:
    """Run a model freely along a recording, from a start fitted to its first half second.

    Temperatures and speeds before the first sample are not read.

    Args:
        model: The model, with effects attached or not.
        nominal: The model that the recording was observed with.
        observed: The recording.

    Returns:
        The run beside the readings.

    Example:
        >>> from workbench.diagnosis.estimation.made_up import made_up, pushes
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(100, largest=200.0), sample_time=0.01)
        >>> settled_run(axis, axis, seen).finite
        True
    """
    begun = extended_start(observed, nominal, model)
    samples = min(len(begun.outputs), max(2, round(_START_S / begun.sample_time)))
    return free_run(model, fitted_start(model, begun, samples=samples))


def held_out_gain(
    before: Vector, fit: ProcessNoiseFit, judged: Sequence[Observed]
) -> tuple[float, float, float]:
    """Return the gain of log likelihood on held-out recordings, with its 99 % interval.

    Args:
        before: Cost of the other model on them by block, shape (n_blocks,), dimensionless.
        fit: The fitted model.
        judged: Held-out recordings, with a start for its model.

    Returns:
        The gain and the ends of its interval, dimensionless. Where the interval includes zero, the
        model is judged with a little less trust in it, if that gains more: a few moments that its
        law does not cover, such as impacts, must not hide the rest.

    Raises:
        NumericalError: If the filter leaves the finite numbers.

    Example:
        >>> from workbench.diagnosis.estimation.made_up import made_up, pushes
        >>> from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
        >>> from workbench.diagnosis.estimation.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> fit = fit_with_process_noise(axis, [seen], default_priors(axis, ["mass"]))
        >>> held_out_gain(blocks_of_cost(fit, [seen]), fit, [seen])[0]
        0.0
    """
    held_out = gain_interval(before, blocks_of_cost(fit, judged))
    milder = [scale for scale in LADDER if scale > fit.noise_scale]
    if held_out[1] > 0.0 or not milder:
        return held_out
    other = gain_interval(before, blocks_of_cost(replace(fit, noise_scale=milder[-1]), judged))
    return other if other[0] > held_out[0] else held_out


def runs_closer(base: ProcessNoiseFit, fit: ProcessNoiseFit, hold_out: Sequence[Observed]) -> bool:
    """Say whether a model reliably runs closer to held-out recordings than another.

    The squared errors of the free runs, each output's over its mean square under the other model,
    fall by an amount whose 99 % interval over resampled blocks excludes zero.

    Args:
        base: The other model, fitted.
        fit: The model, fitted.
        hold_out: Held-out recordings, with a start for the other model.

    Returns:
        Whether it does; not if a run fails.

    Example:
        >>> from workbench.diagnosis.estimation.made_up import made_up, pushes
        >>> from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
        >>> from workbench.diagnosis.estimation.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> fit = fit_with_process_noise(axis, [seen], default_priors(axis, ["mass"]))
        >>> runs_closer(fit, fit, [seen])
        False
    """
    pairs = [
        [settled_run(one.model, base.model, observed) for one in (base, fit)]
        for observed in hold_out
    ]
    if not all(run.finite for pair in pairs for run in pair):
        return False
    scale = np.nanmean(np.concatenate([first.error**2 for first, _ in pairs]), axis=0)
    before, after = (np.concatenate([_blocks(pair[i], scale) for pair in pairs]) for i in range(2))
    return gain_interval(before, after)[1] > 0.0


def _blocks(run: FreeRun, scale: Vector) -> Vector:
    relative = np.nan_to_num(run.error**2 / scale).sum(axis=1)
    size = max(1, round(_BLOCK_S / (run.time[1] - run.time[0])))
    return np.asarray(np.add.reduceat(relative, np.arange(0, len(relative), size)))


def held_out_errors(
    runs: Mapping[str, Runs], judging: Sequence[Observed]
) -> dict[str, dict[str, float]]:
    """Return the errors of free runs on all held-out recordings together.

    Args:
        runs: Free runs by model and recording.
        judging: Held-out recordings.

    Returns:
        Root mean square error by model and output, and the noise of the sensors as
        ``noise_floor``, in SI.
    """
    outputs = judging[0].used
    floor = dict(zip(outputs, judging[0].noise_rms.tolist(), strict=True))
    return {
        label: {o: _rms([run.rmse[o] for run in by_name.values()]) for o in outputs}
        for label, by_name in runs.items()
    } | {"noise_floor": floor}


def explained(fit: Mapping[str, Mapping[str, float]]) -> float:
    """Return the share of the held-out mean square error beyond the noise that is removed.

    Args:
        fit: Errors as `held_out_errors` returns them, in SI.

    Returns:
        The share, the mean over the outputs, 0 to 1, dimensionless; NaN if a run failed.

    Example:
        >>> explained(
        ...     {"refitted": {"y": 5.0}, "extended": {"y": 3.0}, "noise_floor": {"y": 3.0}}
        ... )
        1.0
    """
    shares = []
    for output, noise in fit["noise_floor"].items():
        before = fit["refitted"][output] ** 2 - noise**2
        after = fit["extended"][output] ** 2 - noise**2
        if math.isfinite(before) and before > 0:
            shares.append(1.0 - max(after, 0.0) / before)
    return float(np.clip(np.mean(shares), 0.0, 1.0)) if shares else math.nan


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
