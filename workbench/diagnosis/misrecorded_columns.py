"""Columns that were recorded a row too late, or seem to have the wrong sign; refits tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.diagnosis.estimation.process_noise import perfect_cost
from workbench.diagnosis.estimation.start import fit_to_few
from workbench.diagnosis.selection.rules import SAME
from workbench.diagnosis.undeclared.inputs import clearly_likelier
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.units import in_time
from workbench.recordings.checks.report import CheckReport
from workbench.recordings.recording import Recording

_LEFT = 0.1
"""Part of what is left out that may stay where a row is all that was wrong: less has causes too."""

_ROWS = 3000
"""Rows of a recording that tell."""


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
        fit, started = fit_to_few(model, [moved_up(first, names, rows)])
        return fit.cost - perfect_cost(fit.model, started)

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
