"""Other time bases: commands are held, measurements are low-passed and interpolated."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector, runs
from workbench.errors import TIMES_S, WorkbenchError, check_finite, check_range
from workbench.model.units import in_time
from workbench.recordings.recording import Recording, Signal, Span

_SAME = 0.02
"""Part of a step by which two clocks of one pace may drift apart along a recording."""

_MOSTLY = 0.9

_UNEVEN = 0.5
"""Spread of the steps, over their mean, beyond which straight lines take away noise that counts."""

_CROSSINGS = 8
"""Zero crossings on each side of the sinc that filters."""

_COURSE = 0.2
"""Share of the sampling rate above which a measurement counts as noise when it is moved in time."""


def _require_increasing(recording: Recording) -> None:
    if len(recording) < 2:
        raise WorkbenchError(
            f"recording {recording.name!r} has {len(recording)} sample(s); resampling needs two or"
            " more"
        )
    if not recording.increasing:
        raise WorkbenchError(
            f"the time of recording {recording.name!r} does not increase everywhere, so resampling"
            " is not defined; 'workbench recording FILE' says where, and"
            " check_recording(...).recording is a corrected one where its rows tell how"
        )


def low_pass(values: Vector, fraction: float) -> Vector:
    """Remove what lies above a fraction of the sampling rate, without shifting in time.

    A windowed sinc of odd length (linear phase, delay removed); the ends are continued by their
    reflection through the end point, which keeps the slope there.

    Args:
        values: Uniformly sampled values, shape (n,).
        fraction: Edge of the pass band as a fraction of the sampling rate, below 0.5.
    """
    if len(values) < 3:
        return values
    reach = min(int(np.ceil(_CROSSINGS / (2 * fraction))), len(values) - 1)
    extended = np.pad(values, reach, mode="reflect", reflect_type="odd")
    kernel = np.sinc(2 * fraction * np.arange(-reach, reach + 1)) * np.hamming(2 * reach + 1)
    size = 1 << len(extended).bit_length()
    spectrum = np.fft.rfft(extended, size) * np.fft.rfft(kernel / kernel.sum(), size)
    return np.asarray(np.fft.irfft(spectrum, size)[2 * reach : len(extended)])


def _interpolated(signal: Signal, time: Vector, times: Vector) -> Vector:
    good = np.isfinite(signal.values)
    if not good.any():
        return np.full(len(times), np.nan)
    if signal.zero_order_hold:
        return _held(signal.values[good], time[good], times)
    return np.asarray(np.interp(times, time[good], signal.values[good]))


def _unmeasured(
    signal: Signal, time: Vector, times: Vector, reach: float
) -> list[tuple[float, float]]:
    """Return the stretches further from a value than ``reach``, in s, and than from any row."""
    good = np.isfinite(signal.values)
    if good.all() or not good.any():
        return []
    far = _away(time[good], times) > np.maximum(_away(time, times), reach) * (1 + 1e-6)
    return [(float(times[a]), float(times[b])) for a, b in runs(far)]


def _away(time: Vector, times: Vector) -> Vector:
    after = np.clip(np.searchsorted(time, times), 1, max(len(time) - 1, 1))
    either = time[[after - 1, np.minimum(after, len(time) - 1)]]
    return np.asarray(np.min(np.abs(times - either), axis=0))


def _nearest(values: Vector, time: Vector, times: Vector) -> Vector:
    """Return the nearest sample of each instant, moved there along the smoothed course.

    A mean of two samples would have less noise than either, and share it with its neighbours: what
    estimates the noise would then believe in too little of it.
    """
    even = np.linspace(time[0], time[-1], len(time))
    course = low_pass(np.interp(even, time, values), _COURSE)
    middles = 0.5 * (time[1:] + time[:-1])
    nearest = np.searchsorted(middles, times)
    moved = np.interp(times, even, course) - np.interp(time[nearest], even, course)
    return values[nearest] + np.where(times == time[nearest], 0.0, moved)


def at_one_pace(recordings: Sequence[Recording]) -> list[Recording]:
    """Return recordings with the sample time of the slowest, if theirs are not all the same.

    Example:
        >>> made = [Recording(n, np.arange(9) * t, ()) for n, t in (("a", 0.1), ("b", 0.2))]
        >>> [round(r.sample_time, 9) for r in at_one_pace(made)]
        [0.2, 0.2]
    """
    paces = [_pace(r) for r in recordings]
    slowest = max(paces, default=0.0)

    def paced(recording: Recording, pace: float) -> Recording:
        if not recording.increasing or math.isclose(pace, slowest, rel_tol=1e-9):
            return recording
        n = len(recording)
        if (slowest - pace) * n < _SAME * slowest:
            even = recording.time + (slowest - pace) * (np.arange(n) - 0.5 * (n - 1))
            return recording.at_times(even)
        return resample(recording, rate_Hz=1.0 / slowest)

    return [paced(r, pace) for r, pace in zip(recordings, paces, strict=True)]


def refined(recording: Recording, parts: int, straight: Collection[str]) -> Recording:
    """Return a recording with each step divided, in which nothing was measured in between.

    Args:
        parts: Number of parts of a step.
        straight: Signals that go straight from sample to sample; other commands are held.

    Example:
        >>> made = Recording("a", np.arange(3.0), (Signal("wave", [0.0, 2.0, 4.0], "m"),))
        >>> refined(made, 2, ["wave"])["wave"]
        array([0., 1., 2., 3., 4.])
    """
    coarse = np.arange(len(recording.time))
    fine = np.arange(parts * (len(coarse) - 1) + 1) / parts

    def between(signal: Signal) -> Vector:
        if signal.name in straight:
            return np.interp(fine, coarse, signal.values)
        whole = signal.values[fine.astype(int)]
        return whole if signal.zero_order_hold else np.where(fine % 1.0 == 0.0, whole, np.nan)

    return replace(
        recording,
        time=np.interp(fine, coarse, recording.time),
        signals=tuple(replace(s, values=between(s)) for s in recording.signals),
    )


def _pace(recording: Recording) -> float:
    """Return the mean step, in s, of a recording; without its gaps, if it has no more than gaps."""
    steps = np.diff(recording.time)
    usual = steps[steps < 1.5 * np.median(steps)]
    return float(np.mean(usual if len(usual) > _MOSTLY * len(steps) else steps))


def _held(values: Vector, time: Vector, times: Vector) -> Vector:
    """Return what is held between instants: the mean, where it changes before the next one."""
    # The small allowance keeps a sample that rounding moved just behind its own instant. A part of
    # instants since 1970 would be seconds.
    slack = max(1e-9 * float(np.ptp(time)), 4.0 * float(np.spacing(np.max(np.abs(time)))))
    index = np.clip(np.searchsorted(time, times + slack, side="right") - 1, 0, None)
    held: Vector = values[index]
    last = np.append(np.searchsorted(time, times[1:] - slack, side="left") - 1, index[-1])
    changes = np.concatenate([[0], np.cumsum(values[1:] != values[:-1])])
    moved = changes[np.maximum(last, index)] > changes[index]
    area = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(time))])
    past = values[-1] * np.clip(times - time[-1], 0.0, None)
    means = np.diff(np.interp(times, time, area) + past) / np.diff(times)
    return np.where(moved, np.append(means, held[-1]), held)


def resample(
    recording: Recording, *, rate_Hz: float | None = None, times: npt.ArrayLike | None = None
) -> Recording:
    """Return a recording on another time base.

    Commands and references keep their value until the next sample (zero-order hold), measurements
    are interpolated by straight lines. Where a command changes between two instants, its mean there
    is taken; of uneven steps a measurement comes from the nearest sample. Where one is missing a
    line bridges the gap, which is excluded. If the new step is more than 1.2 times the old one
    measurements are low-passed at 0.4 of the new rate before, so that nothing folds down.

    Args:
        rate_Hz: Rate of a uniform time base that starts at the first sample.
        times: Instants, shape (m,), in s, inside the recording; instead of ``rate_Hz``.

    Example:
        >>> time = np.arange(5) * 1.0
        >>> r = Recording("r", time, (Signal("angle", 2 * time, "rad"),))
        >>> resample(r, rate_Hz=2.0)["angle"][:4]
        array([0., 1., 2., 3.])
    """
    _require_increasing(recording)
    if (rate_Hz is None) == (times is None):
        raise WorkbenchError("give either rate_Hz or times to resample a recording, not both")
    old = recording.sample_time
    uneven = np.ptp(np.diff(recording.time)) > _UNEVEN * old
    if uneven:
        old = recording.duration / (len(recording) - 1)
    first, last = float(recording.time[0]), float(recording.time[-1])
    if rate_Hz is not None:
        check_range(
            "rate_Hz", rate_Hz, 1 / max(recording.duration, TIMES_S[0]), 1 / TIMES_S[0], "Hz"
        )
        n = int(np.floor(recording.duration * rate_Hz * (1 + 1e-9))) + 1
        instants = first + np.arange(n) / rate_Hz
        new = 1 / rate_Hz
    else:
        instants = check_finite("times", times if times is not None else [])
        if instants.ndim != 1 or len(instants) < 2 or np.any(np.diff(instants) <= 0):
            raise WorkbenchError("times must be two or more increasing instants")
        if instants[0] < first - 1e-6 * old or instants[-1] > last + old:
            raise WorkbenchError(
                f"times run from {instants[0]:g} to {instants[-1]:g} s but the recording from "
                f"{first:g} to {last:g} s; choose instants inside"
            )
        new = float(np.median(np.diff(instants)))
    signals, spans = [], list(recording.excluded)
    for signal in recording.signals:
        source, time = signal, recording.time
        if not signal.zero_order_hold and new > 1.2 * old and np.isfinite(signal.values).any():
            # The filter needs a uniform base; on it the old samples are met closely enough.
            n_old = round(recording.duration / old) + 1
            time = np.linspace(first, last, n_old)
            uniform = _interpolated(signal, recording.time, time)
            source = replace(signal, values=low_pass(uniform, 0.4 * old / new))
        good = np.isfinite(source.values)
        if source is signal and not signal.zero_order_hold and uneven and good.any():
            values = _nearest(source.values[good], time[good], instants)
        else:
            values = _interpolated(source, time, instants)
        if not signal.zero_order_hold:
            missing = _unmeasured(signal, recording.time, instants, 0.5 * new)
            spans += [Span(signal.name, a, b, "not recorded") for a, b in missing]
        signals.append(replace(signal, values=values))
    made = replace(recording, time=instants, signals=tuple(signals), excluded=tuple(spans))
    if math.isclose(old, new, rel_tol=_SAME):
        return made
    made = replace(made, resampled=True)
    return made.noted(f"resampled from one every {in_time(old, 6)} to one every {in_time(new, 6)}")
