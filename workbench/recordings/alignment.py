"""Bring two recordings of the same experiment, made by two loggers, onto one time base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.errors import WorkbenchError
from workbench.recordings.recording import Recording, Vector
from workbench.recordings.resampling import resample


def _whitened(values: Vector) -> Vector:
    # Differences weigh the edges, which both loggers see, above the slow parts.
    steps = np.diff(values)
    steps = steps - steps.mean()
    size = float(np.sqrt(np.sum(steps**2)))
    result: Vector = steps / size if size else steps
    return result


def clock_shift(
    first: Recording, second: Recording, signal: str, *, other: str | None = None
) -> tuple[float, float]:
    """Return by how much the clock of a second recording is ahead, and how sure that is.

    Cross-correlation of the differences of a signal that both contain; a parabola through the
    largest three values gives the fraction of a sample.

    Args:
        signal: Name of the common signal in ``first``.
        other: Its name in ``second``; by default the same.

    Returns:
        Shift in s (subtract it from the time of ``second``) and the correlation there, 1 at best.

    Raises:
        WorkbenchError: If a signal is missing or constant.
    """
    from scipy.signal import correlate

    dt = min(first.sample_time, second.sample_time)
    curves = []
    for recording, name in ((first, signal), (second, other or signal)):
        n = int(np.floor(recording.duration / dt)) + 1
        if n < 10:
            raise WorkbenchError(f"recording {recording.name!r} is too short to align")
        even = resample(recording.select([name]), times=recording.time[0] + dt * np.arange(n))[name]
        if np.ptp(even) == 0:
            raise WorkbenchError(
                f"signal {name!r} of recording {recording.name!r} is constant; align on one that "
                "moves"
            )
        curves.append(_whitened(even))
    correlation = correlate(curves[1], curves[0], mode="full", method="fft")
    best = int(np.argmax(correlation))
    fraction = 0.0
    if 0 < best < len(correlation) - 1:
        left, middle, right = correlation[best - 1 : best + 2]
        bend = left - 2 * middle + right
        fraction = float(0.5 * (left - right) / bend) if bend else 0.0
    lag = best - (len(curves[0]) - 1) + fraction
    shift = lag * dt + float(second.time[0] - first.time[0])
    return shift, float(correlation[best])


def align(
    first: Recording,
    second: Recording,
    signal: str,
    *,
    other: str | None = None,
    least_correlation: float = 0.3,
) -> Recording:
    """Add the signals of a second recording to a first one, on the first one's time base.

    Args:
        second: Recording of the same experiment by another logger.
        signal: Name in ``first`` of a signal that both contain.
        other: Its name in ``second``; by default the same.
        least_correlation: Normalised correlation below which the recordings do not belong
            together.

    Returns:
        The overlap of both; signals of ``second`` that ``first`` has under the same name are left
        out. The shift stands in the notes.

    Raises:
        WorkbenchError: If they have nothing in common or do not overlap.
    """
    shift, likeness = clock_shift(first, second, signal, other=other)
    if likeness < least_correlation:
        raise WorkbenchError(
            f"recordings {first.name!r} and {second.name!r} do not match on {signal!r} "
            f"(correlation {likeness:.2f}, {least_correlation} or more is needed); align on "
            "another signal"
        )
    moved = replace(second, time=second.time - shift)
    start, stop = max(first.time[0], moved.time[0]), min(first.time[-1], moved.time[-1])
    if stop - start < 2 * first.sample_time:
        raise WorkbenchError(
            f"recordings {first.name!r} and {second.name!r} do not overlap in time"
        )
    kept = first.between(float(start), float(stop))
    added = resample(moved, times=kept.time)
    spans = tuple(
        replace(span, start=span.start - shift, stop=span.stop - shift)
        for span in second.excluded
        if span.signal not in first
    )
    extra = tuple(s for s in added.signals if s.name not in first)
    note = (
        f"aligned with {second.name!r} on {signal!r}: its clock was {shift:.6g} s ahead "
        f"(correlation {likeness:.3f}); added {', '.join(s.name for s in extra) or 'nothing'}"
    )
    return replace(kept, signals=(*kept.signals, *extra), excluded=(*kept.excluded, *spans)).noted(
        note
    )
