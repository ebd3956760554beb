"""The outcome of a study as Markdown that reads well in a pull request."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from workbench.model.units import from_si
from workbench.study.baseline import Change
from workbench.study.grouped import Group, changes_by_plant, missed_by_plant
from workbench.study.judgements import Judgement
from workbench.study.limits import Distance
from workbench.study.result import StudyResult
from workbench.study.robustness import Robustness
from workbench.study.tasks import Record
from workbench.verification import MetricValue
from workbench.verification.metrics import columns

MOST = 20
"""Entries of a list that are written out; a pull request is read, not searched."""


OLD_BASELINE = (
    "The baseline keeps no requirements, scenarios and plants, so weaker ones are not seen; "
    "`workbench bless` writes them."
)


LONGEST = 60_000
"""Characters of a comment: GitHub takes 65,536."""


def summary(outcome: StudyResult) -> str:
    """Write the outcome as Markdown.

    Returns:
        A headline, what is missed or worse, one table of metrics per scenario with the change
        against the baseline, the distance to the physical limit where asked for, and the
        robustness.
    """
    study = outcome.study
    mark = "✅" if outcome.passed else "❌"
    headline = escaped(f"{study.name} {outcome.verdict()}: {outcome.headline()}")
    lines = [f"## {mark} {headline}", ""]
    lines += _scores(outcome)
    hard = [(_judged(g), g) for g in missed_by_plant(outcome.missed)]
    lines += _list("Missed", len(outcome.missed), [f"{text}{_also(g)}" for text, g in hard])
    title = "Missed in the box" if outcome.fragile else "Missed in the box, which only informs"
    missed = [f"{_BOLD}{r.controller}{_BOLD}: {r.why()}" for r in outcome.box_missed]
    lines += _list(title, len(missed), missed)
    lines += _list("Failed runs", len(outcome.failed), [_failed(r) for r in outcome.failed])
    weaker = [f"{_BOLD}{c}{_BOLD}" for c in outcome.weakened]
    lines += _list("Changed conditions, which must be accepted", len(weaker), weaker)
    if outcome.baseline is not None and outcome.baseline.conditions is None:
        lines += [OLD_BASELINE, ""]
    if outcome.baseline is not None:
        rest = [c for c in outcome.changes if not c.fails and c.way != "better"]
        for title, found in (
            ("Worse than the baseline", outcome.worse),
            ("Better than the baseline", outcome.better),
            ("Other changes, which do not count", rest),
        ):
            groups = changes_by_plant(found, outcome.required)
            entries = [f"{_bold(g.worst)}{_also(g)}" for g in groups]
            lines += _list(title, len(found), entries, fold=not title.startswith("Worse"))
    stricter = [str(c) for c in outcome.condition_changes if not c.fails]
    lines += _list("Stricter conditions", len(stricter), stricter, fold=True)
    soft = missed_by_plant(outcome.missed_softly)
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
    """Return the invisible mark by which the comment of a study is found again.

    Example:
        >>> mark_of("three arms")
        '<!-- workbench study three-arms -->'
    """
    return f"<!-- workbench study {re.sub(r'[^A-Za-z0-9]+', '-', study).strip('-')} -->"


def plain_summary(outcome: StudyResult) -> str:
    """Write the outcome as a few lines for a terminal.

    Returns:
        A score per controller, then what is missed, failed or worse.
    """
    lines = []
    for s in outcome.scores:
        state = "met" if s.met else "MISSED"
        tail = f"  ({s.judgement})" if s.judgement else ""
        lines.append(f"{s.controller:<20} score {score_text(s.worst):>8}  {state}{tail}")
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
        ("missed", [f"{g.worst}{_also(g)}" for g in missed_by_plant(outcome.missed)]),
        ("failed", [_failed(r).replace(_BOLD, "") for r in outcome.failed]),
        ("changed condition", [str(c) for c in outcome.weakened]),
        (
            "worse",
            [f"{g.worst}{_also(g)}" for g in changes_by_plant(outcome.worse, outcome.required)],
        ),
    ):
        lines += [f"{title}: {entry}" for entry in entries[:MOST]]
        if len(entries) > MOST:
            lines.append(f"{title}: and {len(entries) - MOST} more in results.json")
    word = outcome.verdict().replace("failed", "FAILED", 1)
    return "\n".join([*lines, f"{outcome.study.name} {word}: {outcome.headline()}"])


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
    rows = []
    for s in outcome.scores:
        j = s.judgement
        where = f"{j.demand.requirement.metric}, {j.scenario}, {j.variation}" if j else "–"
        box = next((r for r in outcome.robustness if r.controller == s.controller), None)
        rows.append(
            [
                f"{_mark(outcome, s.met, box)} {s.controller}",
                score_text(s.worst),
                f"{s.mean:.2f}",
                where,
                score_text(box.worst_score, capped=True) if box else "–",
            ]
        )
    head = [
        "controller",
        "score",
        "mean score",
        "worst requirement, scenario, variation",
        "score at the worst plant of the box",
    ]
    note = "Score: metric over limit, the worst of all hard requirements; at most 1 means met."
    return [*_table(head, rows), note, ""]


def _mark(outcome: StudyResult, met: bool, box: Robustness | None) -> str:
    if not met or (box is not None and box in outcome.fragile):
        return "❌"
    return "⚠️" if box is not None and box.missed else "✅"


def score_text(value: float, *, capped: bool = False) -> str:
    """Write a score.

    Args:
        value: The score, a ratio.
        capped: Whether 10 stands for 10 and above.

    Returns:
        Two digits behind the point, or words where there is no number.

    Example:
        >>> score_text(0.8123), score_text(float("inf")), score_text(10.0, capped=True)
        ('0.81', 'no value', '≥ 10')
    """
    if math.isinf(value) or math.isnan(value):
        return "no value"
    return "≥ 10" if capped and value >= 10.0 else f"{value:.2f}"


def parameter_text(value: float, unit: str) -> str:
    """Write the value of a parameter as people read it.

    Args:
        value: The value, in ``unit``.
        unit: Its SI unit.

    Example:
        >>> parameter_text(4.5e5, "Pa"), parameter_text(0.25, "1")
        ('4.5 bar', '0.25')
    """
    shown = "bar" if unit == "Pa" else unit
    number = float(from_si(value, shown))
    return f"{number:.3g}" if shown == "1" else f"{number:.3g} {shown}"


def _also(group: Group[Any]) -> str:
    return f" ({group.also})" if group.others else ""


def _judged(group: Group[Judgement]) -> str:
    j = group.worst
    return f"{_BOLD}{j.controller}{_BOLD}{str(j)[len(j.controller) :]}"


def _bold(change: Change) -> str:
    text = str(change)
    return f"{_BOLD}{change.key[0]}{_BOLD}{text[len(change.key[0]) :]}".replace("->", "→")


def _failed(r: Record) -> str:
    return f"{_BOLD}{r.controller}{_BOLD}, {r.scenario}, {r.variation}, seed {r.seed}: {r.reason}"


def _list(title: str, count: int, entries: Sequence[str], *, fold: bool = False) -> list[str]:
    if not entries:
        return []
    items = [f"- {escaped(entry)}" for entry in entries[:MOST]]
    if len(entries) > MOST:
        items.append(f"- and {len(entries) - MOST} more in `results.json`")
    heading = f"{title} ({count})"
    if fold:
        return ["<details>", f"<summary>{heading}</summary>", "", *items, "", "</details>", ""]
    return [f"### {heading}", "", *items, ""]


def _metrics(outcome: StudyResult, scenario: str, case: str) -> list[str]:
    study = outcome.study
    records = {c: outcome.record(c, scenario, case) for c in study.cases[case].controllers}
    done = {c: r.metrics for c, r in records.items() if r is not None and r.metrics is not None}
    names = [
        n
        for n in columns("summary")
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
    suffix = "" if unit == "1" else "°" if unit == "deg" else f" {unit}"
    if math.isnan(value):
        return "none"
    text = f"{value:.3g}{suffix}"
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
    """Write the distance to the physical limit in a scenario.

    Args:
        distance: The distance, or None.

    Returns:
        Ratio, settling time and limit, or why there is none.

    Example:
        >>> from workbench.verification.responses import Value
        >>> limit_text(Distance("pid", "sine", Value(math.nan, "the reference has no step")))
        'none (the reference has no step)'
    """
    if distance is None or distance.worst is None or math.isnan(distance.ratio.value):
        return f"none ({distance.ratio.reason})" if distance is not None else "–"
    step = distance.worst
    return f"{distance.ratio.value:.2g} ({step.settling.value:#.3g} s / {step.limit.value:#.3g} s)"


def _robustness(outcome: StudyResult) -> list[str]:
    if not outcome.robustness:
        return []
    units = {q.name: q.unit for q in outcome.study.plant.build().parameters}
    rows = []
    for r in outcome.robustness:
        hard = [p for p in r.probabilities if p.hard]
        weakest = min(hard, key=lambda p: p.share, default=None)
        plant = ", ".join(f"{n} {parameter_text(v, units[n])}" for n, v in r.worst.items())
        hurts = next(iter(r.effects.items()), ("", 0.0))
        rows.append(
            [
                r.controller,
                score_text(r.worst_score, capped=True),
                plant,
                f"{weakest.requirement}: {100 * weakest.share:.0f} %"
                f" ({100 * weakest.low:.0f} to {100 * weakest.high:.0f} %)"
                if weakest
                else "–",
                f"{hurts[0]} ({hurts[1]:+.2f})" if hurts[1] else "–",
            ]
        )
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
