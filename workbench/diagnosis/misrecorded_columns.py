"""Columns that came late, dropped out, are exchanged or in a wrong unit or sign; refits tell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
import numpy.typing as npt

from workbench.arrays import Matrix, Vector, runs
from workbench.diagnosis.estimation.free_run import FreeRun, free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import filter_of
from workbench.diagnosis.estimation.process_noise import perfect_cost
from workbench.diagnosis.estimation.start import FEW, fit_to_few
from workbench.diagnosis.selection.rules import SAME
from workbench.diagnosis.undeclared.inputs import clearly_likelier
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.units import from_si, in_time, of_difference, to_si, with_unit
from workbench.recordings.checks.check import MAX_EXCLUDED, Finding
from workbench.recordings.checks.expected import expectations, reached
from workbench.recordings.checks.quantisation import MIN_LEVELS
from workbench.recordings.checks.report import CheckReport, check_recording, check_row
from workbench.recordings.checks.time_base import check_time_base
from workbench.recordings.checks.units import check_units
from workbench.recordings.recording import Recording

_LEFT = 0.1
"""Part of what is left out that may stay where a row is all that was wrong: less has causes too."""

_ROWS = 3000
"""Rows of a recording that tell."""

_BACK = 0.1
"""Part of a break between the values before and after it, at most, where an input goes on."""

_FEW, _MOST_LEFT = 3, 0.5
"""Breaks of an input in all that may be dropouts, and part of what is left out that may stay."""

_TIMES = ("us", "ms", "s", "min", "h")
"""Units in which people write a time."""


def moved_up(recording: Recording, names: Sequence[str], rows: int) -> Recording:
    """Return a recording with some columns moved towards its begin by some rows."""
    signals = tuple(
        replace(s, values=np.append(s.values[rows:], np.full(rows, s.values[-1])))
        if s.name in names
        else s
        for s in recording.signals
    )
    return replace(recording, signals=signals)


def with_commands_in_time(
    model: Model, recordings: Sequence[Recording]
) -> tuple[Sequence[Recording], tuple[dict[str, str], ...]]:
    """Move commands up by one row, where that explains nearly all that the refitted model lacks.

    A program that reads, computes and writes, and then records what it read beside what it wrote
    before, records each command one row late. No law of a machine is ahead of its command.

    Returns:
        The recordings, the same ones where that is not so, and what is said of it, as rows of the
        checks of recordings.
    """
    names = [
        q.name
        for q in model.inputs
        if q.commanded and all(q.name in r and np.ptp(r[q.name]) > 0.0 for r in recordings)
    ]
    first = recordings[0].take(slice(_ROWS))
    if not names or len(first) < 3:
        return recordings, ()

    def lacks(rows: int) -> float:
        return _lacks(model, [moved_up(first, names, rows)])

    try:
        before = lacks(0)
        late = before > SAME / _LEFT and lacks(1) < _LEFT * before
        if not late or lacks(2) < _LEFT * before:
            return recordings, ()
    except (WorkbenchError, np.linalg.LinAlgError):
        return recordings, ()
    note = (
        f"{' and '.join(names)} acted a row before being written: moved up by one, "
        f"{in_time(first.sample_time)}, which explains nearly all that the model left out"
    )
    row = check_row(first.name, "rows", "corrected", note)
    return [moved_up(r, names, 1) for r in recordings], (row,)


def _breaks(values: Vector, *, short: bool) -> npt.NDArray[np.bool_]:
    """Find samples, shape (n,), between two of one value that fall to the least or largest of all.

    Of a few levels, as those of a switch, none does.

    Args:
        short: Whether others that fall as far for no longer count too.
    """
    bad = np.zeros(len(values), dtype=bool)
    if len(np.unique(values)) < MIN_LEVELS:
        return bad
    for end in (values.min(), values.max()):
        spells = [(a, b) for a, b in runs(values == end) if a > 0 and b + 1 < len(values)]
        apart = np.array([[abs(values[k] - end) for k in (a - 1, b + 1)] for a, b in spells])
        back = [abs(np.ptp(way)) < _BACK * way.min() for way in apart]
        longest = max((b - a for (a, b), q in zip(spells, back, strict=True) if q), default=-1)
        for (a, b), returns in zip(spells, back, strict=True):
            bad[a : b + 1] |= returns or (short and b - a <= longest)
    return bad if np.mean(bad) <= MAX_EXCLUDED else np.zeros_like(bad)


def with_breaks_bridged(
    model: Model, recordings: Sequence[Recording]
) -> tuple[Sequence[Recording], tuple[dict[str, str], ...]]:
    """Bridge moments in which an input reads nothing or all, where the machine knows none of them.

    They take most of what the refitted model lacks.

    Returns:
        The recordings, the same ones where that is not so, and what is said of it, as rows of the
        checks of recordings.
    """
    rows = []
    for q in model.inputs:
        if not all(q.name in r and np.isfinite(r[q.name]).all() for r in recordings):
            continue
        trials = [[_breaks(r[q.name], short=way) for r in recordings] for way in (False, True)]
        if sum(len(runs(bad)) for bad in trials[0]) < _FEW:
            continue
        given = [_bridged(recordings, q.name, failed) for failed in trials]
        try:
            before, *after = (_lacks(model, trial[:FEW]) for trial in (recordings, *given))
        except (WorkbenchError, np.linalg.LinAlgError):
            continue
        best = int(np.argmin(after))
        if before < SAME or after[best] > _MOST_LEFT * before:
            continue
        recordings = [
            _timed(model, r, q.name, bad) if bad.any() else r
            for r, bad in zip(given[best], trials[best], strict=True)
        ]
        for recording, bad in zip(recordings, trials[best], strict=True):
            lasting = in_time(float(bad.sum()) * recording.sample_time)
            note = (
                f"{q.name} of {recording.name} drops out {len(runs(bad))} times, for {lasting} in"
                " all, which the machine does not follow; bridged"
            )
            rows.append(check_row(recording.name, "rows", "corrected", note))
    return recordings, tuple(rows)


def _bridged(
    recordings: Sequence[Recording], name: str, failed: Sequence[npt.NDArray[np.bool_]]
) -> list[Recording]:
    """Return recordings of which some samples of a signal get the value of the nearest other."""
    bridged = []
    for recording, bad in zip(recordings, failed, strict=True):
        good = np.flatnonzero(~bad)
        nearest = good[np.argmin(np.abs(np.flatnonzero(bad)[:, None] - good), axis=1)]
        signal = recording.signal(name)
        values = signal.values.copy()
        values[bad] = values[nearest]
        told = recording.with_signal(replace(signal, values=values))
        bridged.append(told.excluding(name, bad, "dropout") if bad.any() else recording)
    return bridged


def _timed(model: Model, recording: Recording, name: str, bad: npt.NDArray[np.bool_]) -> Recording:
    """Return a bridged recording in which an input steps within each break when that is likeliest.

    Args:
        bad: Samples of the input that were bridged, shape (n,), dimensionless.
    """
    try:
        fit, (seen,) = fit_to_few(model, [recording])
        filter_ = filter_of(fit.model, seen, fit.noise_scale)
        inputs, column = seen.inputs, [q.name for q in model.inputs].index(name)
        for first, last in runs(bad):
            ways = [_stepped(inputs, column, first, last, at) for at in range(first, last + 2)]
            if inputs[first - 1, column] != inputs[last + 1, column]:
                given = [replace(seen, inputs=way) for way in ways]
                costs = [filter_.run(one, fit.model.values).cost for one in given]
                inputs = ways[int(np.argmin(costs))]
    except (WorkbenchError, np.linalg.LinAlgError):
        return recording
    values = recording[name].copy()
    values[bad] = inputs[bad, column]
    return recording.with_signal(replace(recording.signal(name), values=values))


def _stepped(inputs: Matrix, column: int, first: int, last: int, at: int) -> Matrix:
    """Return inputs, shape (n, n_inputs), of which one steps at a sample within a break."""
    changed = inputs.copy()
    changed[first:at, column] = inputs[first - 1, column]
    changed[at : last + 1, column] = inputs[last + 1, column]
    return changed


def _lacks(model: Model, recordings: Sequence[Recording]) -> float:
    """Return by how much a refitted model is less likely than one that lacks nothing."""
    fit, started = fit_to_few(model, recordings)
    return fit.cost - perfect_cost(fit.model, started)


@dataclass(frozen=True)
class _Reading:
    """A recording, read otherwise than its columns say.

    Args:
        check: Name of the check of recordings whose answer that changes.
        mistake: What is wrong with the columns then.
        fix: How to mend it.
    """

    recording: Recording
    check: str
    mistake: str
    fix: str


def with_columns_tried(model: Model, report: CheckReport) -> CheckReport:
    """Ask refits of a model for exchanged columns, and for a wrong unit of time or a wrong sign.

    Another reading of the columns is refitted where the model as it stands runs closer along it. It
    is right where nearly all that the refitted model leaves out, or misses, goes with it. Where the
    machine differs from the model besides, less does, and it is a doubt.
    """
    if not report.fit:
        return _with_signs_tried(model, report)
    seen = report.recording.take(slice(_ROWS))
    sized = model.sized_by(reached(model, [seen]))
    # What checks corrected may come from the mistake.
    known = {id(r): r.take(slice(_ROWS)) for r in (report.original, report.recording)}
    readings = [other for recording in known.values() for other in _readings(model, recording)]
    trials = [_missed_by(sized, other.recording) for other in readings]
    if not min(trials, default=math.inf) < _missed_by(sized, seen):
        return report
    other = readings[int(np.argmin(trials))]
    names = [q.name for q in (*model.inputs, *model.outputs) if q.name in seen]
    checked = check_recording(other.recording, model=model, required=names)
    if not checked.fit:
        return report
    try:
        (lacks, run), (left, better) = (_run_along(model, r) for r in (seen, checked.recording))
    except (WorkbenchError, np.linalg.LinAlgError):
        return report
    # What misses as much as the measurements move explains nothing.
    closer = _missed(better) / min(_missed(run), 1.0)
    likelier = lacks > SAME / _LEFT and left < lacks - SAME
    # Noise that nobody declared is taken from the recording: it may be all that a wrong one lacks.
    sure = closer < _LEFT**2 or (likelier and min(left / lacks, closer) < _LEFT)
    if closer > _MOST_LEFT or not (sure or likelier):
        return report
    note = (
        f"{other.mistake}, as it seems: the refitted model misses {_rms(better, other.recording)}"
        f" then, and {_rms(run, seen)} as recorded; {other.fix}"
    )

    def told(c: Finding) -> Finding:
        if c.name != other.check:
            return c
        if sure:
            return replace(c, result="unfit", note=note)
        return replace(c, note=f"{c.note}; {note}", doubt=True)

    return replace(report, checks=tuple(told(c) for c in report.checks))


def _readings(model: Model, recording: Recording) -> Iterator[_Reading]:
    """Give the other readings of a recording that its checks let through, as exports mix them up.

    Times are in another unit, or two columns of a model in each other's place.
    """
    names = [q.name for q in (*model.inputs, *model.outputs) if q.name in recording]
    known = partial(expectations, model=model, required=names, signs={})
    stated = {row.signal: row.unit for row in recording.mapping or ()}
    clock = stated.get("time") or "s"
    step = in_time(recording.sample_time)
    for unit in _TIMES:
        factor = float(to_si(1.0, unit) / to_si(1.0, clock))
        if factor != 1.0:
            timed = replace(recording, time=recording.time * factor)
            mistake = (
                f"the time counts {unit}, not {clock} (steps of {in_time(timed.sample_time)}, not"
                f" {step})"
            )
            fix = "give its unit in the header or in a mapping file"
            found = check_time_base(timed, known(timed))
            if found.result == "pass" and not found.doubt:
                yield _Reading(timed, "time base", mistake, fix)
    for pair in combinations(names, 2):
        one, two = (recording.signal(n) for n in pair)
        units = [stated.get(s.name) or s.unit for s in (one, two)]
        numbers = [from_si(s.values, unit) for s, unit in zip((one, two), units, strict=True)]
        exchanged = recording
        for signal, values, unit in zip((one, two), reversed(numbers), units, strict=True):
            exchanged = exchanged.with_signal(replace(signal, values=to_si(values, unit)))
        found = check_units(exchanged, known(exchanged))
        if found.result == "pass" and not found.doubt:
            mistake = f"{one.name} and {two.name} are exchanged"
            fix = "correct the order of the columns in the file or in a mapping (--mapping)"
            yield _Reading(exchanged, "signs", mistake, fix)


def _missed_by(model: Model, recording: Recording) -> float:
    """Return what a model as it stands misses of a recording; infinite if it cannot run along."""
    try:
        return _missed(free_run(model, observe(model, recording)))
    except (WorkbenchError, np.linalg.LinAlgError):
        return math.inf


def _missed(run: FreeRun) -> float:
    """Return the mean square of a run's error over the variance of what was measured."""
    moves = {name: std for name, std in run.spread.items() if std > 0.0}
    shares = [run.rmse[name] / std for name, std in moves.items()]
    with np.errstate(over="ignore"):
        return float(np.mean(np.square(shares))) if shares else math.inf


def _run_along(model: Model, recording: Recording) -> tuple[float, FreeRun]:
    """Return what a refitted model lacks, as `_lacks`, and its run along the recording."""
    told, _ = with_undeclared(model, [recording])
    fit, started = fit_to_few(told, [recording])
    return fit.cost - perfect_cost(fit.model, started), free_run(fit.model, started[0])


def _rms(run: FreeRun, recording: Recording) -> str:
    """Say by how much a run misses the measurements."""
    said = []
    for name, unit in zip(run.used, run.units, strict=True):
        shown = of_difference(recording.signal(name).display_unit or unit)
        said.append(f"{name} by {with_unit(f'{from_si(run.rmse[name], shown):.3g}', shown)} rms")
    return ", ".join(said)


def _with_signs_tried(model: Model, report: CheckReport) -> CheckReport:
    """Doubt a wrong sign without which the refitted model follows a recording no better.

    A command that answers to what it moves, as in a drive that takes the coupling of its axes away
    or a heater when a door was opened, goes with the answer of others: its own may show the other
    way round.
    """
    wrong = next((c for c in report.checks if c.values.get("turned")), None)
    if wrong is None or wrong.result != "unfit":
        return report
    seen = report.recording
    told, _ = with_undeclared(model, [seen])
    for name in wrong.values["turned"]:
        other = seen.with_signal(replace(seen.signal(name), values=-seen[name]))
        if clearly_likelier(told, told, [other], [seen]):
            return report
    note = f"{wrong.note.partition(';')[0]}, but reversed the model follows it no better"
    doubt = replace(wrong, result="pass", note=note, doubt=True)
    return replace(report, checks=tuple(doubt if c is wrong else c for c in report.checks))
