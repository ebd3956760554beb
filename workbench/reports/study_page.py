"""The page of a study, what is met, how the controllers differ, and why; and its other files."""

from __future__ import annotations

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
from workbench.model.units import in_time, with_unit
from workbench.reports.figure import Figure, figures_of, own_figures, sections
from workbench.reports.figures.design_versions import versions
from workbench.reports.figures.linear_analysis import LINEAR, linear_blocks
from workbench.reports.figures.study_traces import breakable, point_text
from workbench.reports.metrics_table import demand_text, metric_methods
from workbench.reports.page import Block, Commands, Method, Page, Section, Words, html, methods
from workbench.reports.pictures import Picture
from workbench.reports.study_tables import (
    change_tables,
    condition_tables,
    failed_tables,
    missed_tables,
    nominal_tables,
    scenario_tables,
    scores_table,
)
from workbench.reports.summary import summary
from workbench.reports.tables import Cell, Mark, Table, number
from workbench.study.ci_files import junit
from workbench.study.margins import LoopAnalysis
from workbench.study.result import StudyResult, installed_version
from workbench.study.study import Demand, Study, Variation
from workbench.study.summary import parameter_text
from workbench.verification.metrics import columns

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
    missed = [table for hard in (True, False) for table in missed_tables(outcome, hard=hard)]
    parts = [
        Section("verdict", "What is missed", (*missed, *failed_tables(outcome))),
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
    scores = [scores_table(outcome)] if outcome.judgements else []
    if beside := versions(outcome):
        return (*scores, *beside), scenarios
    told = scores or _unjudged(outcome)
    return (*told, *([drawn] if drawn is not None else [])), rest


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


def _unjudged(outcome: StudyResult) -> list[Table]:
    """Return what a reader looks for first where nothing is required: the first metrics."""
    name, case = next(iter(outcome.study.scenarios)), next(iter(outcome.study.cases.values()))
    found = nominal_tables(outcome, name, case, columns("page")[:_FIRST])
    note = "Nothing is required, so that there is no score."
    turned = [tuple(zip(table.headings, *table.rows, strict=True)) for table in found]
    return [Table("Metrics", tuple(map(str, head)), tuple(rows), note) for head, *rows in turned]


def _baseline(outcome: StudyResult, folder: str) -> Section:
    assert outcome.baseline is not None
    blocks: list[Block] = [*change_tables(outcome), *condition_tables(outcome)]
    if not outcome.changes:
        text = "Nothing differs from the baseline by more than its tolerance."
        blocks.insert(0, Words(text))
    else:
        accept = ["workbench", "bless", folder, "--baseline", str(outcome.baseline.path)]
        blocks.append(Words("If the changes are intended, this command shows and accepts them."))
        blocks.append(Commands((shlex.join(accept),)))
    return Section("baseline", "Against the baseline", tuple(blocks))


def _scenario(outcome: StudyResult, name: str, index: int, figures: Sequence[Figure]) -> Section:
    blocks: list[Block] = []
    for i, case in enumerate(outcome.study.cases.values()):
        suffix = f"{index}-{i + 1}" if case.name else str(index)
        for figure in figures:
            blocks += figure.blocks(outcome, name, case.name, suffix)
        blocks += scenario_tables(outcome, name, case)
    return Section(f"scenario-{index}", f"Scenario {name}", tuple(blocks))


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
