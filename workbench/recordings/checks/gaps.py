"""Are rows or cells missing, or rows out of order behind a clock that goes on?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector, runs
from workbench.model.units import in_time
from workbench.recordings.checks.check import MAX_EXCLUDED, MIN_SAMPLES, Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.noise import white_rms
from workbench.recordings.recording import Recording
from workbench.recordings.resampling import resample

FILLED_ROWS = 5
"""Missing rows in a row that are interpolated; a longer gap splits the recording."""


_FEWEST, _REGULAR = 20, 2.5
"""Measurements that a slow sensor gives at least, and the time between two of them over the usual
one from which on some are missing."""

_SLOW, _UNEVEN = 1.9, 1.5
"""Rows from one reading of a sensor to the next, on the mean, from which on it is a slow one, and
by how many its readings may come early and late in all: one, beside rounding."""


def filled(recording: Recording, name: str, bad: npt.NDArray[np.bool_], reason: str) -> Recording:
    """Exclude bad samples, shape (n,), from judgement: commands hold, measurements interpolate."""
    signal, time = recording.signal(name), recording.time
    good = ~bad & np.isfinite(signal.values)
    values = signal.values.copy()
    if good.any():
        if signal.zero_order_hold:
            index = np.searchsorted(np.flatnonzero(good), np.flatnonzero(bad), side="right") - 1
            values[bad] = signal.values[good][np.clip(index, 0, None)]
        else:
            values[bad] = np.interp(time[bad], time[good], signal.values[good])
    return recording.with_signal(replace(signal, values=values)).excluding(name, bad, reason)


def gap_limit(time: Vector) -> float:
    """Return the step above which rows are missing, in s.

    Args:
        time: Increasing instants, shape (n,), in s.
    """
    steps = np.diff(time)
    usual, high = (float(q) for q in np.quantile(steps, [0.5, 0.95]))
    return usual * (1.5 if _regular(steps) else max(3.0, 1.5 * high / usual))


def _regular(steps: Vector) -> bool:
    """Tell whether steps are alike, or whole multiples of the usual one, as where rows are lost."""
    low, usual, high = np.quantile(steps, [0.05, 0.5, 0.95])
    lost = np.abs(steps / usual - np.round(steps / usual)) if usual > 0.0 else steps
    return bool(high - low < 0.2 * usual or (low > 0.9 * usual and np.mean(lost < 0.1) > 0.95))


def pieces(recording: Recording) -> tuple[tuple[Recording, ...], str]:
    """Return what lies between gaps that are too long to fill, and what there is to say of them.

    Nobody knows the command in such a gap, nor where it left the machine: what comes after it
    begins anew.
    """
    time, usual = recording.time, recording.sample_time
    if len(time) < MIN_SAMPLES:
        return (recording,), ""
    wide = np.flatnonzero(np.diff(time) > max(gap_limit(time), (FILLED_ROWS + 1.5) * usual))
    if not wide.size:
        return (recording,), ""
    edges = [0, *(int(k) + 1 for k in wide), len(time)]
    worst = int(wide[np.argmax(np.diff(time)[wide])])
    longest = f"{in_time(time[worst + 1] - time[worst], 4)} after {time[worst]:.6g} s"
    return tuple(
        replace(recording.take(slice(*ends)), name=f"{recording.name} ({k} of {len(edges) - 1})")
        for k, ends in enumerate(pairwise(edges), start=1)
    ), f"{wide.size} gap(s) too long to fill, the longest {longest}"


def _on_change(values: Vector) -> bool:
    """Tell whether a signal is written from the first row on, and then where it is another."""
    written = values[np.isfinite(values)]
    return bool(np.isfinite(values[0]) and len(written) > 1 and np.all(np.diff(written) != 0.0))


def _held(values: Vector) -> Vector:
    rows = np.where(np.isfinite(values), np.arange(len(values)), 0)
    return np.asarray(values[np.maximum.accumulate(rows)])


def _where_measured(
    recording: Recording, commands: Sequence[str], measured: npt.NDArray[np.bool_]
) -> Recording:
    """Keep the rows that hold a measurement and follow a first message of each command."""
    rows = measured & np.all([np.isfinite(recording[c]) for c in commands], axis=0)
    there = resample(recording.select(commands), times=recording.time[rows])
    kept = recording.take(rows)
    for name in commands:
        kept = kept.with_signal(there.signal(name))
    return kept


def _now_and_then(time: Vector, measured: npt.NDArray[np.bool_]) -> float:
    """Return the usual time between the samples of a slow sensor, in s; 0 if many are missing."""
    if measured.sum() < _FEWEST:
        return 0.0
    usual = float(np.median(np.diff(time[measured])))
    gaps = np.diff(np.concatenate([time[:1], time[measured], time[-1:]]))
    lost = float(gaps[gaps > _REGULAR * usual].sum())
    return usual if lost <= MAX_EXCLUDED * (time[-1] - time[0]) else 0.0


def _repeated(values: Vector) -> tuple[npt.NDArray[np.bool_], float]:
    """Find what a sensor that is slower than the rows repeats until it reads anew.

    Its readings change at even intervals of two rows or more, and not by one step of a converter,
    as those of a counter at a constant speed do.

    Returns:
        Which samples, shape (n,), are repetitions, and the rows from one reading to the next.
    """
    nothing = np.zeros(len(values), dtype=bool), 1.0
    steps = np.abs(np.diff(values))
    new = np.flatnonzero(steps) + 1
    if len(new) < _FEWEST:
        return nothing
    apart = np.diff(new)
    usual = float(np.mean(apart[apart <= np.median(apart) + 1]))
    number = np.concatenate([[0.0], np.cumsum(np.round(apart / usual))])
    every = float((new[-1] - new[0]) / number[-1])
    late = new - new[0] - every * number
    one_step = np.mean(steps[new - 1] < 1.5 * np.min(steps[new - 1])) > 0.5
    if every < _SLOW or np.ptp(late) > _UNEVEN or len(new) < 0.5 * number[-1] or one_step:
        return nothing
    again = np.ones(len(values), dtype=bool)
    # Some readings are as the one before by chance.
    as_before = np.setdiff1d(np.arange(number[-1]), number)
    again[np.round(new[0] + every * as_before).astype(int)] = False
    again[[0, *new]] = False
    return again, every


def _missing_rows(recording: Recording) -> tuple[Recording, list[str]]:
    """Insert the rows of short gaps."""
    time, usual = recording.time, recording.sample_time
    short = np.flatnonzero(np.diff(time) > gap_limit(time))
    if not short.size:
        return recording, []
    counts = np.maximum(1, np.round(np.diff(time)[short] / usual).astype(int) - 1)
    ends = zip(time[short], time[short + 1], counts, strict=True)
    added = np.concatenate([np.linspace(a, b, n + 2)[1:-1] for a, b, n in ends])
    union = np.concatenate([time, added])
    order = np.argsort(union, kind="stable")
    new = order >= len(time)
    signals = []
    for signal in recording.signals:
        values = np.concatenate([signal.values, np.full(len(added), np.nan)])[order]
        signals.append(replace(signal, values=values))
    grown = replace(recording, time=union[order], signals=tuple(signals))
    for name in grown.names:
        grown = filled(grown, name, new, "row missing")
    return grown, [f"{len(added)} missing row(s) in {short.size} place(s) interpolated"]


@check(
    "gaps",
    20,
    foundation=True,
    fix="split the file at the gaps and give the parts as recordings of their own",
)
def check_gaps(recording: Recording, expected: Expected) -> Finding:
    """Check for missing rows and cells; fill short gaps and exclude them from judgement.

    A gap of more than five rows splits the recording (`pieces`); the longest piece is looked at.
    """
    total, notes = len(recording), []
    between, gaps = pieces(recording)
    kept = max(between, key=len)
    if gaps:
        notes = [
            f"{gaps}; a fit takes each piece, this looks at the longest: {kept.time[0]:.6g} to"
            f" {kept.time[-1]:.6g} s ({len(kept)} of {total} rows)"
        ]
    if gaps and len(kept) < MIN_SAMPLES:
        return Finding("unfit", f"{notes[0]}, which needs {MIN_SAMPLES} rows or more")
    piece, more = _missing_rows(replace(kept, name=recording.name))
    notes += more
    measured = np.any([np.isfinite(piece[m]) for m in piece.measurements], axis=0)
    messages: list[str] = []
    for signal in piece.signals:
        bad = ~np.isfinite(signal.values)
        share = float(np.mean(bad))
        if not share:
            continue
        if signal.zero_order_hold and share > 0.5 and _on_change(signal.values):
            piece = piece.with_signal(replace(signal, values=_held(signal.values)))
            notes.append(f"{signal.name} is written where it changes only, and held until then")
            continue
        limit = 0.01 if signal.zero_order_hold else MAX_EXCLUDED
        every = _now_and_then(piece.time, ~bad) if share > limit else 0.0
        if every and signal.zero_order_hold and _regular(np.diff(piece.time[~bad])):
            piece = piece.with_signal(replace(signal, values=_held(signal.values)))
            messages.append(signal.name)
            notes.append(f"{signal.name} is written every {in_time(every)}, and held until then")
            continue
        if every and not signal.zero_order_hold:
            piece = filled(piece, signal.name, bad, "not recorded")
            notes.append(f"{signal.name} is measured every {in_time(every)} only")
            continue
        if share > limit and signal.name in expected.required:
            return Finding(
                "unfit",
                f"{signal.name} is missing in {100 * share:.3g} % of the rows; at most "
                f"{100 * limit:g} % can be bridged",
            )
        if share > limit:
            piece = piece.select([n for n in piece.names if n != signal.name])
            notes.append(f"{signal.name} left out, missing in {100 * share:.3g} % of the rows")
            continue
        where = runs(bad)
        longest = max(where, key=lambda ab: ab[1] - ab[0])
        piece = filled(piece, signal.name, bad, "not recorded")
        notes.append(
            f"{int(bad.sum())} missing sample(s) of {signal.name} bridged and excluded, the "
            f"longest stretch at {piece.time[longest[0]]:.6g} s "
            f"({longest[1] - longest[0] + 1} samples)"
        )
    for name in piece.measurements:
        again, rows = _repeated(piece[name])
        if np.any(again):
            piece = filled(piece, name, again, "repeated reading")
            told = in_time(rows * piece.sample_time)
            notes.append(f"{name} is measured every {told} only, and repeated until then")
    if messages:
        piece = _where_measured(piece, messages, measured)
    if not piece.signals:
        return Finding("unfit", f"no signal is left: {'; '.join(notes)}")
    if notes:
        values = {"rows_left": len(piece), "rows": total}
        return Finding("corrected", "; ".join(notes), values, piece)
    return Finding("pass", "no row or cell missing", {"rows": total})


_RARE = 0.995
"""Share of the steps between samples that are usual."""
_TIMES = 3.0
"""How many times a jump exceeds them."""
_FEW = 2
"""Jumps from which it is no accident."""


def _jumps(values: Vector) -> npt.NDArray[np.bool_]:
    steps = np.abs(np.diff(values))
    usual = max(float(np.quantile(steps, _RARE)), 3.0 * white_rms(values))
    return np.asarray(steps > _TIMES * usual)


@check(
    "continuity",
    85,
    fix="export the rows in the order in which they were sampled, one recording per file",
)
def check_continuity(recording: Recording, _expected: Expected) -> Finding:
    """Look for instants at which every measurement jumps far beyond its usual steps.

    A machine has no reason to: each of its quantities has its own inertia. A clock that goes on
    hides that rows were left out, sorted wrongly or joined from several files.
    """
    moving = recording.moving(recording.measurements)
    if len(moving) < 2:
        return Finding("not checked", "one measurement alone may jump")
    at_once = np.flatnonzero(np.all([_jumps(recording[m]) for m in moving], axis=0))
    if len(at_once) < _FEW:
        return Finding("pass", "no jumps of all measurements at once")
    shown = ", ".join(f"{recording.time[k]:.4g}" for k in at_once[:4])
    more = ", ..." if len(at_once) > 4 else ""
    note = (
        f"all measurements jump at once, {len(at_once)} times (after {shown}{more} s): rows may be"
        " missing, out of order, or joined from several recordings"
    )
    return Finding("pass", note, {"instants": recording.time[at_once]}, doubt=True)
