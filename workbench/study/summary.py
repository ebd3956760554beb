"""The outcome of a study for a terminal, and how scores and parameters are written."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from workbench.computing.counted import in_words
from workbench.display import aligned_table
from workbench.model.units import from_si, in_time, shown_unit, with_unit
from workbench.study.grouped import Group, changes_by_plant, missed_by_plant
from workbench.study.judgements import RUN_FAILED, Judgement
from workbench.study.result import StudyResult
from workbench.study.robustness import Robustness
from workbench.study.tasks import Record
from workbench.verification import MetricValue
from workbench.verification.metrics import columns, labels_of
from workbench.verification.responses import BAND

MOST = 20
"""Entries of a list that are written out."""


def plain_summary(outcome: StudyResult) -> str:
    """Write the outcome as a few lines for a terminal."""
    lines = []
    worse = [c for c in outcome.worse if not c.failed]
    for s in outcome.scores if outcome.judgements else ():
        state = "met" if s.met else "MISSED"
        if s.judgement is None:
            state = "no hard requirement"
        tail = f"  ({s.judgement})" if s.judgement else ""
        if s.judgement is not None and s.judgement.reason.startswith(RUN_FAILED):
            tail = "  (its runs failed)"
        score = score_text(s.worst) if s.judgement else "–"
        lines.append(f"{s.controller:<20} score {score:>8}  {state}{tail}")
    for r in outcome.robustness:
        state = f"MISSED  ({r.why()})" if r.missed else "met"
        score = score_text(r.worst_score, capped=True)
        lines.append(f"{r.controller:<20} box   {score:>8}  {state}")
    for distance in outcome.distances.worst:
        if (step := distance.worst) is not None:
            times = f"{step.settling.value:#.3g} s / {step.limit.value:#.3g} s"
            text = f"{distance.ratio.value:.2g} ({times})"
            if math.isnan(distance.ratio.value):
                text = f"none ({distance.ratio.reason})"
            where = ", ".join(filter(None, (distance.scenario, distance.case)))
            lines.append(f"{distance.controller:<20} {text} settling / physical limit, {where}")
    for title, entries in (
        (
            "missed",
            [f"{g.worst}{_also(g)}" for g in missed_by_plant(without_failed(outcome.missed))],
        ),
        ("failed", [f"{who}, {where}: {why}" for who, where, why in failures(outcome)]),
        ("changed condition", [str(c) for c in outcome.weakened]),
        ("worse", [f"{g.worst}{_also(g)}" for g in changes_by_plant(worse, outcome.required)]),
    ):
        lines += [f"{title}: {entry}" for entry in entries[:MOST]]
        if len(entries) > MOST:
            lines.append(f"{title}: and {len(entries) - MOST} more in results.json")
    if outcome.work:
        lines.append(f"work: {in_words(outcome.work)}")
    word = outcome.verdict().replace("failed", "FAILED", 1)
    return "\n".join([*lines, f"{outcome.study.name} {word}: {outcome.headline()}"])


def step_tables(outcome: StudyResult, plant: str) -> str:
    """Write a table of each scenario for a terminal, a row for each controller.

    Of several outputs, it holds those that step; of what a step does to others, the most, over the
    output's scale; and how far they go the wrong way, where that is more than a step may be away
    when it has settled.
    """
    study = outcome.study
    parts: list[str] = []
    scales = {q.name: q.scale for q in study.plant.build().outputs}
    for scenario in study.scenarios:
        done = [
            (f"{r.controller} on {study.variations[r.variation].case}", r.metrics)
            for r in outcome.records
            if r.scenario == scenario and r.metrics is not None
        ]
        wrong = [m for _, found in done for m in found.values if m.name.endswith("undershoot")]
        backwards = any(m.value > BAND for m in wrong)
        named = (*columns("summary"), *(["undershoot"] if backwards else []))
        labels = labels_of(named, (n for _, m in done for n in m))
        stepped = {n.removesuffix("settling_time") for n in labels if n.endswith("settling_time")}
        shown = [n for n in labels if n.rpartition(".")[0] in {p.rstrip(".") for p in stepped}]
        rows: list[list[str]] = []
        reasons: dict[str, list[str]] = {}
        for controller, found in done:
            name = controller.removesuffix(" on ")
            row, own = [name], {m.name: m for m in found.values}
            for label in shown:
                m = own.get(label)
                row.append(_terse(m) if m is not None else "")
                if m is not None and m.reason and math.isnan(m.value):
                    why = f"{label.replace('_', ' ')}: {m.reason}"
                    reasons.setdefault(why, []).append(name)
            moved = [found[n] for n in found if n.endswith(".interaction")]
            if moved:
                most = max(moved, key=lambda m: m.value / scales[m.name.partition(".")[0]])
                row.append(f"{most.name.partition('.')[0]} {_terse(most)}")
            rows.append(row)
        if rows:
            heads = [n.removeprefix(next(iter(stepped))) if len(stepped) == 1 else n for n in shown]
            more = ["interaction"] if len(rows[0]) > 1 + len(heads) else []
            heads = ["controller", *(n.replace("_", " ") for n in heads), *more]
            parts += [f"{plant}, {scenario}", aligned_table(heads, rows, width=None)]
            parts += [f"no {why} ({', '.join(who)})" for why, who in reasons.items()]
    return "\n".join(parts)


def _terse(metric: MetricValue) -> str:
    value, unit = metric.shown()
    return "none" if math.isnan(value) else with_unit(f"{value:.3g}", unit)


def score_text(value: float, *, capped: bool = False) -> str:
    """Write a score, a ratio; where ``capped``, 10 stands for 10 and above."""
    if math.isinf(value) or math.isnan(value):
        return "no value"
    return "≥ 10" if capped and value >= 10.0 else f"{value:.2f}"


def parameter_text(value: float, unit: str) -> str:
    """Write the value of a parameter, in its SI unit, as people read it."""
    shown = shown_unit(unit)
    if shown == "s":
        return in_time(value)
    return with_unit(f"{float(from_si(value, shown)):.3g}", shown)


def _also(group: Group[Any]) -> str:
    return f" ({group.also})" if group.others else ""


def without_failed(judgements: Iterable[Judgement]) -> list[Judgement]:
    """Return judgements of runs that did not fail: a failed one is told once, with its reason."""
    return [j for j in judgements if not j.reason.startswith(RUN_FAILED)]


def failures(outcome: StudyResult) -> tuple[tuple[str, str, str], ...]:
    """Return controllers, the runs of each that failed, and why: once for each reason."""
    found: dict[tuple[str, str], list[Record]] = {}
    for record in outcome.failed:
        found.setdefault((record.controller, record.reason), []).append(record)
    said = []
    for (controller, reason), rows in found.items():
        every = sum(r.controller == controller for r in outcome.records)
        first = rows[0]
        where = f"{first.scenario}, {first.variation}, seed {first.seed}"
        count = where if len(rows) == 1 else f"{len(rows)} of {every} runs"
        said.append((controller, count, reason))
    return tuple(said)


def worst_plant(outcome: StudyResult, found: Robustness) -> str:
    """Write the parameters of the worst plant of a box, with their units."""
    units = {q.name: q.unit for q in outcome.study.plant.build().parameters}
    return ", ".join(f"{n} {parameter_text(v, units[n])}" for n, v in found.worst.items())
