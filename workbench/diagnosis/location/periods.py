"""With which period, or over which stride, a signal repeats."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.arrays import Vector

_SINE, _REPEATS = 0.15, 3
"""Share of the variance that a sine holds, and how often it repeats, where a signal is periodic."""

_OUTSTANDING, _LINE = 4.0, 3
"""Power of the line of that sine over the strongest other one, and how many lines away that is."""

_STRETCH, _COURSE = 4, 3
"""Samples to a stretch of a way, on the mean, and degree of the course along it."""


def period_of(recordings: Sequence[tuple[str, Vector]], signal: Vector) -> float:
    """Return the period, in s, of the one sine that a signal mostly is; NaN if it is none.

    The strongest line of the periodogram is refined by least squares. It has to stand out, and hold
    `_SINE` of the variance over at least `_REPEATS` periods, in every recording at one frequency.

    Args:
        recordings: Name and times from the first sample, in s, one after the other, n in all.
        signal: The signal, shape (n,), any unit.

    Example:
        >>> t = 0.1 * np.arange(4000)
        >>> wave = np.sin(2.0 * np.pi * t / 80.0)
        >>> noise = np.random.default_rng(1).normal(0.0, 0.5, t.size)
        >>> round(period_of([("run", t)], wave + noise), 1)
        80.0
    """
    rates, widths, first = [], [], 0
    for _, time in recordings:
        part = signal[first : first + len(time)] - np.mean(signal[first : first + len(time)])
        first += len(time)
        whole, variance = float(time[-1] - time[0]), float(np.mean(part**2))
        lines = np.abs(np.fft.rfft(part * np.hanning(len(part)))[: len(part) // 2]) ** 2
        if len(lines) <= _REPEATS or not variance > 0.0 or not whole > 0.0:
            return math.nan
        line = int(np.argmax(lines))
        others = [*lines[: max(line - _LINE, 0)], *lines[line + _LINE + 1 :]]
        held, rate = max(
            (_held(time, part, f / whole), f / whole)
            for f in np.linspace(max(line - 1, _REPEATS), max(line + 1, _REPEATS + 1), 41)
        )
        stands_out = lines[line] > _OUTSTANDING * max(others, default=0.0)
        if line < _REPEATS or held < _SINE * variance or not stands_out:
            return math.nan
        rates.append(rate)
        widths.append(1.0 / whole)
    apart = max(rates) - min(rates)
    return 1.0 / float(np.mean(rates)) if apart <= 0.5 * max(widths) else math.nan


def stride_of(way: Vector, signal: Vector) -> float:
    """Return how far one goes along a way, back and forth, until a signal repeats; NaN if never.

    The signal is averaged over short stretches of the way, and its course over all of it left out.

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
    level = level - np.polyval(np.polyfit(middles, level, _COURSE), middles)
    return period_of([("", 0.5 * (edges[1:] + edges[:-1]))], level)


def _held(time: Vector, signal: Vector, rate: float) -> float:
    """Return the mean square of the sine of a rate, in 1/s, that is nearest to a signal."""
    angle = 2.0 * np.pi * rate * time
    waves = np.column_stack([np.sin(angle), np.cos(angle)])
    return float(np.mean((waves @ np.linalg.lstsq(waves, signal, rcond=None)[0]) ** 2))
