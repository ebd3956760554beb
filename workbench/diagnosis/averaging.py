"""Recordings sampled far faster than their plant moves, as means of neighbouring rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.observe import observe
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.units import in_time
from workbench.recordings.checks.noise import NoiseFloor, noise_of
from workbench.recordings.recording import Recording, Signal
from workbench.simulation import Trajectory, simulate

_ENOUGH = 10_000
"""Rows of all recordings together beyond which a diagnosis takes minutes."""

_LOST = 0.05
"""Part of the means, and of how far the plant moves, that may be lost where an input jumps."""

_SHOWN = 2.0
"""Log likelihood by which the other means of a recording may be off: no effect needs so little."""


def averaged(
    model: Model, recordings: Sequence[Recording], even: Callable[[Recording], Recording]
) -> tuple[Model, list[Recording], str]:
    """Take means of neighbouring rows of long recordings, as far as their plant allows it.

    White noise of a mean of n readings is smaller by the root of n, so nothing is lost where the
    plant, run along the inputs as they are, is on average over n rows where the means of the inputs
    take it in the middle of them. Where it is not, as after a jump of an input, the mean is left
    out. A sensor whose steps hide its noise gains nothing: its reading in the middle counts.

    Args:
        recordings: With steps of one mean length.
        even: Gives a recording even steps.

    Returns:
        The model, whose sensors declare as much less noise; the recordings, the same ones where
        there are few rows or all are needed; what was done.
    """
    rows = sum(len(r) for r in recordings)
    counts = range(2 * (rows // _ENOUGH // 2) + 1, 1, -2)
    if not counts:
        return model, list(recordings), ""
    given = [even(r) for r in recordings]
    noise = [{q.name: noise_of(r, q.name) for q in model.outputs if q.name in r} for r in given]
    coarse = {n for known in noise for n, floor in known.items() if math.isnan(floor.noise_rms)}
    try:
        runs = [_run(model, r) for r in given]
        for count in counts:
            made = [
                _readings(model, *each, coarse, count)
                for each in zip(given, runs, noise, strict=True)
            ]
            if all(made):
                break
        else:
            return model, list(recordings), ""
    except WorkbenchError:  # Refit and checks say what is wrong with it.
        return model, list(recordings), ""
    gain = math.sqrt(count)
    outputs = tuple(
        q
        if q.name in coarse
        else replace(
            q,
            noise_rms=math.hypot(q.noise_rms, q.resolution / math.sqrt(12.0)) / gain,
            relative_noise_rms=q.relative_noise_rms / gain,
            resolution=0.0,
        )
        for q in model.outputs
    )
    step = given[0].sample_time
    note = (
        f"{rows} rows, one every {in_time(step)}, are more than {model.name} needs: means of"
        f" {count} rows, one every {in_time(count * step)}, tell as much"
    )
    return replace(model, outputs=outputs), [r for r in made if r is not None], note


def _run(model: Model, recording: Recording, start: Vector | None = None) -> Trajectory:
    """Run a model along a recording, from the start that it shows if none is given."""
    seen = observe(model, recording)
    begin, step = seen.start if start is None else start, seen.sample_time
    return simulate(model, seen.inputs, sample_time=step, start=begin, check=False)


def _readings(
    model: Model,
    recording: Recording,
    run: Trajectory,
    noise: dict[str, NoiseFloor],
    coarse: set[str],
    count: int,
) -> Recording | None:
    """Return a recording with a row for each ``count``; None if too many are no readings."""
    made = _fewer(recording, coarse, count)
    means = _run(model, made, run.states[count // 2])
    for name, floor in noise.items():
        signal = recording.signal(name)
        whole = recording.with_signal(replace(signal, values=run[name]))
        rms = floor.floor if name in coarse else floor.floor / math.sqrt(count)
        told = _fewer(whole, coarse, count)[name]
        squares = ((told - means[name]) / rms) ** 2
        nearest = np.argsort(squares)
        off = np.zeros(len(made), dtype=bool)
        off[nearest] = np.cumsum(squares[nearest]) > 2.0 * _SHOWN
        moved = np.abs(np.gradient(told))
        if np.mean(off) > _LOST or np.nansum(moved[off]) > _LOST * np.nansum(moved):
            return None
        values = np.where(off, np.nan, made[name])
        made = made.with_signal(replace(made.signal(name), values=values))
    return made


def _fewer(recording: Recording, coarse: set[str], count: int) -> Recording:
    """Return a recording with one row for each ``count``, at the middle one of them.

    What is held has its mean from one middle to the next.
    """
    middle = np.arange(count // 2, len(recording) - count // 2, count)

    def at_middle(signal: Signal) -> Vector:
        if signal.name in coarse:
            return signal.values[middle]
        values = np.where(recording.valid(signal.name), signal.values, np.nan)
        if signal.zero_order_hold:
            values = np.append(signal.values, np.full(count, signal.values[-1]))
        first = middle if signal.zero_order_hold else middle - count // 2
        means: Vector = np.mean(values[first[:, None] + np.arange(count)], axis=1)
        return means

    return replace(
        recording,
        time=recording.time[middle],
        signals=tuple(replace(s, values=at_middle(s)) for s in recording.signals),
    )
