"""The outcome of a study as Markdown that reads well in a pull request."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

from workbench.computing.counted import in_words
from workbench.display import aligned_table
from workbench.errors import WorkbenchError
from workbench.model.units import from_si, in_time, shown_unit, with_unit
from workbench.study.baseline import IN_BOX, Change
from workbench.study.grouped import Group, changes_by_plant, missed_by_plant
from workbench.study.judgements import RUN_FAILED, Judgement, Score, judge_records
from workbench.study.physical_limit import Distance
from workbench.study.result import StudyResult
from workbench.study.robustness import Robustness
from workbench.study.tasks import Record
from workbench.verification import MetricValue
from workbench.verification.metrics import columns, labels_of

MOST = 20
"""Entries of a list that are written out; a pull request is read, not searched."""

NO_BOX = (
    "The baseline keeps no results of the parameter box, so fewer plants that meet a requirement "
    "are not seen; `workbench bless` writes them."
)

LONGEST = 60_000
"""Characters of a comment: GitHub takes 65,536."""


def summary(outcome: StudyResult) -> str:
    """Write the outcome as Markdown."""
    study = outcome.study
    mark = ("✅ " if outcome.judged else "") if outcome.passed else "❌ "
    headline = escaped(f"{study.name} {outcome.verdict()}: {outcome.headline()}")
    lines = [f"## {mark}{headline}", ""]
    lines += _scores(outcome)
    hard = missed_by_plant(without_failed(outcome.missed))
    lines += _list("Missed", len(outcome.missed), [f"{_judged(g)}{_also(g)}" for g in hard])
    title = "Missed in the box" if outcome.fragile else "Missed in the box, which only informs"
    missed = [f"{_BOLD}{r.controller}{_BOLD}: {r.why()}" for r in outcome.box_missed]
    lines += _list(title, len(missed), missed)
    lines += _list("Failed runs", len(outcome.failed), failures(outcome))
    weaker = [f"{_BOLD}{c}{_BOLD}" for c in outcome.weakened]
    lines += _list("Changed conditions, which must be accepted", len(weaker), weaker)
    if outcome.baseline is not None and outcome.robustness and not outcome.baseline.box:
        lines += [NO_BOX, ""]
    if outcome.baseline is not None:
        rest = [c for c in outcome.changes if not c.fails and c.way != "better"]
        for title, found in (
            ("Worse than the baseline", outcome.worse),
            ("Better than the baseline", outcome.better),
            ("Other changes, which do not count", rest),
        ):
            lines += _changed(outcome, title, found, fold=not title.startswith("Worse"))
    stricter = [str(c) for c in outcome.condition_changes if not c.fails]
    lines += _list("Stricter conditions", len(stricter), stricter, fold=True)
    soft = missed_by_plant(without_failed(outcome.missed_softly))
    entries = [f"{g.worst}{_also(g)}" for g in soft]
    lines += _list("Soft requirements missed", len(outcome.missed_softly), entries, fold=True)
    for case in study.cases:
        for scenario in study.scenarios:
            lines += _metrics(outcome, scenario, case)
    lines += _limits(outcome)
    lines += _robustness(outcome)
    if outcome.baseline is not None and (outcome.changes or outcome.condition_changes):
        lines += [
            "Intended? `workbench bless DIR --baseline FILE` shows these changes and accepts them.",
            "",
        ]
    text = "\n".join(lines).rstrip()
    if len(text) > LONGEST:
        text = text[:LONGEST].rpartition("\n")[0]
        # A cut inside a folded list would swallow what follows.
        folded = text.count("<details>") > text.count("</details>")
        text += ("\n\n</details>" if folded else "") + "\n\nThe rest stands in `report.html`."
    return f"{text}\n\n{mark_of(study.name)}\n"


def mark_of(study: str) -> str:
    """Return the invisible mark by which the comment of a study is found again."""
    return f"<!-- workbench study {re.sub(r'[^A-Za-z0-9]+', '-', study).strip('-')} -->"


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
        lines.append(f"{s.controller:<20} score {_score(s):>8}  {state}{tail}")
    for r in outcome.robustness:
        state = f"MISSED  ({r.why()})" if r.missed else "met"
        score = score_text(r.worst_score, capped=True)
        lines.append(f"{r.controller:<20} box   {score:>8}  {state}")
    for distance in outcome.distances.worst:
        if distance.worst is not None:
            text = f"{distance.controller:<20} {limit_text(distance)}"
            where = f", {distance.case}" if distance.case else ""
            lines.append(f"{text} settling / physical limit, {distance.scenario}{where}")
    for title, entries in (
        (
            "missed",
            [f"{g.worst}{_also(g)}" for g in missed_by_plant(without_failed(outcome.missed))],
        ),
        ("failed", [entry.replace(_BOLD, "") for entry in failures(outcome)]),
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
    output's scale.
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
        labels = labels_of(columns("summary"), (n for _, m in done for n in m))
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


_BOLD = "\ue000"
"""Where bold text begins and ends: a private character, so that names may hold asterisks."""


def escaped(text: str) -> str:
    r"""Return text in which nothing is Markdown, HTML, a mention or a reference to an issue.

    Example:
        >>> print(escaped("*a* | <b> @team #7 settling_time"))
        \*a\* \| &lt;b> &#64;team &#35;7 settling_time
    """
    text = re.sub(r"([\\`*\[\]|~]|(?<!\w)_|_(?!\w))", r"\\\1", " ".join(text.split()))
    for sign, entity in ((r"#(?=\d)", "&#35;"), ("<", "&lt;"), ("@", "&#64;")):
        text = re.sub(sign, entity, text)
    return text.replace(_BOLD, "**")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    body = ["| " + " | ".join(escaped(c) for c in row) + " |" for row in (head, *rows)]
    rule = "|" + "|".join(" --- " if i == 0 else " ---: " for i in range(len(head))) + "|"
    return [body[0], rule, *body[1:], ""]


def _scores(outcome: StudyResult) -> list[str]:
    if not any(s.judgement for s in outcome.scores) and not outcome.robustness:
        return []
    rows = []
    before = _before(outcome)
    for s in outcome.scores:
        j = s.judgement
        where = f"{j.demand.requirement.metric}, {j.scenario}, {j.variation}" if j else "–"
        box = next((r for r in outcome.robustness if r.controller == s.controller), None)
        # Scores of the box are kept as they were judged.
        known = outcome.baseline is not None and not outcome.condition_changes
        kept = outcome.baseline.box if known and outcome.baseline is not None else ()
        old = next((r["worst_score"] for r in kept if r["controller"] == s.controller), None)
        name = f"{_mark(outcome, s, box)} {s.controller}".lstrip()
        moved = [
            _score_moved(
                _worst(outcome, judged, s.controller, nominal=nominal) for judged in before
            )
            for nominal in (True, False)
        ]
        in_box = _score_moved((old, box.worst_score), capped=True) if box else "–"
        rows.append([name, *moved, where, in_box])
    head = [
        "controller",
        "score, nominal plant",
        "worst score",
        "at requirement, scenario, variation",
        "worst score in the box",
    ]
    note = (
        "Score: metric over limit, the worst of all hard requirements; at most 1 means met."
        " An arrow leads from the baseline to now, both judged by the requirements of now."
    )
    return [*_table(head, rows), note, ""]


def _before(outcome: StudyResult) -> tuple[Sequence[Judgement] | None, Sequence[Judgement]]:
    """Return the judgements of the baseline's runs by today's requirements, and those of today."""
    study = outcome.study
    # Single steps are not kept in a baseline.
    if outcome.baseline is None or any(d.step is not None for d in study.demands):
        return None, outcome.judgements
    known = {r.key for r in outcome.records}
    kept = [r for key, r in outcome.baseline.records.items() if key in known]
    try:
        return judge_records(study, kept), outcome.judgements
    except WorkbenchError:
        return None, outcome.judgements  # a metric or a unit that the baseline does not have


def _worst(
    outcome: StudyResult, judged: Sequence[Judgement] | None, controller: str, *, nominal: bool
) -> float | None:
    plain = {v.name for v in outcome.study.variations.values() if v.nominal}
    scores = [
        j.score
        for j in judged or ()
        if j.hard and j.controller == controller and (not nominal or j.variation in plain)
    ]
    return max(scores, default=None)


def _score_moved(scores: Iterable[float | None], *, capped: bool = False) -> str:
    old, new = ("" if s is None else score_text(s, capped=capped) for s in scores)
    return f"{old} → {new}" if old and old != new else new or "–"


def _mark(outcome: StudyResult, score: Score, box: Robustness | None) -> str:
    if score.judgement is None and box is None:
        return ""
    if not score.met or (box is not None and box in outcome.fragile):
        return "❌"
    return "⚠️" if box is not None and box.missed else "✅"


def _score(score: Score) -> str:
    return score_text(score.worst) if score.judgement else "–"


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


def _judged(group: Group[Judgement]) -> str:
    j = group.worst
    return f"{_BOLD}{j.controller}{_BOLD}{str(j)[len(j.controller) :]}"


def without_failed(judgements: Iterable[Judgement]) -> list[Judgement]:
    """Return judgements of runs that did not fail: a failed one is told once, with its reason."""
    return [j for j in judgements if not j.reason.startswith(RUN_FAILED)]


def failures(outcome: StudyResult) -> list[str]:
    """Return a sentence for each reason why runs failed, with how many of which controller."""
    found: dict[tuple[str, str], list[Record]] = {}
    for record in outcome.failed:
        found.setdefault((record.controller, record.reason), []).append(record)
    said = []
    for (controller, reason), rows in found.items():
        every = sum(r.controller == controller for r in outcome.records)
        first = rows[0]
        where = f"{first.scenario}, {first.variation}, seed {first.seed}"
        count = where if len(rows) == 1 else f"{len(rows)} of {every} runs"
        said.append(f"{_BOLD}{controller}{_BOLD}, {count}: {reason}")
    return said


def _changed(outcome: StudyResult, title: str, found: Sequence[Change], *, fold: bool) -> list[str]:
    """Return changes as a table: on the nominal plant and on the worst of all, before and after."""
    groups = changes_by_plant([c for c in found if not c.failed], outcome.required)
    rows: dict[tuple[str, ...], list[str]] = {}
    for group in groups:
        controller, variation, scenario, _ = group.worst.key
        metric = group.worst.metric
        name = f"{_BOLD}{controller}{_BOLD}, {scenario or variation}"
        if not metric:
            way = group.worst.way
            rows[name, way] = [f"{name}{_also(group)}", f"run is {way}", group.worst.reason, "–"]
        elif variation == IN_BOX:
            text = _moved(group.worst.before, group.worst.after, "%", share=False)
            rows[name, metric] = [name, metric, "–", text]
        else:
            cells = _nominal_and_worst(outcome, group.worst)
            rows.setdefault((name, metric), [name, metric.replace("_", " "), *cells])
    if not rows:
        return []
    shown = list(rows.values())
    head = ["controller, scenario", "metric", "nominal plant", "worst plant"]
    table = _table(head, shown[:MOST])
    if len(shown) > MOST:
        table += [f"and {len(shown) - MOST} more in `results.json`", ""]
    failed = sum(c.failed for c in found)
    heading = f"{title} ({len(found)}{f', {failed} of them failed runs' if failed else ''})"
    return _titled(heading, table, fold=fold)


def _titled(heading: str, lines: Sequence[str], *, fold: bool) -> list[str]:
    """Return lines under a heading, or folded under it; they end with an empty one."""
    if fold:
        return ["<details>", f"<summary>{heading}</summary>", "", *lines, "</details>", ""]
    return [f"### {heading}", "", *lines]


def _nominal_and_worst(outcome: StudyResult, change: Change) -> list[str]:
    """Return how a metric moved on the nominal plant, and on the plant where it is worst.

    Where no direction is worse, the plant counts on which it moved most.
    """
    assert outcome.baseline is not None
    (controller, _, scenario, _), metric = change.key, change.metric
    better = outcome.study.tolerance(metric).better
    highest = better != "more"
    nominal: list[MetricValue | None] = []
    worst: list[tuple[MetricValue, str] | None] = []
    for records in (list(outcome.baseline.records.values()), outcome.records):
        own = [
            (r.metrics[metric], r.variation)
            for r in records
            if (r.controller, r.scenario) == (controller, scenario)
            and r.metrics is not None
            and metric in r.metrics
        ]
        plain = {v.name for v in outcome.study.variations.values() if v.nominal}
        nominal.append(next((m for m, v in own if v in plain), None))
        # No value is worse than any.
        sizes = [e[0].value if highest else -e[0].value for e in own]
        sizes = [math.inf if math.isnan(size) else size for size in sizes]
        worst.append(own[sizes.index(max(sizes))] if own else None)
    if better == "neither":
        text = _moved(change.before, change.after, change.unit)
        return [_two(*nominal), f"{text}, {change.key[1]}"]
    at = worst[1][1] if worst[1] is not None else ""
    cells = [_two(*nominal), _two(*(w and w[0] for w in worst))]
    return [cells[0], f"{cells[1]}, {at}" if at else cells[1]]


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


def _list(title: str, count: int, entries: Sequence[str], *, fold: bool = False) -> list[str]:
    if not entries:
        return []
    items = [f"- {escaped(entry)}" for entry in entries[:MOST]]
    if len(entries) > MOST:
        items.append(f"- and {len(entries) - MOST} more in `results.json`")
    return _titled(f"{title} ({count})", [*items, ""], fold=fold)


def _metrics(outcome: StudyResult, scenario: str, case: str) -> list[str]:
    study = outcome.study
    records = {c: outcome.record(c, scenario, case) for c in study.cases[case].controllers}
    done = {c: r.metrics for c, r in records.items() if r is not None and r.metrics is not None}
    names = [
        n
        for n in labels_of(columns("summary"), (label for m in done.values() for label in m))
        if any(n in m and not math.isnan(m[n].value) for m in done.values())
    ]
    rows = []
    for controller in records:
        found = done.get(controller)
        cells = [
            _value(outcome, records[controller], found[name]) if found and name in found else ""
            for name in names
        ]
        own = [
            j
            for j in outcome.judgements
            if j.controller == controller
            and j.scenario == scenario
            and j.hard
            and study.variations[j.variation].case == case
        ]
        worst = max(own, key=lambda j: j.score, default=None)
        tail = f"{worst.variation} ({score_text(worst.score)})" if worst else "–"
        rows.append([controller, *cells, tail])
    head = ["controller", *(n.replace("_", " ") for n in names), "worst variation (score)"]
    nominal = study.nominal(case)
    where = nominal.case or f"{nominal.name} plant"
    return [f"### {escaped(f'{scenario}, {where}')}", "", *_table(head, rows)]


def _value(outcome: StudyResult, record: Record | None, metric: MetricValue) -> str:
    value, unit = metric.shown()
    if math.isnan(value):
        return "none"
    text = with_unit(f"{value:.3g}", unit)
    for change in outcome.changes:
        if record is not None and change.key == record.key and change.metric == metric.name:
            arrow = {"worse": "🔺", "better": "🔽"}.get(change.way, "")
            if math.isnan(change.before):
                return f"{text} {arrow} (none before)"
            return f"{text} {arrow} ({change.after - change.before:+.2g})".replace("  ", " ")
    return text


def _limits(outcome: StudyResult) -> list[str]:
    found = outcome.distances
    if not found.asked:
        return []
    shown = list(dict.fromkeys(d.scenario for d in found.worst if d.worst))
    rows = []
    for case in outcome.study.cases.values():
        for controller in case.controllers:
            cells = [limit_text(found.of(controller, scenario, case.name)) for scenario in shown]
            rows.append([f"{controller}, {case.name}".rstrip(", "), *cells])
    lines = ["### Distance to the physical limit: settling / limit of the worst step", ""]
    if shown:
        lines += _table(["controller", *shown], rows)
    rest = {d.scenario: d.ratio.reason for d in found.worst if d.scenario not in shown}
    lines += [f"- {escaped(f'No limit for {name}: {reason}')}." for name, reason in rest.items()]
    return [*lines, ""]


def limit_text(distance: Distance | None) -> str:
    """Write the distance to the physical limit in a scenario."""
    if distance is None or distance.worst is None or math.isnan(distance.ratio.value):
        return f"none ({distance.ratio.reason})" if distance is not None else "–"
    step = distance.worst
    return f"{distance.ratio.value:.2g} ({step.settling.value:#.3g} s / {step.limit.value:#.3g} s)"


def worst_plant(outcome: StudyResult, found: Robustness) -> str:
    """Write the parameters of the worst plant of a box, with their units."""
    units = {q.name: q.unit for q in outcome.study.plant.build().parameters}
    return ", ".join(f"{n} {parameter_text(v, units[n])}" for n, v in found.worst.items())


def _robustness(outcome: StudyResult) -> list[str]:
    if not outcome.robustness:
        return []
    rows = []
    for r in outcome.robustness:
        hard = [p for p in r.probabilities if p.hard]
        weakest = min(hard, key=lambda p: p.share, default=None)
        hurts = next(iter(r.effects.items()), ("", 0.0))
        least = "–"
        if weakest:
            share, low, high = (100 * v for v in (weakest.share, weakest.low, weakest.high))
            least = f"{weakest.requirement}: {share:.0f} % ({low:.0f} to {high:.0f} %)"
        most = f"{hurts[0]} ({hurts[1]:+.2f})" if hurts[1] else "–"
        score = score_text(r.worst_score, capped=True)
        rows.append([r.controller, score, worst_plant(outcome, r), least, most])
    draws = outcome.robustness[0].drawn
    head = [
        "controller",
        "worst score",
        "at",
        "least likely requirement (95 % interval)",
        "hurts most (change of score over its range)",
    ]
    title = f"### Robustness: {draws} plants drawn from the box, then the worst searched"
    return [title, "", *_table(head, rows)]
