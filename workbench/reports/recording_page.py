"""The page of a recording: its signals, how columns became signals, and its checks."""

from __future__ import annotations

from workbench.model.units import in_time
from workbench.recordings.checks.report import CheckReport
from workbench.recordings.recording import Recording
from workbench.reports.figures.recording import recorded
from workbench.reports.page import Answers, Block, Page, Section, Words, again
from workbench.reports.pictures import Picture
from workbench.reports.tables import Cell, Mark, Table, number

_MARKS: dict[str, Mark] = {"pass": "met", "unfit": "missed"}


def recording_page(report: CheckReport, *, command: str) -> Page:
    """Lay out a recording with its checks."""
    seen = report.original
    blocks: list[Block] = [_signals(seen)]
    if seen.mapping is not None:
        blocks.append(_mapping(seen))
    blocks += [Words(f"{note}.", "note") for note in seen.notes if note]
    signals = Section("signals", "Signals", tuple(blocks))
    checks = Section("checks", "Checks", (_checks(report),))
    doubtful = [("doubtful", ", ".join(report.doubtful))] if report.doubtful else []
    return Page(
        f"Recording {seen.name}",
        f"{len(seen)} samples over {in_time(seen.duration, 4)}.",
        (signals, checks, *again(command)),
        facts=(("result", report.result), *doubtful),
        first=(_answers(report), _picture(report)),
    )


def _answers(report: CheckReport) -> Answers:
    """Say whether the recording is fit, and what every check found that did not simply pass."""
    remarks = [check for check in report.checks if check.result != "pass"]
    passed = len(report.checks) - len(remarks)
    return Answers(
        (
            ("fit to judge a model on", "yes" if report.fit else "no"),
            *((check.name, f"{check.result}: {check.note}") for check in remarks),
            ("passed", f"{passed} of {len(report.checks)} checks"),
        )
    )


def _checks(report: CheckReport) -> Table:
    return Table.of(
        "Is it fit to judge a model on?",
        report.checks,
        {
            "check": lambda check: check.name,
            "result": lambda check: Cell(check.result, _MARKS.get(check.result, "open")),
            "what was found": lambda check: check.note,
        },
    )


def _signals(recording: Recording) -> Table:
    rows = []
    for signal in recording.signals:
        good = signal.values[recording.valid(signal.name)]
        shown = signal.displayed(good) if good.size else good
        ends = (float(shown.min()), float(shown.max())) if good.size else (float("nan"),) * 2
        missing = str(len(recording) - good.size)
        unit = signal.display_unit or "?"
        rows.append((signal.name, signal.role, unit, *(number(e, 5) for e in ends), missing))
    return Table("Signals", ("signal", "role", "unit", "least", "most", "missing"), tuple(rows))


def _mapping(recording: Recording) -> Table:
    rows = [
        (row.column, row.signal, row.unit or "not stated", row.si_unit or "taken as SI", row.how)
        for row in (recording.mapping or ())
    ]
    return Table(
        "How columns became signals", ("column", "signal", "unit", "SI unit", "by"), tuple(rows)
    )


def _picture(report: CheckReport) -> Picture:
    seen = report.recording
    return Picture(
        "signals",
        recorded(seen),
        "Every signal of the recording as corrected by the checks; spans that are not to be used"
        " are shaded.",
        ", ".join(s.name.replace("_", " ") for s in seen.signals) + " over time",
    )
