"""Machines that differ from what the designs know: what each design holds, and what costs most."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.model.units import convert
from workbench.reports.drawn_machines import (
    Measured,
    Tried,
    missed_table,
    reached_table,
    worst_table,
)
from workbench.reports.figure import Figure
from workbench.reports.figures.robustness import draw_scores
from workbench.reports.figures.study_traces import shades_of
from workbench.reports.metrics_table import demand_text, metric_title
from workbench.reports.page import Block
from workbench.reports.pictures import Picture
from workbench.reports.tables import Table
from workbench.study.judgements import LARGEST, Judgement
from workbench.study.result import StudyResult
from workbench.study.study import Demand, Variation
from workbench.study.tasks import Record
from workbench.verification.metrics import columns, labels_of

_TOLD = 4
"""Metrics that are told beside what is required."""


def _words(demand: Demand) -> str:
    where = demand.requirement.scenario
    return f"{demand_text(demand)}{f', {where}' if where else ''}"


def tried(outcome: StudyResult) -> tuple[tuple[Tried, ...], tuple[Measured, ...]]:
    """Return runs of a study on its nominal plant and those that differ, and what is told."""
    study = outcome.study
    # Of several outputs the metrics have names of their own.
    had = dict.fromkeys(n for r in outcome.records if r.metrics is not None for n in r.metrics)
    required = {d.requirement.metric for d in study.demands}
    told = [n for n in labels_of(columns("page")[:_TOLD], had) if n not in required]
    units: dict[str, str] = {}
    runs = [
        _tried(key, study.variations[key[1]], records, judged, told, units)
        for key, (records, judged) in _together(outcome).items()
    ]
    lines = [Measured(_words(d), d.requirement.unit or "1", required=True) for d in study.demands]
    lines += [Measured(metric_title(name), units.get(name, "1")) for name in told]
    return tuple(runs), tuple(lines)


Key = tuple[str, str]


def _together(outcome: StudyResult) -> dict[Key, tuple[list[Record], list[Judgement]]]:
    """Return records and judgements of a design on a machine, with all scenarios and seeds."""
    found: dict[Key, tuple[list[Record], list[Judgement]]] = {}
    for record in outcome.records:
        variation = outcome.study.variations[record.variation]
        if variation.nominal or variation.differs:
            found.setdefault((record.controller, record.variation), ([], []))[0].append(record)
    for j in outcome.judgements:
        if (j.controller, j.variation) in found:
            found[j.controller, j.variation][1].append(j)
    return found


def _tried(
    key: Key,
    variation: Variation,
    records: Sequence[Record],
    judged: Sequence[Judgement],
    told: Sequence[str],
    units: dict[str, str],
) -> Tried:
    reason = next((r.reason for r in records if r.metrics is None), "")
    values: dict[str, list[float]] = {}
    for measured in (r.metrics for r in records if r.metrics is not None):
        for name in (name for name in told if name in measured):
            metric = measured[name]
            value = convert(metric.value, metric.unit, units.setdefault(name, metric.shown()[1]))
            if not math.isnan(value):
                values.setdefault(metric_title(name), []).append(float(value))
    scores: dict[str, float] = {}
    for j in judged if not reason else ():
        what = _words(j.demand)
        values.setdefault(what, []).append(math.inf if math.isnan(j.value) else j.value)
        scores[what] = max(j.score, scores.get(what, 0.0))
    return Tried(*key, variation.differs, values, scores, reason)


def drawn_tables(outcome: StudyResult) -> list[Table]:
    """Return what designs reach on machines that differ, and what costs most."""
    runs, lines = tried(outcome)
    if not any(run.differs for run in runs):
        return []
    tables = [
        reached_table(runs, lines, "Machines that differ"),
        missed_table(runs),
        worst_table(runs),
    ]
    return tables if lines[0].required else tables[:1]


def _draw(outcome: StudyResult) -> list[Block]:
    tables = drawn_tables(outcome)
    if len(tables) < 2:
        return list(tables)
    scores: dict[str, list[float]] = {}
    for run in tried(outcome)[0]:
        if run.differs:
            scores.setdefault(run.controller, []).append(min(run.score, LARGEST))
    picture = Picture(
        "machines-scores",
        draw_scores(
            {name: (np.array(own), len(own)) for name, own in scores.items()},
            shades_of(outcome.study),
        ),
        "Worst score of each controller on every machine that differs; right of the dashed line a"
        " limit is missed; the ring is the worst machine.",
        "scores of the controllers over machines that differ",
    )
    return [tables[0], picture, *tables[1:]]


DRAWN_MACHINES = Figure(
    "drawn-machines", _draw, title="Machines that differ from what the designs know", order=5
)
