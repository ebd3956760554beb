"""Metrics of a trajectory over time: pure functions on arrays, NaN with a reason.

A metric that a trajectory does not have (the settling time of one that never settles) is NaN and
says why, so that no later sum or comparison can take it for a number.

Units: times from the step on, shape (n,), in s; trajectories, references before and after the step,
errors and commands, shape (n,), in any unit, and results in it unless they say another.

Source: Ogata, Modern Control Engineering, 2010, section 5.3 (settling and rise time, overshoot).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.arrays import Vector

BAND = 0.02
"""Half width of the settling band, as a fraction of the step."""


class Value(NamedTuple):
    """A number, or NaN and the reason why there is none.

    Args:
        value: The number, in the unit of the function that returned it.
        reason: Why the value is NaN; empty if it is a number.
    """

    value: float
    reason: str = ""


def settling_time(time: Vector, trajectory: Vector, *, initial: float, final: float) -> Value:
    """Return the time, from the first one, after which a response stays within the band, `BAND`.

    NaN if it is outside within the last tenth of the record, for then it was not seen to settle.

    Example:
        >>> t = np.linspace(0.0, 10.0, 10001)
        >>> round(settling_time(t, 1 - np.exp(-t), initial=0.0, final=1.0).value, 2)
        3.91
    """
    width = BAND * abs(final - initial)
    if width == 0.0:
        return Value(math.nan, "the reference does not step")
    outside = np.flatnonzero(np.abs(trajectory - final) > width)
    if not len(outside):
        return Value(0.0)
    last = int(outside[-1])
    if last >= len(trajectory) - max(1, len(trajectory) // 10):
        away = (trajectory - final)[len(trajectory) * 9 // 10 :]
        if away.min() < -width and away.max() > width:
            # Noise, a sensor's steps, play or friction does that, or a loop that is not stable.
            how = "swings by more than"
        else:
            how = "not within"
        return Value(math.nan, f"{how} {100 * BAND:g} % of the step by the end of the record")
    return Value(float(time[last + 1] - time[0]))


def rise_time(time: Vector, trajectory: Vector, *, initial: float, final: float) -> Value:
    """Return the time from 10 % to 90 % of a step, in s; NaN if 90 % is not reached."""
    if final == initial:
        return Value(math.nan, "the reference does not step")
    share = (trajectory - initial) / (final - initial)
    above_10, above_90 = np.flatnonzero(share >= 0.1), np.flatnonzero(share >= 0.9)
    if not len(above_90):
        return Value(math.nan, "90 % of the step is not reached")
    return Value(float(time[above_90[0]] - time[above_10[0]]))


def overshoot(trajectory: Vector, *, initial: float, final: float) -> Value:
    """Return how far a step response goes beyond the reference, a fraction of the step.

    It is 0 if the reference is not passed, and NaN without a step.
    """
    if final == initial:
        return Value(math.nan, "the reference does not step")
    return Value(max(0.0, float(np.max((trajectory - final) / (final - initial)))))


def undershoot(trajectory: Vector, *, initial: float, final: float) -> Value:
    """Return how far a step response goes the wrong way, beyond its start, a fraction of the step.

    It is 0 if it does not, and NaN without a step.
    """
    return overshoot(trajectory, initial=final, final=initial)


def steady_error(time: Vector, error: Vector, *, window: float = 1.0) -> Value:
    """Return the mean error at the end of a record with a constant reference, as a magnitude.

    Args:
        error: Reference minus output, in any unit.
        window: Length of the end that is averaged, in s; at most the last half is used.
    """
    end = _end(time, window)
    if end is None:
        return Value(math.nan, "fewer than 10 samples")
    return Value(abs(float(np.mean(error[end]))))


def oscillation(time: Vector, trajectory: Vector, *, window: float = 1.0) -> Value:
    """Return half the distance of highest and lowest value at the end of a record.

    The straight line through the end is taken away first, so that a slow drift does not count.

    Args:
        window: Length of the end, in s; at most the last half is used.
    """
    end = _end(time, window)
    if end is None:
        return Value(math.nan, "fewer than 10 samples")
    t, y = time[end], trajectory[end]
    # Weights that fade at the ends keep the line from following a part of an oscillation.
    fade = np.sin(np.pi * (np.arange(len(t)) + 0.5) / len(t))
    line = np.polynomial.Polynomial.fit(t, y, 1, w=fade)
    return Value(0.5 * float(np.ptp(y - line(t))))


def rms(error: Vector) -> Value:
    """Return the root mean square."""
    return Value(float(np.sqrt(np.mean(np.square(error)))))


def integral_absolute_error(time: Vector, error: Vector) -> Value:
    """Return the integral of the magnitude of an error that is held between samples."""
    return Value(float(np.sum(np.abs(error)) * (time[1] - time[0])))


def variation_rate(time: Vector, command: Vector) -> Value:
    """Return the total variation of a command per time: how much it chatters.

    Source:
        Total variation as a measure of input usage; Skogestad, Journal of Process Control 13, 2003.
    """
    return Value(float(np.sum(np.abs(np.diff(command))) / (time[-1] - time[0])))


def _end(time: Vector, window: float) -> slice | None:
    n = len(time)
    if n < 10:
        return None
    span = min(window, 0.5 * float(time[-1] - time[0]))
    first = int(np.searchsorted(time, time[-1] - span))
    return slice(min(first, n - 5), n)
