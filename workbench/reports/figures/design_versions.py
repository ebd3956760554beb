"""Designs of one kind in several versions, side by side: what knowing a machine is worth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from workbench.reports.figures.study_traces import (
    nominal_runs,
    output_of,
    shades_of,
    shown,
    vector,
    written,
)
from workbench.reports.metrics_table import metric_cell, metric_title
from workbench.reports.page import Block
from workbench.reports.pictures import Picture
from workbench.reports.style import INK, REFERENCE, key, label, named_line, new_figure
from workbench.reports.tables import Cell, Table
from workbench.study.result import StudyResult
from workbench.study.study import Study
from workbench.verification.metrics import columns, labels_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

_METRICS = 2
"""Metrics of each output: how fast, and how far beyond."""

_STYLES = (":", "--", "-")
"""Lines of the versions, of which the last is the newest; as many as a picture may hold."""

_FEW = 10
"""Changes of a reference up to which it is one of steps."""


def versions_of(study: Study) -> dict[str, dict[str, str]]:
    """Return the controllers of each kind by version, in order, where any has several."""
    found: dict[str, dict[str, str]] = {}
    for name, other in study.report.kin:
        if name in study.controllers:
            found.setdefault(other, {})[name.removeprefix(f"{other}, ")] = name
    return found if any(len(own) > 1 for own in found.values()) else {}


def versions(result: StudyResult) -> tuple[Block, ...]:
    """Return a table of the versions and the picture of their first step; nothing without any."""
    study = result.study
    kinds, scenario = versions_of(study), next(iter(study.scenarios))
    if not kinds:
        return ()
    case_of = {name: case.name for case in study.cases.values() for name in case.controllers}
    words = list(dict.fromkeys(word for own in kinds.values() for word in own))
    first = {word: name for own in reversed(kinds.values()) for word, name in own.items()}
    heads = [f"{word}, on {case}" if (case := case_of[first[word]]) else word for word in words]
    records = {name: result.record(name, scenario, case) for name, case in case_of.items()}
    measured = {n: r.metrics for n, r in records.items() if r is not None and r.metrics is not None}
    labels = labels_of(columns("page")[:_METRICS], (c for m in measured.values() for c in m))
    rows: tuple[tuple[Cell | str, ...], ...] = tuple(
        (
            kind if i == 0 else "",
            metric_title(metric),
            *(metric_cell(measured.get(own.get(word, "")), metric) for word in words),
        )
        for kind, own in kinds.items()
        for i, metric in enumerate(labels)
    )
    table = Table("What knowing the machine is worth", ("controller", "", *heads), rows)
    runs = {
        name: record.traces
        for case in study.cases
        for name, record in nominal_runs(result, scenario, case).items()
    }
    latest = words[-len(_STYLES) :]
    drawn = {
        kind: {word: runs[own[word]] for word in latest if own.get(word) in runs}
        for kind, own in kinds.items()
    }
    drawn = {kind: own for kind, own in drawn.items() if own}
    if not drawn:
        return (table,)
    caption = f"{scenario}: each controller in its versions; {', '.join(heads)}."
    return table, Picture("versions", _drawn(result, drawn, latest), caption)


def _drawn(
    result: StudyResult, kinds: Mapping[str, Mapping[str, Mapping[str, object]]], words: list[str]
) -> Drawing:
    study = result.study
    first = next(iter(next(iter(kinds.values())).values()))
    name = next(n for n in first if n.startswith("reference.")).removeprefix("reference.")
    output, shades = output_of(study, name), shades_of(study)
    styles = dict(zip(words, _STYLES[-len(words) :], strict=True))
    figure, panels = new_figure([1.15] * len(kinds))
    time, reference = vector(first["time"]), shown(first[f"reference.{name}"], output)
    changed = time[1:][np.diff(reference) != 0.0]
    ends = (time[0], time[-1])
    if 0 < len(changed) <= _FEW:
        last = changed[1] if len(changed) > 1 else time[-1]
        ends = (max(time[0], changed[0] - 0.1 * (last - changed[0])), last)
    within = (time >= ends[0]) & (time <= ends[1])
    for panel, (kind, own) in zip(panels, kinds.items(), strict=True):
        panel.step(
            time[within], reference[within], where="post", color=REFERENCE.light, linewidth=1.0
        )
        shade = next(shades[n] for n, other in study.report.kin if other == kind)
        for word, traces in own.items():
            at = vector(traces["time"])
            kept = (at >= ends[0]) & (at <= ends[1])
            panel.plot(
                at[kept],
                shown(vector(traces[f"output.{name}"])[kept], output),
                styles[word],
                color=shade.light,
                linewidth=1.5,
            )
        panel.text(0.99, 0.08, kind, transform=panel.transAxes, ha="right", color=shade.light)
        label(panel, y=f"{name} in {written(output.display_unit)}")
    label(panels[-1], x="time in s")
    handles = [named_line(word, INK, width=1.5, style=style) for word, style in styles.items()]
    key(panels[0], columns=4, handles=[*handles, named_line("reference", REFERENCE, width=1.0)])
    return figure
