"""Columns that came a row too late, dropped out, or seem to have the wrong sign; refits tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Matrix, Vector, runs
from workbench.diagnosis.estimation.prediction_error import filter_of
from workbench.diagnosis.estimation.process_noise import perfect_cost
from workbench.diagnosis.estimation.start import FEW, fit_to_few
from workbench.diagnosis.selection.rules import SAME
from workbench.diagnosis.undeclared.inputs import clearly_likelier
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.units import in_time
from workbench.recordings.checks.check import MAX_EXCLUDED
from workbench.recordings.checks.report import CheckReport
from workbench.recordings.checks.stuck import MIN_LEVELS
from workbench.recordings.recording import Recording

_LEFT = 0.1
"""Part of what is left out that may stay where a row is all that was wrong: less has causes too."""

_ROWS = 3000
"""Rows of a recording that tell."""

_BACK = 0.1
"""Part of a break between the values before and after it, at most, where an input goes on."""

_FEW, _MOST_LEFT = 3, 0.5
"""Breaks of an input in all that may be dropouts, and part of what is left out that may stay."""


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
    row = {"recording": first.name, "check": "rows", "result": "corrected", "note": note}
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
            rows.append(
                {"recording": recording.name, "check": "rows", "result": "corrected", "note": note}
            )
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


def with_signs_tried(model: Model, report: CheckReport) -> CheckReport:
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
