"""From a recording to what the filter needs: inputs, measurements, their noise, the start."""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import default_priors
from workbench.errors import WorkbenchError
from workbench.model import Model, Output
from workbench.recordings.recording import Recording

_START_SAMPLES = 3
"""Samples averaged for the first measurement, which is the best known of a rig at rest."""

_UPDATES = 8
"""Updates of a start by what it reads; a straight measurement needs one."""

_STILL = 5.0
"""Multiple of the noise by which the measurements of a rig at rest may differ."""

_CREEPS = 2.0
"""Standard deviations of a slope from which on first measurements creep."""

_COARSE, _ONE = 4.0, 1.5
"""Multiple of its noise from which on the steps of a sensor outlast it; usual change, in steps, up
to which it goes by one at a time."""


def recorded_outputs(model: Model, recording: Recording) -> list[Output]:
    """Return the outputs of a model that a recording has.

    Raises:
        WorkbenchError: If there are none, or an input is missing.
    """
    has = f"it has: {', '.join(recording.names)}"
    missing = [q.name for q in model.inputs if q.name not in recording]
    if missing:
        raise WorkbenchError(
            f"recording {recording.name!r} has no signal {missing[0]!r}, an input of"
            f" {model.name!r}; {has}. give a column that name, or map one to it"
        )
    outputs = [q for q in model.outputs if q.name in recording]
    if not outputs:
        raise WorkbenchError(
            f"recording {recording.name!r} has no output of {model.name!r}; {has}; wanted:"
            f" {', '.join(q.name for q in model.outputs)}. give a column that name, map one to it,"
            " or name another plant"
        )
    return outputs


def observe(model: Model, recording: Recording) -> Observed:
    """Bring a recording into the shape that the filter of a model needs.

    Inputs are clipped to their ranges; what goes straight from sample to sample has its mean
    between the two. Noise follows from the sensors' data; states that the first
    measurements determine start there, the others where the model starts.

    Raises:
        WorkbenchError: If an input is missing, no output was recorded, or the time is not uniform.
    """
    outputs = recorded_outputs(model, recording)
    steps = np.diff(recording.time)
    # The mean: times that are written with few digits have steps of two lengths.
    sample_time = float(np.mean(steps))
    if np.max(np.abs(steps - sample_time)) > 0.01 * sample_time:
        raise WorkbenchError(
            f"recording {recording.name!r} is not uniformly sampled (steps from"
            f" {steps.min():g} to {steps.max():g} s); resample it first"
        )
    noise = np.array(
        [np.hypot(q.noise_rms, q.resolution / np.sqrt(12)) or 1e-6 * q.scale for q in outputs]
    )
    read = recording.matrix([q.name for q in outputs])
    for column, quantity in enumerate(outputs):
        read[~recording.valid(quantity.name), column] = np.nan
    inputs = recording.matrix([q.name for q in model.inputs])
    inputs = np.clip(inputs, [q.lower for q in model.inputs], [q.upper for q in model.inputs])
    for name in model.traits.straight:
        column = [q.name for q in model.inputs].index(name)
        inputs[:-1, column] = 0.5 * (inputs[:-1, column] + inputs[1:, column])
    # Noise that fades within a sample is white.
    told = [(q.correlated_noise_rms, q.noise_correlation_time) for q in outputs]
    shared = [(rms, time) if time > sample_time else (0.0, 0.0) for rms, time in told]
    misread = dict(model.traits.misread)
    start, start_rms = _start(model, inputs[0], read, [q.name for q in outputs], noise)
    return Observed(
        recording.name,
        sample_time,
        inputs,
        read,
        tuple(q.name for q in outputs),
        noise,
        start,
        start_rms,
        _growth(model, start, inputs[len(inputs) // 2]),
        model.horizon,
        correlated_noise=_if_any(shared),
        relative_noise=_if_any([q.relative_noise_rms for q in outputs]),
        coarse=_if_any(_coarse(outputs, read)),
        input_noise=_if_any([misread.get(q.name, 0.0) for q in model.inputs]),
    )


def _if_any(values: npt.ArrayLike) -> Vector:
    """Return numbers by row as an array, without any row where all are zero."""
    every = np.asarray(values, dtype=float)
    return every if every.any() else every[:0]


def _coarse(outputs: Sequence[Output], read: Vector) -> Vector:
    """Return the steps of sensors that mostly go by one and are not drowned in noise, others 0."""
    steps = np.zeros(len(outputs))
    for column, q in enumerate(outputs):
        moved = np.abs(np.diff(read[np.isfinite(read[:, column]), column]))
        usual = np.median(moved[moved > 0.0]) if moved.any() else np.inf
        if max(_COARSE * q.noise_rms, usual / _ONE) < q.resolution:
            steps[column] = q.resolution
    return steps


def _growth(model: Model, x: Vector, u: Vector) -> float:
    rates = np.asarray(model.exact.jacobian_function(x, u, model.values)[0])
    if not np.isfinite(rates).all():
        return -math.inf
    return float(np.max(np.linalg.eigvals(rates).real, initial=-math.inf))


def _at_first(measured: Vector, noise: float) -> tuple[float, float]:
    """Return what the first measurements begin with while they stand still, and its deviation.

    Where they clearly creep, a straight line through them tells where from; of a later value, their
    mean, all that follows would be sure.
    """
    first = measured[:_START_SAMPLES]
    at = np.flatnonzero(np.isfinite(first))
    if not len(at):
        return math.nan, math.nan
    moved = np.abs(first[at] - first[at[0]]) > _STILL * noise
    at = at[: int(np.argmax(moved))] if moved.any() else at
    line = np.vander(at, 2, increasing=True).astype(float)
    if len(at) > 1:
        spread = np.linalg.inv(line.T @ line)
        begin, slope = spread @ line.T @ first[at]
        if abs(slope) > _CREEPS * noise * math.sqrt(spread[1, 1]):
            return float(begin), noise * math.sqrt(spread[0, 0])
    return float(np.mean(first[at])), noise / math.sqrt(len(at))


def _start(
    model: Model, inputs: Vector, read: Vector, names: Sequence[str], noise: Vector
) -> tuple[Vector, Vector]:
    """Correct the model's starting state by the first measurements, in Kalman updates.

    Where a measurement bends, as the voltage of a cell over its charge does, the next update is
    made about where the last one led (B. M. Bell and F. W. Cathey 1993).
    """
    spread = np.array([q.start_rms or q.scale for q in model.states])
    rows = [i for i, q in enumerate(model.outputs) if q.name in names]
    means = [_at_first(column, rms) for column, rms in zip(read.T, noise, strict=True)]
    first, rms = np.array(means).T
    known = np.isfinite(first)
    covariance, before = np.diag(spread**2), model.initial_state(u=inputs)

    def error(x: Vector) -> Vector:
        return np.asarray((first - model.read(x, inputs)[rows])[known])

    def misfit(x: Vector) -> float:
        return float(np.sum((error(x) / rms[known]) ** 2) + np.sum(((x - before) / spread) ** 2))

    x, nearer = before, before
    for update in range(_UPDATES):
        if update and not misfit(nearer) < misfit(x) - 1.0:
            break
        about = np.asarray(model.exact.jacobian_function(nearer, inputs, model.values)[2])
        if update and not np.isfinite(about).all():
            break
        x, slope = nearer, about[rows][known]
        variance = slope @ covariance @ slope.T + np.diag(rms[known] ** 2)
        gain = np.linalg.solve(variance, slope @ covariance).T
        nearer = before + gain @ (error(x) + slope @ (x - before))
    x = nearer if x is before else x
    given = {
        q.name: value
        for q, value, moved in zip(model.states, x, x - before, strict=True)
        if moved != 0.0
    }
    # States of effects start where the corrected states put them.
    x = model.initial_state(given, u=inputs)
    # A reading tells no more of a state than is known of the parameters between them.
    by_priors = gain @ _read_by_parameters(model, x, inputs)[rows][known]
    variance = np.diag(covariance - gain @ slope @ covariance) + np.sum(by_priors**2, axis=1)
    spread = np.sqrt(np.maximum(variance, 0.0))
    return x, np.maximum(spread, 1e-9 * np.array([q.scale for q in model.states]))


def _read_by_parameters(model: Model, x: Vector, u: Vector) -> Vector:
    """Return how far the uncertainty of each free parameter moves each reading, in its unit."""
    free = [
        i for i, q in enumerate(model.parameters) if q.fitted and math.isfinite(q.upper - q.lower)
    ]
    priors = default_priors(model, [model.parameters[i].name for i in free])
    trace = model.exact
    slopes = trace.function("slopes", ca.jacobian(trace.outputs, trace.p)[:, free])
    moved: Vector = np.asarray(slopes(x, u, model.values)) * np.array([q.std for q in priors])
    return moved
