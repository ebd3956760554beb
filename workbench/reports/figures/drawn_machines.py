"""Machines that differ from what the designs know: what each design holds, and what costs most."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.model.units import convert, with_unit
from workbench.reports.figure import Figure
from workbench.reports.figures.robustness import draw_scores
from workbench.reports.figures.study_traces import shades_of
from workbench.reports.metrics_table import demand_text, metric_title, score_cell
from workbench.reports.page import Block
from workbench.reports.pictures import Picture
from workbench.reports.tables import Cell, Table, number
from workbench.study.judgements import LARGEST, Judgement
from workbench.study.result import StudyResult
from workbench.study.study import Demand, Variation
from workbench.study.tasks import Record
from workbench.verification.metrics import columns, labels_of

WORST = 12
"""Machines that are listed as the worst ones."""


@dataclass(frozen=True)
class Tried:
    """What one design does on one machine.

    Args:
        differs: What differs of the machine; nothing of the nominal one.
        values: Measured values by what is measured, each in the unit of its `Measured`; infinite
            where there is none.
        scores: Scores by what is required, ratios: at most 1 where it is met.
        reason: Why it could not be run; it then meets nothing.
    """

    controller: str
    machine: str
    differs: tuple[str, ...]
    values: Mapping[str, Sequence[float]] = field(default_factory=dict)
    scores: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""

    @property
    def score(self) -> float:
        """Worst score, a ratio."""
        return math.inf if self.reason else max(self.scores.values(), default=0.0)


@dataclass(frozen=True)
class Measured:
    """What is measured of every run.

    Args:
        words: Its name; with the limit where it is required.
    """

    words: str
    unit: str = "1"
    required: bool = False


Lines = Sequence[Measured]


def reached_table(runs: Sequence[Tried], lines: Lines, title: str) -> Table:
    """Return what each design reaches over machines that differ, a column for each design."""
    names = tuple(dict.fromkeys(run.controller for run in runs))
    drawn = {n: [r for r in runs if r.controller == n and r.differs] for n in names}
    nominal = {n: [r for r in runs if r.controller == n and not r.differs] for n in names}

    def meets(what: str) -> Callable[[Tried], bool]:
        return lambda run: run.scores.get(what, math.inf) <= 1.0

    def kept(holds: Callable[[Tried], bool]) -> tuple[Cell, ...]:
        counts = [(sum(map(holds, own)), len(own)) for own in drawn.values()]
        return tuple(Cell(f"{n} of {of}", "met" if n == of else "missed") for n, of in counts)

    def typical(of: Callable[..., float], what: str, among: Mapping[str, list[Tried]]) -> list[str]:
        found = [[v for run in own for v in run.values.get(what, ())] for own in among.values()]
        return [number(float(of(v)), 3) if v else "" for v in found]

    rows: list[tuple[Cell | str, ...]] = []
    if sum(line.required for line in lines) > 1:
        rows.append(("all of the limits", *kept(lambda run: run.score <= 1.0)))
    for line in lines:
        what, unit = line.words, with_unit("", line.unit).strip()
        unit = f" ({unit})" if unit else ""
        if line.required:
            rows.append((what, *kept(meets(what))))
        begin = "  " if line.required else f"{what}, "
        told = {
            "nominal": typical(max, what, nominal),
            "median": typical(np.median, what, drawn),
            "largest": typical(max, what, drawn),
        }
        rows += [(f"{begin}{word}{unit}", *cells) for word, cells in told.items() if any(cells)]
    count = len({run.machine for run in runs if run.differs})
    return Table(
        f"{title}: {count}",
        ("", *names),
        tuple(rows) if names else (),
        "A step that has not settled before the next one counts as infinitely slow.",
    )


def missed_table(runs: Sequence[Tried]) -> Table:
    """Return on how many machines with each difference a design misses a limit."""
    names = tuple(dict.fromkeys(run.controller for run in runs))
    kinds = tuple(dict.fromkeys(kind for run in runs for kind in run.differs))
    with_it = {kind: [run for run in runs if kind in run.differs] for kind in kinds}
    missed = {
        kind: [sum(run.controller == n and run.score > 1.0 for run in own) for n in names]
        for kind, own in with_it.items()
    }
    worst = sorted(kinds, key=lambda kind: -sum(missed[kind]) / len(with_it[kind]))
    machines = {kind: len({run.machine for run in own}) for kind, own in with_it.items()}
    return Table(
        "Machines on which a limit is missed, by what differs",
        ("what differs, alone or with others", "machines", *names),
        tuple(
            (kind.replace("_", " "), str(machines[kind]), *map(str, missed[kind])) for kind in worst
        ),
    )


def worst_table(runs: Sequence[Tried]) -> Table:
    """Return the machines on which most designs miss a limit, and by how much."""
    names = tuple(dict.fromkeys(run.controller for run in runs))
    machines: dict[str, dict[str, Tried]] = {}
    for run in runs:
        if run.differs:
            machines.setdefault(run.machine, {})[run.controller] = run

    def badness(own: Mapping[str, Tried]) -> tuple[int, float]:
        return sum(run.score > 1.0 for run in own.values()), sum(
            min(run.score, LARGEST) for run in own.values()
        )

    worst = sorted(machines.items(), key=lambda item: badness(item[1]), reverse=True)[:WORST]
    rows = []
    for name, own in worst:
        differs = ", ".join(next(iter(own.values())).differs).replace("_", " ")
        cells = (score_cell(own[n].score, capped=True) if n in own else "–" for n in names)
        rows.append((name, differs, *cells))
    title = "The worst machines: worst score of each design"
    note = "Score: what is measured over its limit; at most 1 means met."
    return Table(title, ("machine", "what differs", *names), tuple(rows), note)


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
