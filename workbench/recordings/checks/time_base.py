"""Does the time run forward, in even steps, without repeats, in the unit it claims?"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.model.units import in_time
from workbench.recordings.checks.check import MIN_SAMPLES, Finding, check
from workbench.recordings.checks.expected import Expected, expectations
from workbench.recordings.recording import Recording
from workbench.recordings.resampling import low_pass, resample

_TOLERANCE = 0.02

_COURSE = 0.1
"""Share of the sampling rate up to which a signal counts as its course."""

_ORDER, _LIMIT, _CLEARLY = 4, 4.0, 4.0
"""Order of the difference that leaves what is irregular, and sigmas beyond which it is an impact,
and by which a clock must be told to be uneven alone."""


def jitter(time: Vector) -> float:
    """Return the scatter of the steps of a time base, as a fraction of the mean step.

    Args:
        time: Increasing instants, shape (n,), in s.
    """
    steps = np.diff(time)
    return float(np.std(steps) / np.mean(steps))


def evened(recording: Recording) -> Recording:
    """Return a recording with even steps, interpolated where its own are not."""
    return check_uniformity(recording).recording or recording


@check("uniformity", 100)
def check_uniformity(recording: Recording, _expected: Expected) -> Finding:
    """Check that the samples are evenly spaced; interpolate them to an even base if not.

    Jitter is the deviation of the instants from the best even time base. Up to 2 % of a step
    passes: at the largest speed of a signal it is an error of 2 % of one sample's change.
    """
    time = recording.time
    index = np.arange(len(time))
    step = float((time[-1] - time[0]) / (len(time) - 1))
    deviation = time - (time[0] + step * index)
    deviation -= np.median(deviation)
    steps = np.diff(time)
    rms, spread = jitter(time), (float(steps.min()), float(steps.max()))
    values = {"sample_time": step, "jitter_rms": rms * step, "steps": spread}
    if np.max(np.abs(deviation)) <= _TOLERANCE * step or (
        rms < 0.5 * _TOLERANCE and spread[1] - spread[0] < _TOLERANCE * step
    ):
        return Finding(
            "pass",
            f"even steps of {in_time(step, 6)} (jitter {max(100 * rms, 0.001):.2g} % of a step)",
            values,
        )
    vary = (
        f"the steps vary from {in_time(spread[0], 4)} to {in_time(spread[1], 4)}"
        f" ({100 * rms:.3g} % rms)"
    )
    asked = _asked(time)
    if asked is not None:
        between = f"{len(time) - len(asked)} row(s) stand between even instants"
        note = f"{vary}: {between} and are left out; a command that changes there takes its mean"
        return Finding("corrected", note, values, resample(recording, times=asked))
    regular = _line(time)
    late = time - regular
    near = bool(np.max(np.abs(late)) < 0.5 * step)
    if near and not _shown(recording, late, step):
        note = f"{vary}, which no measurement shows: only the clock does, the samples are even"
        return Finding("corrected", note, values, recording.at_times(regular))
    even = np.linspace(time[0], time[-1], len(time))
    if near:
        even = regular + max(time[0] - regular[0], 0.0)
    note = f"{vary}; interpolated to one every {in_time(even[1] - even[0], 4)}"
    return Finding("corrected", note, values, resample(recording, times=even))


def _asked(time: Vector) -> Vector | None:
    """Return the even instants beside which a simulation wrote its events too; None if it did not.

    Each of them is there, and others are.
    """
    usual = float(np.median(np.diff(time)))
    steps = (time - time[0]) / usual
    even = np.unique(np.round(steps[np.abs(steps - np.round(steps)) < _TOLERANCE]))
    whole = len(even) == even[-1] + 1 < len(time) and steps[-1] - even[-1] < 1.0
    return time[0] + usual * even if whole else None


def _line(time: Vector) -> Vector:
    """Return the even instants that all stamps together tell, in s.

    The first and the last one are as late as any: between them alone steps would be off by that.
    """
    index = np.arange(len(time)) - 0.5 * (len(time) - 1)
    step = float(index @ (time - time[0]) / (index @ index))
    return np.asarray(float(np.mean(time)) + step * index)


def _shown(recording: Recording, deviation: Vector, step: float) -> bool:
    """Whether samples were taken at uneven times, and not only stamped late or early.

    A moving signal that is read late is off by its slope times that. Least squares of what is
    irregular in the measurements on that gives 1 of it or, where a logger stamps what a converter
    took evenly, nothing.

    Args:
        deviation: Time of each row less that of an even base, shape (n,), in s.
        step: Mean step, in s.
    """
    product, square = 0.0, 0.0
    for name in recording.measurements:
        values = recording[name]
        if not np.isfinite(values).all() or np.ptp(values) == 0.0:
            continue
        slope = np.gradient(low_pass(values, _COURSE), step)
        irregular, late = np.diff(values, _ORDER), np.diff(slope * deviation, _ORDER)
        rms = 1.4826 * float(np.median(np.abs(irregular)))
        if rms > 0.0:
            product += float(np.clip(irregular / rms, -_LIMIT, _LIMIT) @ late) / rms
            square += float(late @ late) / rms**2
    # Differences of white noise go with their neighbours: less sure by up to the order.
    return bool(product > 0.5 * square - _CLEARLY * np.sqrt(_ORDER * square))


_FINER = ((1e3, "ms"), (1e6, "us"), (1e9, "ns"))
_EPOCH = (1e9, 4e9)
"""Seconds since 1970 from 2001 to 2096."""
_SHORTEST_STEP = 1e-8
_LONGEST_STEP = 1e5
"""A day and more; where no model says how fast the machine is, one that is sampled more slowly is
a clock read in another unit."""


def _in_order(recording: Recording) -> tuple[Recording, str] | str:
    """Sort swapped rows, or keep the longest stretch after a clock that was reset."""
    time = recording.time
    breaks = np.flatnonzero(np.diff(time) < 0)
    if not breaks.size:
        return recording, ""
    order = np.argsort(time, kind="stable")
    steps = np.diff(time[order])
    usual = float(np.median(np.abs(np.diff(time))))
    regular = np.mean((steps > 0.3 * usual) & (steps < 3 * usual)) > 0.95
    if regular and breaks.size < 0.05 * len(time):
        return recording.take(order), f"{breaks.size} row(s) out of order were sorted by time"
    back = f"the time runs backwards {breaks.size} time(s), the first after {time[breaks[0]]:g} s"
    edges = [0, *(breaks + 1), len(time)]
    first, stop = max(pairwise(edges), key=lambda ends: ends[1] - ends[0])
    if stop - first < max(0.5 * len(time), MIN_SAMPLES):
        split = "no stretch holds half of the recording: split the file where the clock restarts"
        return f"{back}; {split}"
    kept = f"the longest stretch was kept ({stop - first} of {len(time)} rows)"
    return recording.take(slice(first, stop)), f"{back}; {kept}"


def _clock_put_back(recording: Recording) -> tuple[Recording, str]:
    """Take the hour away by which clocks are put back in autumn, where all else goes on evenly."""
    time = recording.time
    steps = np.diff(time)
    usual = float(np.median(np.abs(steps)))
    back = np.flatnonzero(np.abs(steps + _HOUR - usual) < 0.6 * usual)
    others = np.delete(steps, back)
    if len(back) != 1 or usual > 0.1 * _HOUR or np.mean((others > 0.0) & (others < 3 * usual)) < 1:
        return recording, ""
    later = np.where(np.arange(len(time)) > back[0], _HOUR, 0.0)
    note = f"the clock was put back by an hour after {time[back[0]]:g} s, which is taken out"
    return replace(recording, time=time + later), note


_HOUR = 3600.0


def _spread(time: Vector) -> Vector | None:
    """Spread instants of a coarse clock evenly; None if the repeats are not regular."""
    instants, first, counts = np.unique(time, return_index=True, return_counts=True)
    if len(instants) < 3 or counts[1:-1].max() > 3 * np.median(counts):
        return None
    step = (instants[-1] - instants[0]) / (first[-1] - first[0])
    even = instants[0] + step * np.arange(len(time))
    near = np.max(np.abs(even - time)) <= 2 * np.max(np.diff(instants))
    return even if near else None


def _without_repeats(recording: Recording) -> tuple[Recording, str] | str:
    time = recording.time
    # A simulation writes an event twice: what comes after it holds from there on.
    repeats: npt.NDArray[np.bool_] = np.concatenate([np.diff(time) == 0, [False]])
    count = int(repeats.sum())
    if not count:
        return recording, ""
    if count > 0.2 * len(time):
        even = _spread(time)
        if even is None:
            return (
                f"{count} of {len(time)} instants repeat the one before, irregularly; export the "
                "time with more digits"
            )
        return replace(recording, time=even), (
            f"the clock is coarser than the sampling ({count} repeated instants); the samples were "
            "spread evenly"
        )
    return recording.take(~repeats), f"{count} row(s) with a repeated instant were left out"


def _epoch(recording: Recording) -> tuple[Recording, str]:
    """Turn instants since 1970 in ms, us or ns into s; nothing else counts that far."""
    for factor, unit in _FINER:
        if _EPOCH[0] <= recording.time[0] / factor < _EPOCH[1]:
            return replace(recording, time=recording.time / factor), (
                f"the time counts {unit} since 1970, not s; divided by {factor:g}"
            )
    return recording, ""


def _rate(recording: Recording, expected: Expected) -> tuple[Recording, str] | str:
    """Compare with the sample rate in the notes; a factor of a thousand is a wrong unit."""
    stated = expected.sample_rate_Hz
    if stated is None:
        return recording, ""
    ratio = recording.sample_time * stated
    for factor, unit in _FINER:
        if abs(ratio / factor - 1) < 0.05:
            return replace(recording, time=recording.time / factor), (
                f"the time is in {unit}, not s ({stated:g} Hz in the notes); divided by {factor:g}"
            )
    if abs(ratio - 1) > 0.02:
        return (
            f"the notes say {stated:g} Hz but the time says {1 / recording.sample_time:.6g} Hz; "
            "correct the one that is wrong"
        )
    return recording, ""


_SLOW = 5.0
"""Factor by which steps may be too long for the model: some machines have a fast part that no
sample needs to show, and a wrong unit makes them a thousand times too long."""

_STILL, _SHORT = 0.25, 0.5
"""Shares of the model's time within which no machine shows a motion, and within which few do: a
slow process may be recorded for less than its time constant."""


_DRIVEN = 0.1
"""Part of what was recorded that the inputs move a model, which it has the time for then."""


def _speed_problem(recording: Recording, expected: Expected) -> tuple[str, bool]:
    """Return what does not fit a machine of known speed, and whether it is a wrong unit."""
    step, length, speed = recording.sample_time, recording.duration, expected.speed
    said = f"{in_time(length, 4)} in steps of {in_time(step, 4)}"
    advice = "give the unit of the time (ms, us, ns) in its header or in a mapping file"
    if step * speed > np.pi:
        moves = f"{said}: the model moves within {in_time(1 / speed)}, which such steps do not show"
        return f"{moves}; {advice}", step * speed > _SLOW * np.pi
    if length * speed < _SHORT and not expected.moves(recording) > _DRIVEN:
        hardly = f"{said}: the model hardly moves before {in_time(_SHORT / speed)}; {advice}"
        return hardly, length * speed < _STILL
    return "", False


@check(
    "time base",
    10,
    foundation=True,
    fix="export the time in seconds with enough digits, one row per sample",
)
def check_time_base(recording: Recording, expected: Expected) -> Finding:
    """Check that the time increases and agrees with the notes; correct what can be."""
    n = len(recording)
    if n < MIN_SAMPLES:
        return Finding("unfit", f"{n} samples; a judgement needs {MIN_SAMPLES} or more")
    if np.ptp(recording.time) == 0:
        return Finding("unfit", "the time never advances")
    notes = []
    first = _epoch, _clock_put_back, _in_order, _without_repeats
    for step in (*first, lambda r: _rate(r, expected)):
        found = step(recording)
        if isinstance(found, str):
            return Finding("unfit", found)
        recording, note = found
        if note:
            notes.append(note)
    values = {"duration": recording.duration, "sample_time": recording.sample_time}
    unknown = not np.isfinite(expected.speed)
    if unknown and not _SHORTEST_STEP <= recording.sample_time <= _LONGEST_STEP:
        return Finding(
            "unfit",
            f"{in_time(recording.duration, 4)} in steps of {in_time(recording.sample_time, 4)};"
            f" steps are {_SHORTEST_STEP:g} to {_LONGEST_STEP:g} s: give the unit of the time"
            " (ms, us, ns) in its header or in a mapping file",
            values,
        )
    problem, wrong_unit = _speed_problem(recording, expected)
    if wrong_unit:
        return Finding("unfit", problem, values)
    if notes:
        return Finding("corrected", "; ".join(notes), values, recording)
    length, every = in_time(recording.duration, 6), in_time(recording.sample_time, 6)
    note = f"{length} in steps of {every}, increasing"
    unit = next((row.unit for row in recording.mapping or () if row.signal == "time"), "s")
    untold = (
        "" if unit or expected.sample_rate_Hz or not unknown else "no unit is stated: taken as s"
    )
    doubts = [text for text in (untold, problem) if text]
    return Finding("pass", "; ".join([note, *doubts]), values, doubt=bool(doubts))


def in_order(recording: Recording) -> Recording:
    """Return a recording whose time increases, where its rows tell how: an export repeats some."""
    return check_time_base(recording, expectations(recording)).recording or recording
