"""The signal that a model lacks at a port: when it acts, and with which local signal."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.location.periods import period_of
from workbench.files import picked
from workbench.model.units import in_range, in_time, in_times, readably, written_unit

BINS = 24
"""Classes into which an argument is divided to see what depends on it."""

STRONG = 0.5
"""Share of its strongest window or class from which a signal counts as acting there."""

THROUGHOUT = 0.7
"""Share of the time, or of the samples, from which a signal acts all the time, or everywhere."""

_WINDOWS = 50
_LEAST_KNOWN = 0.25
_MOST_SPANS = 3
_MOST_PLACES = 4
_LEAST_DEPENDENCE = 0.05

_CONSTANT = 1e-5
"""Standard deviation over root mean square up to which a signal is a constant."""

_EXPLAINED = 0.3
"""Share of the variance that is a function of a local signal from which time explains no more."""


class LocalSignal(NamedTuple):
    """A quantity along recordings with which another signal may go.

    Args:
        values: Its values, shape (n,), in ``unit``.
        shown: Unit declared for reading it; empty if none.
    """

    name: str
    unit: str
    values: Vector
    shown: str = ""


@dataclass(frozen=True)
class Span:
    """A time at which something is missing.

    Args:
        begin: Time from the first sample of the recording, in s.
        end: The same for its end, in s.
        share: Share of the mean square of the missing signal that falls into it, dimensionless.
    """

    recording: str
    begin: float
    end: float
    share: float


@dataclass(frozen=True)
class Place:
    """Values of a local signal at which something is missing.

    Args:
        dependence: Share of the variance of the missing signal that is a function of it,
            dimensionless.
        ranges: Where the missing signal is strong, ends in ``unit``, the strongest first.
        covered: Share of the samples that lie in these ranges, dimensionless.
        shown: Unit declared for reading it; empty if none.
    """

    signal: str
    unit: str
    dependence: float
    ranges: tuple[tuple[float, float], ...]
    covered: float
    shown: str = ""


@dataclass(frozen=True)
class Occurrence:
    """When and where a signal is missing.

    Args:
        port: Port at which it is missing, or output whose prediction is wrong.
        rms: Root mean square of the signal where the measurements tell it, in ``unit``.
        largest: The same over its strongest time, in ``unit``.
        spans: Times at which it acts, the strongest first.
        active: Share of the time in which it acts, dimensionless.
        places: Local signals with the values at which it acts, by falling dependence.
        period: Period with which it repeats in time, in s, where no local signal explains it; NaN
            if it does not.
        shown: Unit declared for reading it; empty if none.
        since: From when on an event acts in each recording, in words; empty if it is none.
    """

    port: str
    unit: str
    rms: float
    largest: float
    spans: tuple[Span, ...]
    active: float
    places: tuple[Place, ...]
    period: float = math.nan
    shown: str = ""
    since: str = ""

    @property
    def when(self) -> str:
        """Times at which it acts, in words."""
        if self.since:
            return self.since
        if self.active >= THROUGHOUT or not self.spans:
            return "throughout"
        shown = self.spans[:_MOST_SPANS]
        by_recording: dict[str, list[Span]] = {}
        for span in shown:
            by_recording.setdefault(span.recording, []).append(span)
        ends = [f"{_times(spans)} of {name}" for name, spans in by_recording.items()]
        rest = len(self.spans) - len(shown)
        others = [f"at {rest} other time{'s' if rest > 1 else ''}"] if rest else []
        return f"from {_listed([*ends, *others])}"

    @property
    def where(self) -> str:
        """Local signal with which it goes, and the values at which it is largest, in words."""
        if not self.places:
            return "with no local signal"
        place = self.places[0]
        name = place.signal.replace("_", " ")
        said = f"with {name} ({100 * place.dependence:.0f} % of its variance)"
        if place.covered >= THROUGHOUT:
            return f"{said}, about as much at all its values"
        ranges = np.array(place.ranges)
        read, unit = readably(ranges, place.unit, place.shown, float(np.abs(ranges).max()))
        shown = in_range(read.ravel().tolist())
        # Both ends of a narrow range may read the same.
        ends = [
            " to ".join(dict.fromkeys(pair)) for pair in zip(shown[::2], shown[1::2], strict=True)
        ]
        return f"{said}, most at {_listed(ends)} {written_unit(unit)}".rstrip()

    @property
    def how_large(self) -> str:
        """Its size, in words."""
        largest, unit = readably(self.largest, self.unit, self.shown, self.largest)
        return f"{in_range([largest])[0]} {written_unit(unit)}".rstrip()

    def sentence(self, subject: str = "It") -> str:
        """Return it as a sentence about something."""
        repeats = math.isfinite(self.period) and not self.since
        again = f" It repeats every {in_time(self.period)}." if repeats else ""
        return (
            f"{subject} acts {self.when}, {self.where}: up to {self.how_large} root mean square at"
            f" {self.port}.{again}"
        )

    def __str__(self) -> str:
        return self.sentence()

    def as_data(self) -> dict[str, Any]:
        """Return it as data, in SI."""
        times = [picked(s, "recording from=begin to=end share") for s in self.spans]
        said = "signal unit dependence ranges share_of_samples=covered"
        places = [picked(p, said) for p in self.places]
        own = picked(self, "port unit rms largest share_of_time=active period")
        return own | {"times": times, "places": places}


@dataclass(frozen=True)
class MissingSignal:
    """The signal that a model lacks at a port.

    Args:
        unit: SI unit of the signal.
        time: Times, recordings one after the other, shape (n,), in s.
        signal: Smoothed unknown input, shape (n,), in ``unit``.
        std: Its standard deviation, shape (n,), in ``unit``.
        law: What the effect that was found adds there, shape (n,), in ``unit``; None if nothing
            was found.
        argument: The quantity, among those that the port sees, that the law depends on most.
        explained: Share of the mean square of the signal that the law takes away where the
            measurements determine it, dimensionless; NaN without law.
        shown: Unit declared for reading the signal; empty if none.
    """

    port: str
    unit: str
    time: Vector
    signal: Vector
    std: Vector
    law: Vector | None
    argument: LocalSignal
    explained: float = math.nan
    law_name: str = "the effect that was found"
    occurrence: Occurrence | None = None
    shown: str = ""

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Where the signal is determined to half its own size or better, shape (n,)."""
        return known_rows(self.signal, self.std)


def occurrence(
    port: str,
    unit: str,
    recordings: Sequence[tuple[str, Vector]],
    signal: Vector,
    std: Vector,
    local: Sequence[LocalSignal],
    shown: str = "",
) -> Occurrence:
    """Tell when a signal acts, and at which values of which local signal.

    A recording is divided into windows, a local signal into classes with equally many samples; the
    signal acts where its mean square, less its variance, is at least `STRONG` squared times that of
    the strongest.

    Args:
        recordings: Name and times from the first sample, in s, one after the other, n in all.
        signal: The signal, shape (n,), in ``unit``.
        std: Its standard deviation, shape (n,), in ``unit``.
        shown: Unit declared for reading the signal; empty if none.

    Example:
        >>> t = np.linspace(0.0, 10.0, 1000)
        >>> late = np.where(t > 6.0, 2.0, 0.0)
        >>> force = LocalSignal("force", "N", -t)
        >>> found = occurrence("axis.force", "N", [("run", t)], late, 0 * t, [force])
        >>> found.when, found.where
        ('from 6.01 to 10 s of run', 'with force (96 % of its variance), most at -10 to -5.84 N')
    """
    rows = known_rows(signal, std)
    square = np.where(rows, np.maximum(signal**2 - std**2, 0.0), 0.0)
    windows: list[Span] = []
    levels, lengths, first = [], [], 0
    for name, time in recordings:
        count = min(_WINDOWS, max(1, len(time) // 10))
        for part in np.array_split(np.arange(len(time)), count):
            here = part + first
            told = np.count_nonzero(rows[here])
            enough = told >= _LEAST_KNOWN * len(here)
            level = float(np.sum(square[here]) / told) if enough else 0.0
            end = min(int(part[-1]) + 1, len(time) - 1)
            windows.append(Span(name, float(time[part[0]]), float(time[end]), level * len(here)))
            levels.append(level)
            lengths.append(len(here))
        first += len(time)
    largest = max(levels)
    acting = [0.0 < level >= STRONG**2 * largest for level in levels]
    each = (_place(where, signal, square, rows) for where in local)
    places = [place for place in each if place.dependence >= _LEAST_DEPENDENCE]
    places.sort(key=lambda place: -place.dependence)
    explained = bool(places) and places[0].dependence >= _EXPLAINED
    return Occurrence(
        port,
        unit,
        float(np.sqrt(np.mean(square[rows]))),
        math.sqrt(largest),
        _spans(windows, acting),
        sum(itertools.compress(lengths, acting)) / sum(lengths),
        tuple(places[:_MOST_PLACES]),
        math.nan if explained else period_of(recordings, signal),
        shown,
    )


def known_rows(signal: Vector, std: Vector) -> npt.NDArray[np.bool_]:
    """Return where a signal is determined to half its own size or better.

    Args:
        signal: The signal, shape (n,), in any unit.
        std: Its standard deviation, shape (n,), in that unit.

    Returns:
        One value per sample, shape (n,); all of them where hardly any is determined.
    """
    # While a machine rests, its measurements say nothing about forces that do not move it.
    known = std < 0.5 * np.sqrt(np.mean(signal**2 + std**2))
    return known if np.count_nonzero(known) > 10 else np.ones(len(signal), dtype=bool)


def _spans(windows: Sequence[Span], acting: Sequence[bool]) -> tuple[Span, ...]:
    """Join windows that follow each other, or that a single quiet one parts."""
    total = sum(window.share for window in windows) or 1.0
    found: list[Span] = []
    last = -9
    for i in np.flatnonzero(acting).tolist():
        own = replace(windows[i], share=windows[i].share / total)
        if found and found[-1].recording == own.recording and i - last <= 2:
            before = found.pop()
            own = replace(own, begin=before.begin, share=before.share + own.share)
        found.append(own)
        last = i
    return tuple(sorted(found, key=lambda span: -span.share))


def _place(
    local: LocalSignal, signal: Vector, square: Vector, rows: npt.NDArray[np.bool_]
) -> Place:
    """Find the values of a local signal at which a signal is strong."""
    x, y = local.values[rows], square[rows]
    which = _classes(x)
    count = np.bincount(which)
    level = np.bincount(which, weights=y) / np.maximum(count, 1)
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, which, x)
    np.maximum.at(high, which, x)
    strong = (level >= STRONG**2 * level.max()) & (count > 0)
    ranges: list[tuple[float, float, float]] = []
    last = -9
    for i in np.flatnonzero(strong).tolist():
        # A class that no sample falls into parts nothing.
        if ranges and not count[last + 1 : i].any():
            ranges[-1] = (ranges[-1][0], float(high[i]), max(ranges[-1][2], float(level[i])))
        else:
            ranges.append((float(low[i]), float(high[i]), float(level[i])))
        last = i
    ranges.sort(key=lambda r: -r[2])
    return Place(
        local.name,
        local.unit,
        max(correlation_ratio(signal[rows], x), correlation_ratio(y, x)),
        tuple((a, b) for a, b, _ in ranges[:2]),
        float(count[strong].sum() / max(len(x), 1)),
        local.shown,
    )


def _classes(values: Vector) -> npt.NDArray[np.intp]:
    """Return the number of the class of each value, of `BINS` with equally many samples."""
    edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)[1:-1]))
    return np.searchsorted(edges, values)


def correlation_ratio(signal: Vector, argument: Vector) -> float:
    """Return which share of a signal's variance is a function of an argument.

    Args:
        signal: The signal, shape (n,), in any unit.
        argument: The argument, shape (n,), in any unit.

    Returns:
        0 for no dependence to 1 for a function, dimensionless.
    """
    variance = float(np.var(signal))
    which = _classes(argument)
    count = np.bincount(which)
    # What varies by rounding alone is a constant, and goes with nothing.
    if variance <= _CONSTANT**2 * float(np.mean(signal**2)) or np.count_nonzero(count) < 2:
        return 0.0
    mean = np.bincount(which, weights=signal) / np.maximum(count, 1)
    between = float(np.sum(count * (mean - signal.mean()) ** 2)) / len(signal)
    return min(between / variance, 1.0)


def _times(spans: Sequence[Span]) -> str:
    """Return when spans begin and end, in words, in one unit."""
    ordered = sorted(spans, key=lambda span: span.begin)
    ends, unit = in_times([t for span in ordered for t in (span.begin, span.end)])
    pairs = zip(ends[::2], ends[1::2], strict=True)
    return f"{_listed([f'{begin} to {end}' for begin, end in pairs])} {unit}"


def _listed(parts: Sequence[str]) -> str:
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
