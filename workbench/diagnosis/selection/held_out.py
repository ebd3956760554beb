"""Judging on recordings that nothing was fitted on: prediction errors, then free runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.arrays import Vector
from workbench.computing.processes import in_order
from workbench.diagnosis.estimation.free_run import (
    FreeRun,
    as_recorded,
    free_run,
    rms_of,
    run_along,
)
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    gain_interval,
    summed_over_blocks,
)
from workbench.diagnosis.estimation.windows import (
    MILD,
    expected_outputs,
    settled,
    windowed_run,
    windows,
)
from workbench.errors import NumericalError
from workbench.model import Model

Runs = Mapping[str, FreeRun]
"""Free runs by recording."""

_SPOILT = 1.25
_DRAWS = 12


def settled_run(
    model: Model, nominal: Model, observed: Observed, noise_scale: float = MILD
) -> FreeRun:
    """Run a model freely along a recording, from a start fitted to as much as it shows in.

    Temperatures and speeds before the first sample are not read. A model that runs away from
    wherever it starts is run over windows.

    Args:
        noise_scale: Process-noise scale of the filter that starts the windows, dimensionless.
    """
    if observed.diverges:
        return windowed_run(model, nominal, observed, noise_scale)
    begun = settled(model, nominal, observed)
    return as_recorded(free_run(model, begun), begun, observed)


def pieces(fit: ProcessNoiseFit, nominal: Model, observed: Observed) -> list[Observed]:
    """Return what a model is run along to be judged: a recording, or its windows, with starts.

    Raises:
        NumericalError: If the filter leaves the finite numbers.
    """
    if observed.drifts:
        return windows(fit.model, nominal, observed, fit.noise_scale)
    return [settled(fit.model, nominal, observed)]


def judged_run(fit: ProcessNoiseFit, nominal: Model, observed: Observed) -> FreeRun:
    """Run a fitted model along a recording: freely, or in windows where that would drift off."""
    try:
        if observed.drifts:
            return windowed_run(fit.model, nominal, observed, fit.noise_scale)
        return settled_run(fit.model, nominal, observed)
    except (NumericalError, np.linalg.LinAlgError) as error:
        return run_along(nominal, observed, failure=str(error))


def over_floor(
    fit: ProcessNoiseFit, nominal: Model, judging: Sequence[Observed], *, jobs: int = 1
) -> dict[str, float]:
    """Return how far the runs of a fitted model on held-out recordings are from the noise.

    The floor is what the same runs would be off by if the model were right: they are repeated on
    measurements that the model itself gives, with the noise of the sensors, for parameters drawn
    from the distribution of their estimates.

    Returns:
        Root mean square error over that floor, by output, dimensionless; infinite where a run
        failed.
    """
    calls = [(_over_floor, (fit, nominal, seen, i)) for i, seen in enumerate(judging)]
    found = in_order(calls, jobs=jobs)
    total = np.sqrt(np.mean([floor for _, floor in found], axis=0)).tolist()
    errors = rms_of([error for error, _ in found])
    return {k: errors[k] / max(t, 1e-300) for k, t in zip(judging[0].used, total, strict=True)}


def _over_floor(
    fit: ProcessNoiseFit, nominal: Model, observed: Observed, number: int
) -> tuple[dict[str, float], Vector]:
    """Return the error of a run by output, and the mean square of its floor."""
    return judged_run(fit, nominal, observed).rmse, floor_of(fit, nominal, observed, seed=number)


def floor_of(fit: ProcessNoiseFit, nominal: Model, observed: Observed, *, seed: int = 0) -> Vector:
    """Return what the run of a fitted model along a recording would be off by if it were right.

    Returns:
        Mean square by output, shape (n_used,), in SI squared.
    """
    rng = np.random.default_rng(seed)
    own, read = _own_run(fit, nominal, observed)
    squares = []
    for _ in range(_DRAWS if own.finite else 0):
        other = fit.with_values(fit.refit.drawn(rng))
        noise = observed.noise(rng)
        given = observed.inputs
        if len(observed.input_noise):
            given = given + observed.input_noise * rng.normal(size=given.shape)
        run = judged_run(other, nominal, replace(observed, inputs=given, outputs=read + noise))
        if run.finite:
            squares.append(np.mean((own.simulated + noise - run.simulated) ** 2, axis=0))
    return np.asarray(np.mean(squares, axis=0) if squares else observed.all_noise_rms**2)


def _own_run(fit: ProcessNoiseFit, nominal: Model, observed: Observed) -> tuple[FreeRun, Vector]:
    """Return the run of a model, and what would be read near it if the model were right."""
    if not observed.diverges:
        begun = extended_start(observed, nominal, fit.model)
        own = as_recorded(free_run(fit.model, begun), begun, observed)
        return own, own.simulated
    # Run after run of its windows; what the filter expects of each sample has no jumps between.
    own = windowed_run(fit.model, nominal, observed, fit.noise_scale)
    if not own.finite:
        return own, own.simulated
    expected = expected_outputs(fit.model, nominal, observed, fit.noise_scale)
    return own, np.where(np.isfinite(expected), expected, own.simulated)


def held_out_gain(
    before: Vector, fit: ProcessNoiseFit, judged: Sequence[Observed], trusted: float = MILD
) -> tuple[tuple[float, float, float], Vector]:
    """Return the gain of log likelihood on held-out recordings, with its 99 % interval.

    Args:
        before: Cost of the other model on them by block, shape (n_blocks,), dimensionless.
        judged: Held-out recordings, with a start for its model.
        trusted: Process-noise scale of the other model, dimensionless.

    Returns:
        The gain and the ends of its interval, dimensionless, and the cost by block. Where the
        interval includes zero, the model is judged with ever less trust in it, a little or as much
        as in the other one, as long as that gains more: what its law does not cover, such as
        impacts, or the range that only unseen recordings reach, must not hide the rest.

    Raises:
        NumericalError: If the filter leaves the finite numbers.
    """
    blocks = blocks_of_cost(fit, judged)
    held_out = gain_interval(before, blocks)
    milder = [scale for scale in reversed(LADDER) if scale > fit.noise_scale and scale >= MILD]
    for scale in (*milder[:1], *(s for s in milder[1:] if s <= trusted)):
        if held_out[1] > 0.0:
            break
        mild = blocks_of_cost(replace(fit, noise_scale=scale), judged)
        other = gain_interval(before, mild)
        if other[0] <= held_out[0]:
            break
        held_out, blocks = other, mild
    return held_out, blocks


def shown_on_bounds(
    fit: ProcessNoiseFit,
    nominal: Model,
    fitting: Sequence[Observed],
    judging: Sequence[Observed],
    priors: Sequence[Prior],
) -> tuple[str, ...]:
    """Return the parameters on a bound whose usual value the held-out recordings refuse.

    Each is fixed at the mean of its prior, and the others are refitted. A bound to which a few
    moments of the fitted recordings have led is none that the others need, nor is one where the
    next sample is predicted a little better and what comes after it worse.
    """
    shown = []
    own = fit.refit.values
    for e in fit.refit.estimates:
        if not e.on_bound:
            continue
        try:
            usual = fit_with_process_noise(
                fit.model.with_parameters({e.name: e.prior.mean}),
                fitting,
                [p for p in priors if p.name != e.name],
                start={name: value for name, value in own.items() if name != e.name},
                noise_scale=fit.noise_scale,
                follow=False,
            )
            blocks = [blocks_of_cost(one, judging) for one in (usual, fit)]
        except NumericalError:
            continue  # Nothing is said of a value that was not tried.
        if gain_interval(*blocks)[1] <= 0.0:
            continue
        runs, usual_runs = (run_errors(one, nominal, judging) for one in (fit, usual))
        if runs.over(usual_runs) <= 1.0:
            shown.append(e.name)
    return tuple(shown)


def told_apart(one: Sequence[Vector], other: Sequence[Vector]) -> bool:
    """Say whether recordings prefer one law over another beyond chance.

    Args:
        one: Costs under the one by block of time, fitting and held-out recordings, dimensionless.

    Returns:
        Whether the 99 % interval of the difference excludes zero on either.
    """
    pairs = [(b, a) for a, b in zip(one, other, strict=False) if len(a) == len(b)]
    intervals = [gain_interval(b, a) for b, a in pairs]
    return any(low > 0.0 or high < 0.0 for _, low, high in intervals)


@dataclass(frozen=True)
class RunErrors:
    """How far the runs of a model are from recordings.

    Args:
        squares: Sum of the squared errors by block of time and output, shape (n_blocks, n_used), in
            SI squared; empty if a run failed.
        mean: Mean of the squared errors by output, shape (n_used,), in SI squared.
    """

    squares: Vector
    mean: Vector

    def closer_than(self, other: RunErrors, *, by: float = 0.0) -> bool:
        """Say whether these runs are reliably closer to the recordings than others.

        The squared errors, each output's over its mean under the others, fall by an amount whose
        99 % interval over resampled blocks excludes zero.

        Args:
            by: Part of the error that has to go, dimensionless.

        Returns:
            Whether they are; what can be run is closer than what cannot.
        """
        left, gain = self._beside(other)
        return gain > 0.0 and left <= 1.0 - by

    def spoilt_from(self, other: RunErrors) -> bool:
        """Say whether the error is larger than that of others by more than a quarter."""
        return self.over(other) > _SPOILT

    def over(self, other: RunErrors) -> float:
        """Return the error over that of others, dimensionless; infinite if a run failed."""
        return self._beside(other)[0]

    def _beside(self, other: RunErrors) -> tuple[float, float]:
        """Return the error over that of others, and the least gain over them."""
        if not self.squares.size:
            return math.inf, -math.inf
        if not other.squares.size:
            return 0.0, math.inf
        scale = np.where(other.mean > 0.0, other.mean, math.inf)
        before, after = ((e.squares / scale).sum(axis=1) for e in (other, self))
        left = math.sqrt(float(after.sum()) / max(float(before.sum()), 1e-300))
        return left, gain_interval(before, after)[1]


NO_RUNS = RunErrors(np.zeros((0, 0)), np.zeros(0))
"""What is known of runs that were not done or failed."""


def run_errors(fit: ProcessNoiseFit, nominal: Model, judged: Sequence[Observed]) -> RunErrors:
    """Run a fitted model along recordings and return its errors."""
    runs = [judged_run(fit, nominal, observed) for observed in judged]
    if not runs or not all(run.finite for run in runs):
        return NO_RUNS
    parts = [summed_over_blocks(np.nan_to_num(run.error**2)) for run in runs]
    mean = np.nanmean(np.concatenate([run.error**2 for run in runs]), axis=0)
    return RunErrors(np.concatenate(parts), mean)


def held_out_errors(
    runs: Mapping[str, Runs], judging: Sequence[Observed]
) -> dict[str, dict[str, float]]:
    """Return the errors of free runs on all held-out recordings together.

    Returns:
        Root mean square error by model and output, and the noise of the sensors as
        ``noise_floor``, in SI.
    """
    floor = dict(zip(judging[0].used, judging[0].all_noise_rms.tolist(), strict=True))
    errors = {k: rms_of([run.rmse for run in each.values()]) for k, each in runs.items()}
    return errors | {"noise_floor": floor}


def over_noise(fit: Mapping[str, Mapping[str, float]], label: str = "extended") -> dict[str, float]:
    """Return the errors of a model, as `held_out_errors` tells them, over the noise; a ratio."""
    return {o: fit[label][o] / max(n, 1e-300) for o, n in fit["noise_floor"].items()}


def start_floors(
    fits: Mapping[str, ProcessNoiseFit], nominal: Model, judging: Sequence[Observed]
) -> dict[str, dict[str, float]]:
    """Return what runs over windows would be off by if the model were right, with noisy starts.

    Returns:
        Root mean square error by model and output, in SI; empty where runs are not cut in windows.
    """
    if not judging[0].drifts:
        return {}
    outputs = judging[0].used
    floors = {
        label: np.sqrt(np.mean([floor_of(fit, nominal, seen) for seen in judging], axis=0))
        for label, fit in fits.items()
    }
    return {k: dict(zip(outputs, v.tolist(), strict=True)) for k, v in floors.items()}


def explained(
    fit: Mapping[str, Mapping[str, float]], floors: Mapping[str, Mapping[str, float]] | None = None
) -> float:
    """Return the share of the held-out mean square error beyond the noise that is removed.

    Args:
        fit: Errors as `held_out_errors` returns them, in SI.
        floors: What runs of each model are off by if it is right, by model and output, in SI; the
            noise of the sensors if none is given.

    Returns:
        The share, the mean over the outputs, 0 to 1, dimensionless; NaN if a run failed. An output
        counts by the part of its error that is beyond the noise: of one at its noise nothing can be
        explained.
    """
    removed, beyond = 0.0, 0.0
    for output, noise in fit["noise_floor"].items():
        before, after = (
            fit[label][output] ** 2 - ((floors or {}).get(label, {}).get(output, noise)) ** 2
            for label in ("refitted", "extended")
        )
        if math.isfinite(before) and before > 0:
            whole = fit["refitted"][output] ** 2
            removed += (before - max(after, 0.0)) / whole
            beyond += before / whole
    return float(np.clip(removed / beyond, 0.0, 1.0)) if beyond else math.nan
