"""The page of a study, what is met, how the controllers differ, and why; and its other files."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import starmap
from pathlib import Path

from workbench.computing.counted import in_words
from workbench.errors import WorkbenchError
from workbench.files import json_text, write_whole
from workbench.model.units import from_si, in_time, of_difference, with_unit
from workbench.reports.figure import Figure, figures_of, own_figures, sections
from workbench.reports.figures.design_versions import versions
from workbench.reports.figures.linear_analysis import LINEAR, linear_blocks
from workbench.reports.figures.study_traces import breakable, point_text
from workbench.reports.metrics_table import (
    demand_text,
    metric_methods,
    metric_title,
    metrics_table,
    score_cell,
)
from workbench.reports.page import Block, Commands, Method, Page, Section, Words, html, methods
from workbench.reports.pictures import Picture
from workbench.reports.tables import Cell, Mark, Table, number
from workbench.study.ci_files import junit
from workbench.study.grouped import changes_by_plant, missed_by_plant
from workbench.study.judgements import Judgement, Score
from workbench.study.margins import LoopAnalysis
from workbench.study.result import StudyResult, installed_version
from workbench.study.study import Case, Demand, Study, Variation
from workbench.study.summary import parameter_text, score_text, summary
from workbench.study.tasks import Record
from workbench.verification import Metrics
from workbench.verification.metrics import columns, labels_of

_FIRST = 3
"""Metrics of each output on the first screen where nothing is required."""


def study_page(outcome: StudyResult, *, command: str = "", folder: str = "DIR") -> Page:
    """Build the page of a study whose results stand in a folder."""
    study = outcome.study
    own, failed = _own_figures(outcome)
    figures = [*figures_of("study"), *(f for f in own if f.takes == "study")]
    drawn = [(figure, sections([figure], outcome)) for figure in figures]
    each = [*figures_of("scenario"), *(f for f in own if f.takes == "scenario")]
    first, scenarios = _first(outcome, each)
    parts = [
        _verdict(outcome),
        *([_baseline(outcome, folder)] if outcome.baseline is not None else []),
        *scenarios,
        *(section for _, found in drawn for section in found),
        *failed,
        *([_requirements(outcome)] if study.demands else []),
        _how(outcome, [figure for figure, found in drawn if found], command),
    ]
    # What each controller misses in the box stands with the box.
    headline = re.sub(r" \([^()]*\)", "", outcome.headline())
    lead = f"{study.description} {headline[:1].upper()}{headline[1:]}.".lstrip()
    return Page(
        f"Study {study.name}: {outcome.verdict()}",
        lead,
        tuple(part for part in parts if part.blocks),
        first=first,
        facts=(
            ("runs", str(len(outcome.records))),
            ("controllers", str(len(study.controllers))),
            ("plants", str(len(study.variations))),
            ("seeds", ", ".join(str(s) for s in study.seeds)),
            *((("work", in_words(outcome.work)),) if outcome.work else ()),
            ("workbench", installed_version()),
        ),
    )


def _first(
    outcome: StudyResult, figures: Sequence[Figure]
) -> tuple[tuple[Block, ...], list[Section]]:
    """Return the first screen, scores and the first picture of a scenario, and the scenarios."""
    scenarios = [
        _scenario(outcome, name, i + 1, figures) for i, name in enumerate(outcome.study.scenarios)
    ]
    drawn = next((b for s in scenarios for b in s.blocks if isinstance(b, Picture)), None)
    # A picture stands on the page once.
    rest = [replace(s, blocks=tuple(b for b in s.blocks if b is not drawn)) for s in scenarios]
    if beside := versions(outcome):
        return (*([_scores(outcome)] if outcome.judgements else []), *beside), scenarios
    told = _scores(outcome) if outcome.judgements else _unjudged(outcome)
    return (told, *([drawn] if drawn is not None else [])), rest


def _own_figures(outcome: StudyResult) -> tuple[list[Figure], list[Section]]:
    """Return the figures that the study names, and a section for each that there is not."""
    found: list[Figure] = []
    failed: list[Section] = []
    for i, name in enumerate(outcome.study.report.figures):
        try:
            found += own_figures([name], folder=outcome.study.path.parent)
        except WorkbenchError as error:
            # The runs are done; a mistake in a module of figures must not cost them.
            note = Words(f"Not drawn: {error}.", "note")
            failed.append(Section(f"own-{i + 1}", f"Figure {name}", (note,)))
    return found, failed


def _where(j: Judgement | None) -> str:
    if j is None:
        return "–"
    return f"{metric_title(j.demand.requirement.metric)}, {j.scenario}, {j.variation}"


def _scores(outcome: StudyResult) -> Table:
    boxes = {r.controller: score_cell(r.worst_score, capped=True) for r in outcome.robustness}
    judged = {j.controller for j in outcome.judgements}
    if not boxes and not any(s.judgement for s in outcome.scores):
        return _softly(outcome)
    columns: dict[str, Callable[[Score], Cell | str]] = {
        "controller": lambda s: s.controller,
        "score": lambda s: score_cell(s.worst) if s.judgement else "–",
        "mean score": lambda s: f"{s.mean:.2f}" if s.controller in judged else "–",
        "worst requirement, scenario, plant": lambda s: _where(s.judgement),
    }
    note = (
        "Score: metric over limit. At most 1 means that every hard requirement is met on every "
        "plant, in every scenario, with every seed."
    )
    if boxes:
        columns["score at the worst plant of the box"] = lambda s: boxes.get(s.controller, "–")
        if outcome.study.box is not None and not outcome.study.box.hard:
            note += " The box of plants informs and does not fail this study."
    return Table.of("Scores", outcome.scores, columns, note)


def _softly(outcome: StudyResult) -> Table:
    """Return on how many plants and steps each controller holds limits of which none is hard."""
    missed: dict[str, dict[tuple[str, str], bool]] = {}
    for j in outcome.judgements:
        own = missed.setdefault(j.controller, {})
        own[j.variation, j.scenario] = own.get((j.variation, j.scenario), False) or j.score > 1.0
    columns: dict[str, Callable[[str], Cell | str]] = {
        "controller": lambda name: name,
        "limits held": lambda name: (
            f"{list(missed[name].values()).count(False)} of {len(missed[name])}"
        ),
    }
    note = "Plants and steps in which every limit is held. None is hard, so that there is no score."
    return Table.of("Limits", list(missed), columns, note)


def _unjudged(outcome: StudyResult) -> Table:
    """Return what a reader looks for first where nothing is required: the first metrics."""
    name, case = next(iter(outcome.study.scenarios)), next(iter(outcome.study.cases.values()))
    table = _nominal(outcome, name, case, _measured(outcome, name, case), columns("page")[:_FIRST])
    turned = tuple(zip(table.headings, *table.rows, strict=True))
    head = tuple(str(cell) for cell in turned[0])
    return Table("Metrics", head, turned[1:], "Nothing is required, so that there is no score.")


def _verdict(outcome: StudyResult) -> Section:
    """Say what is missed; nothing where all is met."""
    blocks: list[Block] = []
    if outcome.missed:
        blocks.append(_list("Hard requirements missed", outcome.missed))
    if outcome.missed_softly:
        blocks.append(_list("Soft requirements missed", outcome.missed_softly))
    if outcome.failed:
        blocks.append(
            Table(
                "Failed runs",
                ("controller", "scenario", "plant", "reason"),
                tuple((r.controller, r.scenario, r.variation, r.reason) for r in outcome.failed),
            )
        )
    return Section("verdict", "What is missed", tuple(blocks))


def _list(title: str, found: Sequence[Judgement]) -> Table:
    most = 30
    groups = missed_by_plant(found)
    return Table.of(
        title,
        groups[:most],
        {
            "controller": lambda g: g.worst.controller,
            "scenario": lambda g: g.worst.scenario,
            "metric": lambda g: metric_title(g.worst.demand.requirement.metric),
            "worst plant": lambda g: Cell(g.worst.variation, "", g.also),
            "how far": lambda g: Cell(g.worst.excess(), "missed" if g.worst.hard else ""),
        },
        f"The worst {most} of {len(groups)}." if len(groups) > most else "",
    )


def _baseline(outcome: StudyResult, folder: str) -> Section:
    assert outcome.baseline is not None
    blocks = _conditions(outcome)
    if not outcome.changes:
        text = "Nothing differs from the baseline by more than its tolerance."
        return Section("baseline", "Against the baseline", (Words(text), *blocks))
    order = {"worse": 0, "gone": 0, "better": 1}
    found = sorted(
        changes_by_plant(outcome.changes, outcome.required),
        key=lambda g: (not g.worst.fails, order.get(g.worst.way, 2)),
    )
    most = 40
    marks: dict[str, Mark] = {"better": "met"}
    table = Table.of(
        "Differences beyond their tolerance",
        found[:most],
        {
            "controller": lambda g: g.worst.key[0],
            "scenario": lambda g: g.worst.key[2],
            "metric": lambda g: metric_title(g.worst.metric) or "run",
            "plant that changed most": lambda g: Cell(g.worst.key[1], "", g.also),
            "baseline → now": lambda g: (
                g.worst.numbers().replace("->", "→") if g.worst.metric else g.worst.reason
            ),
            "way": lambda g: Cell(
                g.worst.way, "missed" if g.worst.fails else marks.get(g.worst.way, "")
            ),
        },
        f"The first {most} of {len(found)}; results.json has all." if len(found) > most else "",
    )
    accept = ["workbench", "bless", folder, "--baseline", str(outcome.baseline.path)]
    command = Commands((shlex.join(accept),))
    words = Words("If the changes are intended, this command shows and accepts them.")
    return Section("baseline", "Against the baseline", (table, *blocks, words, command))


def _conditions(outcome: StudyResult) -> list[Block]:
    if not outcome.condition_changes:
        return []
    found = sorted(outcome.condition_changes, key=lambda c: not c.fails)
    rows = tuple(
        (breakable(c.name), Cell(breakable(c.text), "missed" if c.fails else "")) for c in found
    )
    return [Table("Conditions that differ from the baseline's", ("condition", "how"), rows)]


def _scenario(outcome: StudyResult, name: str, index: int, figures: Sequence[Figure]) -> Section:
    study = outcome.study
    blocks: list[Block] = []
    for i, case in enumerate(study.cases.values()):
        records = {c: outcome.record(c, name, case.name) for c in case.controllers}
        measured = _measured(outcome, name, case)
        suffix = f"{index}-{i + 1}" if case.name else str(index)
        for figure in figures:
            blocks += figure.blocks(outcome, name, case.name, suffix)
        if measured:
            blocks.append(_nominal(outcome, name, case, measured))
        if any(e.events for e in records.values() if e is not None):
            blocks.append(_events(name, case, [r for r in records.values() if r is not None]))
        if len([v for v in study.variations.values() if v.case == case.name]) > 1:
            blocks.append(_variations(outcome, name, case))
    return Section(f"scenario-{index}", f"Scenario {name}", tuple(blocks))


def _measured(outcome: StudyResult, name: str, case: Case) -> dict[tuple[str, ...], Metrics]:
    """Return the metrics of each controller in a scenario on the nominal plant."""
    records = {c: outcome.record(c, name, case.name) for c in case.controllers}
    return {(c,): r.metrics for c, r in records.items() if r is not None and r.metrics is not None}


def _nominal(
    outcome: StudyResult,
    name: str,
    case: Case,
    measured: dict[tuple[str, ...], Metrics],
    wanted: Sequence[str] = (),
) -> Table:
    study, nominal = outcome.study, outcome.study.nominal(case.name)

    def told(metric: str) -> bool:
        return any(metric in m and not math.isnan(m[metric].value) for m in measured.values())

    hard = [
        d.requirement
        for d in study.demands
        if d.requirement.hard
        and not d.controllers
        and d.applies(next(iter(case.controllers)), nominal, name)
        and told(d.requirement.metric)
    ]
    asked = wanted or (*columns("page"), *(m.name for m in study.metrics))
    shown = [c for c in labels_of(asked, (c for m in measured.values() for c in m)) if told(c)]
    title = f"{name}, {case.name}" if case.name else f"{name} on the nominal plant"
    return metrics_table(title, ("controller",), measured, shown, hard)


def _events(name: str, case: Case, records: Sequence[Record]) -> Table:
    """Return what changes and disturbances did, on the nominal plant."""
    output = next(e.output for r in records for e in r.events)
    outputs = {q.name: q.display_unit for q in case.plant.build().outputs}
    unit = of_difference(outputs[output])
    heads = [
        f"{e.what.replace('_', ' ')} at {e.time:g} s"
        for e in next(r.events for r in records if r.events)
    ]

    def shown(error: float) -> str:
        return with_unit(number(float(from_si(error, unit))), unit)

    rows = tuple(
        (r.controller, *(f"{shown(e.peak)} / {shown(e.left)}" for e in r.events))
        for r in records
        if r.events
    )
    where = f"{name}, {case.name}" if case.name else name
    title = f"{where}: largest error after each change, and what is left at its end"
    return Table(title, ("controller", *heads), rows)


def _variations(outcome: StudyResult, scenario: str, case: Case) -> Table:
    def cell(controller: str, variation: Variation) -> Cell:
        key = controller, variation.name, scenario
        own = [j for j in outcome.judgements if (j.controller, j.variation, j.scenario) == key]
        worst = max([j for j in own if j.hard] or own, key=lambda j: j.score, default=None)
        if worst is None:
            return Cell("–")
        metric = metric_title(worst.demand.requirement.metric)
        return Cell(score_text(worst.score), "met" if worst.met else "missed", metric)

    variations = outcome.study.variations.values()
    return Table.of(
        "Score on every plant, and the requirement that decides it",
        [v for v in variations if v.case == case.name and v.judged],
        {"plant": lambda v: v.name, **{c: partial(cell, c) for c in case.controllers}},
    )


def _requirements(outcome: StudyResult) -> Section:
    study = outcome.study
    columns: dict[str, Callable[[Demand], Cell | str]] = {
        "requirement": lambda d: demand_text(d) + ("" if d.requirement.hard else " (soft)"),
        "scenario": lambda d: d.requirement.scenario or "all",
        **{c: partial(_worst_cell, outcome, c) for c in study.controllers},
    }
    title = "Worst value over scenarios, plants and seeds, and where"
    table = Table.of(title, study.demands, columns)
    return Section("requirements", "Every requirement at its worst", (table,))


def _worst_cell(outcome: StudyResult, controller: str, demand: Demand) -> Cell:
    own = [j for j in outcome.judgements if j.demand is demand and j.controller == controller]
    if not own:
        return Cell("–")
    worst = max(own, key=lambda j: j.score)
    text = with_unit(number(worst.value), demand.requirement.unit) if worst.value else "0"
    mark: Mark = "met" if worst.met else "missed" if demand.requirement.hard else ""
    place = (
        worst.variation if demand.requirement.scenario else f"{worst.scenario}, {worst.variation}"
    )
    return Cell(text, mark, place if worst.value else "")


def _how(outcome: StudyResult, figures: Sequence[Figure], command: str) -> Section:
    study = outcome.study
    plants = Table.of(
        "Plants",
        study.variations.values(),
        {
            "plant": lambda v: v.name,
            "differs from the nominal one by": partial(_difference, outcome),
        },
    )

    def entry(key: str, value: object) -> str:
        return f"{breakable(key)} = {f'{value:g}' if isinstance(value, float) else value}"

    designs = Table.of(
        "Controllers",
        study.controllers.values(),
        {
            "controller": lambda c: c.name,
            "design": lambda c: breakable(c.design),
            "designed at": lambda c: point_text(study, c.at),
            "specification": lambda c: ", ".join(starmap(entry, c.specification)) or "as it comes",
        },
    )
    runs = [r.metrics for r in outcome.records if r.metrics is not None]
    own = [entry for figure in figures for entry in figure.methods]
    done = Method((*metric_methods(runs), *methods("study"), *own))
    typed = [Commands((command,))] if command else []
    said = [Words(text) for text in study.report.said]
    return Section("how", "How it was done", (plants, designs, *said, done, *typed), folded=True)


def _difference(outcome: StudyResult, variation: Variation) -> str:
    plant, nominal = variation.plant, outcome.study.nominal(variation.case).plant
    if variation.nominal:
        return "–"
    units = {q.name: q.unit for q in plant.build().parameters}
    said = [f"effect {e}" for e in plant.effects if e not in nominal.effects]
    gone = [e for e in nominal.effects if e not in plant.effects]
    said += [f"without {e}" for e in (*gone, *plant.without) if e not in nominal.without]
    before = dict(nominal.parameters)
    for key, value in plant.parameters:
        if before.get(key) != value:
            said.append(f"{key} {parameter_text(value, units[key])}")
    said += [f"{key} x {factor:g}" for key, factor in plant.scaled]
    if plant.noise != nominal.noise:
        said.append(f"noise x {plant.noise / nominal.noise:g}")
    said += [f"{d.level:g} on {d.port}" for d in variation.disturbances]
    if variation.ideal:
        said.append("ideal sensors and converters")
    if variation.late_samples:
        said.append(f"every command {variation.late_samples} samples late")
    if variation.plan_duration != 1.0:
        said.append(f"plan x {variation.plan_duration:g}")
    if variation.lead:
        said.append(f"lead {in_time(variation.lead)}")
    return breakable(", ".join(said))


def write_study_files(
    outcome: StudyResult, folder: str | Path, *, command: str = ""
) -> tuple[Path, ...]:
    """Write what a study found."""
    place = Path(folder)
    texts = {
        "results.json": json_text(outcome.table()),
        "summary.md": summary(outcome),
        "junit.xml": junit(outcome),
        "report.html": html(study_page(outcome, command=command, folder=str(place))),
    }
    # All are made before the first is written: a mistake in one leaves the earlier results.
    return tuple(write_whole(place / name, text) for name, text in texts.items())


def linear_page(study: Study, loops: tuple[LoopAnalysis, ...], *, command: str = "") -> Page:
    """Build the page of the linear analysis alone."""
    worst = min((a.disk_margin for a in loops if a.stable), default=float("nan"))
    lead = (
        f"{len(study.controllers)} controllers at {len(study.points)} operating points; the "
        f"smallest disk margin is {worst:.2g}. No run was made."
    )
    again = [Commands((command,))] if command else []
    blocks = (*linear_blocks(study, loops), Method(LINEAR.methods), *again)
    section = Section(LINEAR.name, LINEAR.title, blocks)
    facts = (("workbench", installed_version()),)
    return Page(f"Linear analysis of study {study.name}", lead, (section,), facts=facts)
