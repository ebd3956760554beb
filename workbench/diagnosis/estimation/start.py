"""The start of a recording where the first measurements do not tell all states."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from workbench.arrays import Matrix, Vector
from workbench.diagnosis.estimation.free_run import free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.priors import Prior, default_priors
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    PERFECT,
    ProcessNoiseFit,
    fit_with_process_noise,
    likely_scale,
)
from workbench.errors import NumericalError, check_range
from workbench.model import Model
from workbench.recordings.recording import Recording

FEW = 2
"""Recordings that are used where a model is looked at before a diagnosis."""

_ITERATIONS = 12

_MET, _LOOKED_AT = (10, 30, 100), 1000
"""Samples that a start is fitted to, and samples that tell whether it is likely."""

_ROUNDS = 3

_HIDDEN, _NEARER, _CLEARLY = 0.01, (0.3, 0.1), 20.0
"""Uncertainty of a start, over the size of its state, that a fit may lessen; shares of it that are
left; and log likelihood that a fitted start must gain."""

_BEYOND = 3.0
"""Standard deviations of what is known of a start from which on equations are wrong about it that
leave something out."""


def fit_with_likely_starts(
    model: Model, recordings: Sequence[Observed], priors: Sequence[Prior]
) -> tuple[ProcessNoiseFit, tuple[Observed, ...]]:
    """Refit a model, and again from the starts that the refitted one finds clearly more likely.

    Returns:
        The refit at its most likely process-noise scale, and the recordings with its starts.
    """
    best, seen = fit_with_process_noise(model, recordings, priors), tuple(recordings)
    for _ in range(_ROUNDS):
        pairs = zip(recordings, seen, strict=True)
        started = tuple(likely_start(best.model, *pair, best.noise_scale) for pair in pairs)
        if all(a is b for a, b in zip(started, seen, strict=True)):
            break
        trial = fit_with_process_noise(model, started, priors, start=best.refit.values)
        if trial.cost > best.cost - _CLEARLY:
            break
        best, seen = trial, started
    return _trusted(model, seen, priors, best), seen


def fit_to_few(
    model: Model, recordings: Sequence[Recording], priors: Sequence[Prior] | None = None
) -> tuple[ProcessNoiseFit, tuple[Observed, ...]]:
    """Refit a model to the first recordings, with likely starts, to see what they hold besides.

    Args:
        priors: Priors of the free parameters; the default ones if not given.
    """
    seen = [observe(model, r) for r in recordings[:FEW]]
    return fit_with_likely_starts(model, seen, default_priors(model) if priors is None else priors)


def _trusted(
    model: Model, seen: Sequence[Observed], priors: Sequence[Prior], found: ProcessNoiseFit
) -> ProcessNoiseFit:
    """Refit from the priors at the first scale that was refused, if that is clearly likelier.

    With little trust in the equations, parameters may go where no step leads back from: beside a
    coarse encoder any friction is as likely, and with that the equations seem to lack something.
    That is looked at where one has gone as far as it may.
    """
    if found.noise_scale <= PERFECT or not any(e.on_bound for e in found.refit.estimates):
        return found
    refused = next(scale for scale in LADDER if scale < found.noise_scale)
    try:
        trial = fit_with_process_noise(model, seen, priors, noise_scale=refused)
    except NumericalError:
        return found
    return trial if trial.cost < found.cost - _CLEARLY else found


def likely_start(
    model: Model, observed: Observed, now: Observed, noise_scale: float = 0.0
) -> Observed:
    """Return a recording with a fitted start where that is clearly likelier than its present one.

    A filter that begins with a wide guess takes the equations for straight lines as far as the
    guess reaches. Where they are not, as in a product of two hidden states, it becomes sure of what
    is wrong.

    Args:
        observed: The recording as it came.
        now: The same with a start of before.
        noise_scale: How far the equations are from what was recorded, dimensionless. Those that
            leave something out are no reason to be surer of a start than by how far they move it: a
            gas whose law is wrong would begin 40 K off, for every law that is tried afterwards.
            Nor are they one to move it beyond what is known of it.
    """
    if np.all(observed.start_rms < _HIDDEN * np.array([q.scale for q in model.states])):
        return now
    count = min(_LOOKED_AT, len(observed.outputs))
    first = observed.part(slice(count))
    filter_ = filter_of(model, first, likely_scale(model, [first], {}))
    best, least = now, math.inf
    with contextlib.suppress(NumericalError):
        present = replace(first, start=now.start, start_rms=now.start_rms)
        least = filter_.run(present, model.values).cost
    for samples in (n for n in _MET if n <= count):
        try:
            start = fitted_start(model, first, samples=samples).start
        except (NumericalError, np.linalg.LinAlgError):
            continue
        away = np.abs(start - observed.start)
        if noise_scale > PERFECT and np.any(away > _BEYOND * observed.start_rms):
            continue
        for share in _NEARER:
            rms = share * observed.start_rms
            if noise_scale > PERFECT:
                rms = np.maximum(rms, away)
            with contextlib.suppress(NumericalError):
                trial = replace(first, start=start, start_rms=rms)
                cost = filter_.run(trial, model.values).cost + _CLEARLY
                if cost < least:
                    best, least = replace(observed, start=start, start_rms=rms), cost
    return best


def slopes_within(
    function: Callable[[Vector], Vector],
    x: Vector,
    here: Vector,
    step: float | Vector,
    high: Vector,
) -> Vector:
    """Return the slopes of a function by one-sided differences, none of them across a limit.

    Args:
        x: Where they are taken, shape (n,), in any unit.
        here: What the function is there, shape (m,), in any unit.
        step: How far it is moved, in the unit of x.
        high: Largest x, shape (n,), in its unit.

    Returns:
        Shape (m, n).
    """
    steps = np.where(x + step > high, -step, step)
    moved = (function(x + np.where(np.arange(len(x)) == i, steps, 0.0)) for i in range(len(x)))
    return np.column_stack([(there - here) / h for there, h in zip(moved, steps, strict=True)])


def fitted_start(model: Model, observed: Observed, *, samples: int) -> Observed:
    """Estimate the start of a recording so that a free run meets its first measurements.

    Levenberg-Marquardt on the free-run error over the first samples, with the start that the
    recording came with, and its uncertainty, as prior. States that the measurements determine at
    once keep their value; a hidden one, such as the level of an upper tank, takes some samples to
    show.

    Args:
        samples: Number of samples to meet, 2 to the length of the recording.

    Returns:
        The recording with the estimated start; its uncertainty stays.
    """
    if not observed.start.size:
        return observed
    misfit, rms, (low, high) = _misfit(model, observed, samples)
    x, damping = observed.start.astype(float), 1e-3
    e = misfit(x)
    for _ in range(_ITERATIONS):
        jacobian = slopes_within(misfit, x, e, 1e-3 * rms, high)
        normal = jacobian.T @ jacobian
        for _ in range(5):
            damped = normal + damping * np.diag(np.diag(normal))
            trial = np.clip(x - np.linalg.solve(damped, jacobian.T @ e), low, high)
            trial_e = misfit(trial)
            if trial_e @ trial_e < e @ e:
                break
            damping *= 10
        else:
            break
        gained = e @ e - trial_e @ trial_e
        x, e, damping = trial, trial_e, max(damping / 10, 1e-9)
        if gained < 1e-3:
            break
    return replace(observed, start=x)


def moved_starts(model: Model, fitted: Observed, *, samples: int) -> list[Observed]:
    """Return a recording with starts that are a deviation off what met its first samples.

    Each is off along another axis of what is not known of it.

    Args:
        fitted: The recording with the start that `fitted_start` found.
        samples: Number of samples that it met.
    """
    misfit, rms, (_, high) = _misfit(model, fitted, samples)
    x = fitted.start.astype(float)
    jacobian = slopes_within(misfit, x, misfit(x), 1e-3 * rms, high)
    # J^T J is the inverse of the covariance.
    _, size, axes = np.linalg.svd(jacobian * rms, full_matrices=False)
    return [
        replace(fitted, start=x + rms * axis / max(1e-12, length))
        for axis, length in zip(axes, size, strict=True)
    ]


def _misfit(
    model: Model, observed: Observed, samples: int
) -> tuple[Callable[[Vector], Vector], Vector, Matrix]:
    """Return the misfit of a start, what is known of it, and its limits, lower ones first."""
    count = round(check_range("samples", samples, 2, len(observed.outputs)))
    first = observed.part(slice(count))
    own = model.states[: len(observed.start)]
    rms = np.maximum(observed.start_rms, [1e-12 * q.scale for q in own])

    def misfit(x: Vector) -> Vector:
        run = free_run(model, replace(first, start=x))
        error = np.nan_to_num(run.error / observed.noise_rms, nan=0.0 if run.finite else 1e6)
        return np.concatenate([error.ravel(), (observed.start - x) / rms])

    return misfit, rms, np.array([(q.lower, q.upper) for q in own]).T
