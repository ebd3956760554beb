"""Tables of a study: what is met, what changed, and what every scenario gave.

The page of a study and its summary in Markdown show the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

from workbench.errors import WorkbenchError
from workbench.model.units import from_si, of_difference, with_unit
from workbench.reports.figures.study_traces import breakable
from workbench.reports.metrics_table import metric_title, metrics_table, score_cell
from workbench.reports.tables import Cell, Mark, Table, number
from workbench.study.baseline import IN_BOX, Change
from workbench.study.grouped import Group, changes_by_plant, missed_by_plant
from workbench.study.judgements import Judgement, Score, judge_records
from workbench.study.result import StudyResult
from workbench.study.study import Case, Variation
from workbench.study.summary import failures, score_text, without_failed
from workbench.study.tasks import Record
from workbench.verification import Metrics, MetricValue
from workbench.verification.metrics import columns, labels_of

MOST = 40
"""Changes of one kind, and missed requirements, that are written out."""


def scores_table(outcome: StudyResult) -> Table:
    """Return the scores of every controller, and from what to what they moved."""
    judged = {j.controller for j in outcome.judgements}
    if not outcome.robustness and not any(s.judgement for s in outcome.scores):
        return _softly(outcome)
    plain = {v.name for v in outcome.study.variations.values() if v.nominal}
    both = _before(outcome), outcome.judgements

    def score(s: Score, *, nominal: bool) -> Cell:
        moved = (
            [
                j.score
                for j in judgements
                if j.hard and j.controller == s.controller and (not nominal or j.variation in plain)
            ]
            for judgements in both
        )
        return _moved_score(*(max(scores, default=None) for scores in moved))

    table: dict[str, Callable[[Score], Cell | str]] = {
        "controller": lambda s: s.controller,
        "score, nominal plant": partial(score, nominal=True),
        "worst score": partial(score, nominal=False),
        "mean score": lambda s: f"{s.mean:.2f}" if s.controller in judged else "–",
        "worst requirement, scenario, plant": lambda s: _where(s.judgement),
    }
    note = (
        "Score: metric over limit. At most 1 means that every hard requirement is met on every"
        " plant, in every scenario, with every seed."
    )
    if outcome.baseline is not None:
        note += " An arrow leads from the baseline to now, both judged by the requirements of now."
    if outcome.robustness:
        now = {r.controller: r.worst_score for r in outcome.robustness}
        # Scores of the box are kept as they were judged.
        known = outcome.baseline if not outcome.condition_changes else None
        old = {r["controller"]: r["worst_score"] for r in known.box} if known else {}
        table["score at the worst plant of the box"] = lambda s: _moved_score(
            old.get(s.controller), now.get(s.controller), capped=True
        )
        if outcome.study.box is not None and not outcome.study.box.hard:
            note += " The box of plants informs and does not fail this study."
    return Table.of("Scores", outcome.scores, table, note)


def _before(outcome: StudyResult) -> Sequence[Judgement]:
    """Return the judgements of the baseline's runs by today's requirements."""
    # Single steps are not kept in a baseline.
    if outcome.baseline is None or any(d.step is not None for d in outcome.study.demands):
        return ()
    known = {r.key for r in outcome.records}
    kept = [r for key, r in outcome.baseline.records.items() if key in known]
    try:
        return judge_records(outcome.study, kept)
    except WorkbenchError:
        return ()  # a metric or a unit that the baseline does not have


def _moved_score(old: float | None, new: float | None, *, capped: bool = False) -> Cell:
    if new is None:
        return Cell("–")
    cell = score_cell(new, capped=capped)
    before = cell.text if old is None else score_text(old, capped=capped)
    return cell if before == cell.text else Cell(f"{before} → {cell.text}", cell.mark)


def _where(j: Judgement | None) -> str:
    if j is None:
        return "–"
    return f"{metric_title(j.demand.requirement.metric)}, {j.scenario}, {j.variation}"


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


def missed_tables(outcome: StudyResult, *, hard: bool) -> list[Table]:
    """Return a table of the requirements that are missed on runs that did not fail, if any is."""
    every = outcome.missed if hard else outcome.missed_softly
    groups = missed_by_plant(without_failed(every))
    columns: dict[str, Callable[[Group[Judgement]], Cell | str]] = {
        "controller": lambda g: g.worst.controller,
        "scenario": lambda g: g.worst.scenario,
        "metric": lambda g: metric_title(g.worst.demand.requirement.metric),
        "worst plant": lambda g: Cell(g.worst.variation, "", g.also),
        "how far": lambda g: Cell(g.worst.excess(), "missed" if hard else ""),
    }
    title = f"{'Hard' if hard else 'Soft'} requirements missed ({len(every)})"
    note = f"The worst {MOST} of {len(groups)}." if len(groups) > MOST else ""
    return [Table.of(title, groups[:MOST], columns, note)] if groups else []


def failed_tables(outcome: StudyResult) -> list[Table]:
    """Return a table of the reasons why runs failed, if any did."""
    head = ("controller", "runs", "reason")
    title = f"Failed runs ({len(outcome.failed)})"
    return [Table(title, head, failures(outcome))] if outcome.failed else []


def condition_tables(outcome: StudyResult) -> list[Table]:
    """Return tables of the conditions that must be accepted, and of stricter ones, if any are."""
    found = []
    titles = ("Changed conditions, which must be accepted", "Stricter conditions")
    for title, fails in zip(titles, (True, False), strict=True):
        own = [c for c in outcome.condition_changes if c.fails == fails]
        mark: Mark = "missed" if fails else ""
        rows = tuple((breakable(c.name), Cell(breakable(c.text), mark)) for c in own)
        found += [Table(f"{title} ({len(own)})", ("condition", "how"), rows)] if own else []
    return found


def change_tables(outcome: StudyResult) -> list[Table]:
    """Return tables of what is worse than the baseline, what is better, and of other changes."""
    rest = [c for c in outcome.changes if not c.fails and c.way != "better"]
    kinds: tuple[tuple[str, Sequence[Change], Mark], ...] = (
        ("Worse than the baseline", outcome.worse, "missed"),
        ("Better than the baseline", outcome.better, ""),
        ("Other changes, which do not count", rest, ""),
    )
    return [table for kind in kinds for table in _changed(outcome, *kind)]


def _changed(outcome: StudyResult, title: str, found: Sequence[Change], mark: Mark) -> list[Table]:
    """Return changes as a table: on the nominal plant and on the worst of all, before and after."""
    rows: dict[tuple[str, ...], tuple[Cell | str, ...]] = {}
    for group in changes_by_plant([c for c in found if not c.failed], outcome.required):
        change = group.worst
        controller, variation, scenario, _ = change.key
        where = (controller, scenario or variation)
        if not change.metric:
            told = Cell(f"run is {change.way}", mark), Cell(change.reason, "", group.also), "–"
            rows[*where, change.way] = (*where, *told)
        elif variation == IN_BOX:
            moved = _moved(change.before, change.after, "%", share=False)
            rows[*where, change.metric] = (*where, change.metric, "–", Cell(moved, mark))
        elif (*where, change.metric) not in rows:
            nominal, worst = _nominal_and_worst(outcome, change)
            metric = metric_title(change.metric)
            rows[*where, change.metric] = (*where, metric, nominal, Cell(worst, mark))
    if not rows:
        return []
    failed = sum(c.failed for c in found)
    title += f" ({len(found)}{f', {failed} of them failed runs' if failed else ''})"
    head = ("controller", "scenario", "metric", "nominal plant", "worst plant")
    note = f"The first {MOST} of {len(rows)}; results.json has all." if len(rows) > MOST else ""
    return [Table(title, head, tuple(rows.values())[:MOST], note)]


def _nominal_and_worst(outcome: StudyResult, change: Change) -> tuple[str, str]:
    """Return how a metric moved on the nominal plant, and on the plant where it is worst.

    Where no direction is worse, the plant counts on which it moved most.
    """
    assert outcome.baseline is not None
    (controller, _, scenario, _), metric = change.key, change.metric
    better = outcome.study.tolerance(metric).better
    plain = {v.name for v in outcome.study.variations.values() if v.nominal}
    nominal: list[MetricValue | None] = []
    worst: list[tuple[MetricValue, str] | None] = []

    def badness(measured: tuple[MetricValue, str]) -> float:
        value = measured[0].value
        # No value is worse than any.
        return math.inf if math.isnan(value) else -value if better == "more" else value

    for records in (list(outcome.baseline.records.values()), outcome.records):
        own = [
            (r.metrics[metric], r.variation)
            for r in records
            if (r.controller, r.scenario) == (controller, scenario)
            and r.metrics is not None
            and metric in r.metrics
        ]
        nominal.append(next((m for m, v in own if v in plain), None))
        worst.append(max(own, key=badness, default=None))
    if better == "neither":
        text = _moved(change.before, change.after, change.unit)
        return _two(*nominal), f"{text}, {change.key[1]}"
    at = worst[1][1] if worst[1] is not None else ""
    text = _two(*(w and w[0] for w in worst))
    return _two(*nominal), f"{text}, {at}" if at else text


def _two(before: MetricValue | None, after: MetricValue | None) -> str:
    shown = [m.shown() if m is not None else (math.nan, "1") for m in (before, after)]
    unit = shown[1][1] if after is not None else shown[0][1]
    return _moved(shown[0][0], shown[1][0], unit)


def _moved(before: float, after: float, unit: str, *, share: bool = True) -> str:
    old, new = ("none" if math.isnan(v) else f"{v:.4g}" for v in (before, after))
    if old == new:
        return with_unit(new, unit)
    tail = ""
    if share and before and math.isfinite(before) and math.isfinite(after):
        percent = 100 * (after / before - 1)
        tail = f" ({percent:+.0f} %)" if abs(percent) >= 10 else f" ({percent:+.2g} %)"
    return f"{old} → {new if new == 'none' else with_unit(new, unit)}{tail}"


def scenario_tables(
    outcome: StudyResult, name: str, case: Case, wanted: Sequence[str] = ()
) -> list[Table]:
    """Return what the controllers of a case reach in a scenario, nominal and on every plant.

    Args:
        wanted: Metrics that are shown; by default those of a page and the study's own.
    """
    records = [outcome.record(c, name, case.name) for c in case.controllers]
    eventful = [r for r in records if r is not None and r.events]
    several = len([v for v in outcome.study.variations.values() if v.case == case.name]) > 1
    return [
        *nominal_tables(outcome, name, case, wanted),
        *([_events(name, case, eventful)] if eventful else []),
        *([_variations(outcome, name, case)] if several else []),
    ]


def nominal_tables(
    outcome: StudyResult, name: str, case: Case, wanted: Sequence[str] = ()
) -> list[Table]:
    """Return the metrics of each controller in a scenario on the nominal plant, if any ran."""
    study, nominal = outcome.study, outcome.study.nominal(case.name)
    records = {c: outcome.record(c, name, case.name) for c in case.controllers}
    measured: dict[tuple[str, ...], Metrics] = {
        (c,): r.metrics for c, r in records.items() if r is not None and r.metrics is not None
    }
    if not measured:
        return []

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
    return [metrics_table(title, ("controller",), measured, shown, hard)]


def _events(name: str, case: Case, records: Sequence[Record]) -> Table:
    """Return what changes and disturbances did, on the nominal plant."""
    first = records[0].events
    output = first[0].output
    outputs = {q.name: q.display_unit for q in case.plant.build().outputs}
    unit = of_difference(outputs[output])
    heads = [f"{e.what.replace('_', ' ')} at {e.time:g} s" for e in first]

    def shown(error: float) -> str:
        return with_unit(number(float(from_si(error, unit))), unit)

    rows = tuple(
        (r.controller, *(f"{shown(e.peak)} / {shown(e.left)}" for e in r.events)) for r in records
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
        f"{scenario}: score on every plant, and the requirement that decides it",
        [v for v in variations if v.case == case.name and v.judged],
        {"plant": lambda v: v.name, **{c: partial(cell, c) for c in case.controllers}},
    )
