"""Is a column reversed whose response has the wrong sign?"""

from __future__ import annotations

from dataclasses import replace

from workbench.diagnosis.undeclared.inputs import clearly_likelier
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.model import Model
from workbench.recordings.checks.report import CheckReport


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
