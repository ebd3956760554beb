"""Noise and resolution of sensors that a plant does not declare."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import free_run
from workbench.diagnosis.estimation.start import fit_to_few
from workbench.diagnosis.estimation.windows import settled, windowed_run
from workbench.errors import WorkbenchError
from workbench.model import Input, Model, Output
from workbench.model.units import from_si, of_difference, with_unit
from workbench.recordings.checks.noise import (
    BLOCK,
    all_white_rms,
    growing_rms,
    noise_of,
    usual_rms,
    white_rms,
)
from workbench.recordings.checks.quantisation import recorded_quantum
from workbench.recordings.checks.report import check_row
from workbench.recordings.recording import Recording

_COARSE = 2.0
"""Multiple of the declared noise and resolution beyond which a recorded step counts."""

_NOISIER, _SMOOTH, _SELDOM = 1.5, 0.02, 0.05
"""Recorded noise over the declared one from which on it counts; what an input may change by from
sample to sample, over its deviation, and the part of the samples at which it may by more."""

_ROUNDS = 3
"""Refits that look for the noise beside a model."""

_SCATTER = 5.0
"""Three standard deviations of an estimate of noise from one sample, over the noise."""

_CLEARLY_LESS = 0.7
"""Part of what successive samples do not share below which a model has foretold the rest."""

_WHITE = 1.1
"""Error of a run over what successive samples of it do not share up to which it is white."""

_EVEN = 0.5
"""Part of a white error's rms that its usual differences have, unless it comes in jumps."""


def as_coarse_as_recorded(
    model: Model, recordings: Sequence[Recording]
) -> tuple[Model, tuple[dict[str, str], ...]]:
    """Take the steps of measurements that are coarser than the plant declares, and say so.

    Rounding to steps of q is an error of q / sqrt(12) rms (W. R. Bennett 1948), which no law of the
    process explains.

    Returns:
        The model, and a row for each such measurement, as those of the checks of recordings.
    """
    outputs, rows = [], []
    for q in model.outputs:
        steps = {r.name: recorded_quantum(r, q.name) for r in recordings if q.name in r}
        name = max(steps, key=lambda recording: steps[recording], default="")
        if not name or steps[name] <= _COARSE * np.hypot(q.resolution, np.sqrt(12) * q.noise_rms):
            outputs.append(q)
            continue
        outputs.append(replace(q, resolution=steps[name]))
        unit = of_difference(q.display_unit)
        shown = [from_si(step, unit) for step in (steps[name], q.resolution)]
        note = (
            f"{q.name} has steps of {shown[0]:.3g} {unit}, where its sensor declares"
            f" {shown[1]:.3g}; they count as its noise"
        )
        rows.append(check_row(name, "resolution", "corrected", note))
    return replace(model, outputs=tuple(outputs)), tuple(rows)


def as_noisy_as_recorded(
    model: Model, recordings: Sequence[Recording]
) -> tuple[Model, tuple[str, ...]]:
    """Take the noise of sensors that is clearly more than they declare from the data, and say so.

    A filter that takes noise for motion moves parameters after it. Noise is what successive samples
    do not share, as white at higher differences, where no input changes from sample to sample.
    """
    outputs, notes = [], []
    for q in model.outputs:
        declared = math.hypot(q.noise_rms, q.resolution / math.sqrt(12.0))
        plain = not (q.relative_noise_rms or q.correlated_noise_rms or model.traits.misread)
        read = _plainly_read(model, recordings, q.name) if declared and plain else 0.0
        if not read > _NOISIER * declared:
            outputs.append(q)
            continue
        outputs.append(replace(q, noise_rms=read))
        unit = of_difference(q.display_unit)
        found, said = (with_unit(f"{from_si(rms, unit):.3g}", unit) for rms in (read, declared))
        notes.append(
            f"{q.name} is read with {found} rms of noise, where its sensor declares {said}"
        )
    return (replace(model, outputs=tuple(outputs)) if notes else model), tuple(notes)


def _plainly_read(model: Model, recordings: Sequence[Recording], name: str) -> float:
    """Return the least noise rms of a measurement in SI; 0 where one recording may hide motion."""
    whole = all(name in r and r.valid(name).all() for r in recordings)
    steady = all(_goes_on(r, q.name) for r in recordings for q in model.inputs)
    floors = [noise_of(r, name) for r in recordings] if whole and steady else []
    if not floors or any(f.upper_bound or not f.noise_rms > f.step for f in floors):
        return 0.0
    # What steps with an input counts in most blocks, but at few differences.
    usual = [rms for r in recordings if not math.isnan(rms := usual_rms(r[name]))]
    return min([*(f.noise_rms for f in floors), *usual])


def _goes_on(recording: Recording, name: str) -> bool:
    """Whether an input, if it was recorded, changes seldom or little from sample to sample."""
    if name not in recording:
        return True
    values = recording[name][recording.valid(name)]
    steps = np.abs(np.diff(values)) > _SMOOTH * np.std(values)
    return bool(np.mean(steps) < _SELDOM) if len(steps) else True


def with_noise(model: Model, recordings: Sequence[Recording]) -> Model:
    """Take noise and resolution of sensors that declare neither from the data."""
    outputs = []
    for q in model.outputs:
        # Of a sensor slower than the others there are numbers in some rows only.
        measured = _as_taken([r for r in recordings if q.name in r])
        read = [r[q.name][r.valid(q.name)] for r in measured]
        if q.noise_rms == 0 and q.resolution == 0 and read:
            step = max(recorded_quantum(r, q.name) for r in recordings if q.name in r)
            least = _least_rms(read)
            # Between steps that are coarser than the noise it does not show how it grows.
            rest, growing = growing_rms(read) if step < least else (least, 0.0)
            noise = max((rest if growing else least) ** 2 - step**2 / 12, 0.0) ** 0.5
            q = replace(q, noise_rms=noise, relative_noise_rms=growing, resolution=step)  # noqa: PLW2901
        outputs.append(q)
    return replace(model, outputs=tuple(outputs))


def _least_rms(read: Sequence[Vector]) -> float:
    """Return the least rms of noise that estimates tell of one sensor in several recordings."""

    def told(values: Vector) -> float:
        white = [white_rms(values, order=order, quantile=0.25) for order in (4, 6)]
        return min((w for w in (*white, usual_rms(values)) if np.isfinite(w)), default=0.0)

    # One estimate scatters; the least of many is too low.
    together = told(np.concatenate([v[: len(v) // BLOCK * BLOCK or None] for v in read]))
    alone = [(told(v), 1.0 - _SCATTER / math.sqrt(max(len(v), 1))) for v in read]
    return min([together, *(rms for rms, part in alone if rms < part * together)])


def unforetold(
    model: Model, recordings: Sequence[Recording], names: Sequence[str]
) -> dict[str, float]:
    """Return the noise of measurements beside a refitted model, in SI, by output.

    Of those that have clearly less noise than the model says, and of those that run freely to an
    error that is white: there nothing is missing, and the error is the noise.
    """
    found: dict[str, float] = {}
    recordings = _as_taken(recordings)
    for _ in range(_ROUNDS):
        trial = with_noise_of(model, found)
        other: dict[str, float] = {}
        with contextlib.suppress(WorkbenchError, np.linalg.LinAlgError):
            fit, seen = fit_to_few(trial, recordings)
            for one in seen:
                if one.drifts:
                    run = windowed_run(fit.model, trial, one, fit.noise_scale)
                else:
                    run = free_run(fit.model, settled(fit.model, trial, one))
                if not run.finite:
                    continue  # A run that diverged tells nothing of noise.
                for name, column, rms in zip(one.used, run.error.T, one.noise_rms, strict=True):
                    if name not in names:
                        continue
                    error = column[np.isfinite(column)]
                    # Lines between uneven samples leave neighbours noise in common, no others.
                    least, white = white_rms(error, quantile=0.25), all_white_rms(error[::2])
                    if least < _CLEARLY_LESS * rms:
                        other[name] = min(least, other.get(name, math.inf))
                    elif (
                        run.rmse[name] < _WHITE * white
                        and white > rms
                        # What jumps now and then, as a limit cycle out of step, is no noise.
                        and usual_rms(error[::2]) > _EVEN * white
                    ):
                        other[name] = max(white, other.get(name, 0.0))
        if not other:
            break
        found |= other
    return found


def with_noise_of(model: Model, noise: Mapping[str, float]) -> Model:
    """Return a model whose sensors have another noise, root mean square in SI, by output."""
    outputs = (replace(q, noise_rms=noise.get(q.name, q.noise_rms)) for q in model.outputs)
    return replace(model, outputs=tuple(outputs))


def _as_taken(recordings: Sequence[Recording]) -> Sequence[Recording]:
    """Return the recordings that tell the noise of a sample: others only where there are none."""
    return [r for r in recordings if not r.resampled] or recordings


def noise_text(q: Output) -> str:
    """Say which noise is taken of a sensor that declares none."""
    part = q.relative_noise_rms
    if not q.noise_rms and q.resolution:
        return f"the recordings' steps of {shown(q, q.resolution)} are taken for it"
    growing = f", and {100.0 * part:.2g} % of what it reads" if part else ""
    return f"{shown(q, q.noise_rms)} is taken from the recordings{growing}"


def shown(q: Input | Output, size: float) -> str:
    """Say a difference of what a signal tells, in SI, in its unit."""
    unit = of_difference(q.display_unit)
    return with_unit(f"{from_si(size, unit):.3g}", unit)
