"""With which period, or over which stride, a signal repeats."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.arrays import Vector

_HELD, _REPEATS = 0.15, 3
"""Share of the variance that repeats, and how often it does, where a signal is periodic."""

_OUTSTANDING, _ALONG_A_WAY = 4.0, 2.0
"""Power of the strongest line over that of the strongest one beside what repeats. Where one goes
along a way fast, what is missing is found smaller and late, which spreads its line."""

_WAVES, _AS_MUCH = 6, 0.9
"""Sines that what repeats is made of: a sun that shines six hours a day shows more at a third of
the day than at the day. And what holds so much of what a longer period does is the period."""

_FINER = 40
"""How many times finer than the lines of a periodogram the rate of what repeats is sought."""

_LEAKS = 4
"""Parts of a line by which leakage may put it off: a tenth, where three periods are seen."""

_ROUNDED = 1e-9
"""Part of a signal that rounding leaves of it."""

_STRETCH, _COURSE = 4, 3
"""Samples to a stretch of a way, on the mean, and degree of the course along it."""


def period_of(
    recordings: Sequence[tuple[str, Vector]],
    signal: Vector,
    *,
    beside_course: bool = False,
    waves: int = _WAVES,
    outstanding: float = _OUTSTANDING,
) -> float:
    """Return the period, in s, with which a signal mostly repeats; NaN if it does not.

    The strongest line of the periodogram, or what it is a multiple of, is refined by least squares
    of as many sines as `waves`. Without them no line may be near as strong; they have to hold
    `_HELD` of the variance over at least `_REPEATS` periods, in every recording at one frequency.

    Args:
        recordings: Name and times from the first sample, in s, one after the other, n in all.
        signal: The signal, shape (n,), any unit.
        beside_course: Whether it is sought beside a slow course over each recording. What swings by
            chance seems to repeat more often then: one red noise of ten does, one of fifty else.
        waves: Most sines that what repeats is made of.
        outstanding: Least power of the strongest line over that of the strongest one beside,
            dimensionless.

    Example:
        >>> t = 0.1 * np.arange(4000)
        >>> wave = np.sin(2.0 * np.pi * t / 80.0)
        >>> noise = np.random.default_rng(1).normal(0.0, 0.5, t.size)
        >>> round(period_of([("run", t)], wave + noise), 1)
        79.8
    """
    rates, widths, first = [], [], 0
    for _, time in recordings:
        part = signal[first : first + len(time)]
        # What is constant but for rounding repeats nothing.
        least = (_ROUNDED * float(np.max(np.abs(part), initial=0.0))) ** 2
        part = part - (_course(part) if beside_course else np.mean(part))
        first += len(time)
        whole, variance = float(time[-1] - time[0]), float(np.mean(part**2))
        lines = _lines(part)
        if len(lines) <= _REPEATS or not variance > least or not whole > 0.0:
            return math.nan
        line, found = int(np.argmax(lines)), []
        step = (len(part) - 1) / len(part) / _FINER / whole
        between = np.abs(np.fft.rfft(part, _FINER * len(part))) ** 2
        for divisor in range(1, min(waves, line // _REPEATS) + 1):
            many = min(waves, len(lines) * divisor // (line + 1))
            near = np.arange(_FINER * max(line - 1, _REPEATS * divisor), _FINER * (line + 1) + 1)
            steps = np.unique(near // divisor)
            power = between[np.outer(np.arange(1, many + 1), steps)].sum(axis=0)
            rate = float(steps[int(np.argmax(power))]) * step
            found.append((float(np.mean(_repeated(time, part, rate, many) ** 2)), rate, many))
        most = max((held for held, _, _ in found), default=0.0)
        if most < _HELD * variance:
            return math.nan
        _, rate, many = next(each for each in found if each[0] >= _AS_MUCH * most)
        # Lines are off by the leakage of those beside them and of their own mirror images.
        beside = [rate + step * k for k in range(-_LEAKS, _LEAKS + 1)]
        held = [float(np.mean(_repeated(time, part, f, many) ** 2)) for f in beside]
        k = min(max(int(np.argmax(held)), 1), len(held) - 2)
        bend, slope, _ = np.polyfit([-1.0, 0.0, 1.0], held[k - 1 : k + 2], 2)
        rate = float(beside[k] - step * np.clip(0.5 * slope / bend, -1.0, 1.0))
        wave = _repeated(time, part, rate, many)
        if lines[line] <= outstanding * np.max(_lines(part - wave)):
            return math.nan
        rates.append(rate)
        widths.append(1.0 / whole)
    apart = max(rates) - min(rates)
    return 1.0 / float(np.mean(rates)) if apart <= 0.5 * max(widths) else math.nan


def stride_of(way: Vector, signal: Vector) -> float:
    """Return how far one goes along a way, back and forth, until a signal repeats; NaN if never.

    It is averaged over short stretches of the way, and its course over all of it left out. What
    goes by way, such as a ripple, is a single sine, or its strongest one.

    Args:
        way: Where the signal acts, shape (n,), any unit.
        signal: The signal, shape (n,), any unit.

    Returns:
        The stride, in the unit of the way.

    Example:
        >>> way = 0.3 * np.sin(0.01 * np.arange(4000))
        >>> noise = np.random.default_rng(1).normal(0.0, 1.0, way.size)
        >>> round(stride_of(way, np.sin(2.0 * np.pi * way / 0.0125) + way + noise), 4)
        0.0125
    """
    edges = np.linspace(np.min(way), np.max(way), max(len(way) // _STRETCH, 1) + 1)
    which = np.clip(np.searchsorted(edges, way) - 1, 0, len(edges) - 2)
    count = np.bincount(which, minlength=len(edges) - 1)
    level = np.bincount(which, weights=signal, minlength=len(count)) / np.maximum(count, 1)
    if np.count_nonzero(count) <= _COURSE:
        return math.nan
    middles = np.linspace(-1.0, 1.0, len(count))
    level = np.interp(middles, middles[count > 0], level[count > 0])
    middles = 0.5 * (edges[1:] + edges[:-1])
    found = [("", middles)]
    return period_of(found, level, beside_course=True, waves=1, outstanding=_ALONG_A_WAY)


def _course(signal: Vector) -> Vector:
    """Return the slow course of a signal, which says nothing of what repeats in it."""
    along = np.linspace(-1.0, 1.0, len(signal))
    return np.asarray(np.polyval(np.polyfit(along, signal, _COURSE), along))


def _lines(signal: Vector) -> Vector:
    """Return the power of the lines of a periodogram, in the square of the signal's unit."""
    power = np.abs(np.fft.rfft(signal * np.hanning(len(signal)))[: len(signal) // 2]) ** 2
    return np.asarray(power)


def _repeated(time: Vector, signal: Vector, rate: float, waves: int) -> Vector:
    """Return the sines of a rate, in 1/s, and its multiples that are nearest to a signal."""
    angle = 2.0 * np.pi * rate * np.outer(time, np.arange(1, waves + 1))
    sines = np.hstack([np.sin(angle), np.cos(angle)])
    return np.asarray(sines @ np.linalg.lstsq(sines, signal, rcond=None)[0])
