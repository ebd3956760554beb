"""Sections of a study about what its controllers reach, their margins, and what limits them.

Evidence is what the study ran beside the plants that are judged: one limitation less at a time, and
planned moves that are made shorter and longer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from workbench.model import Output
from workbench.model.units import from_si, to_si, with_unit
from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import output_of, value_text, written
from workbench.reports.metrics_table import metric_title
from workbench.reports.page import Block, Words
from workbench.reports.tables import Cell, Mark, Table, number
from workbench.study.judgements import Judgement
from workbench.study.result import StudyResult
from workbench.study.study import NOMINAL, Case, Limitations, Variation
from workbench.study.tasks import Record
from workbench.verification import Metrics
from workbench.verification.metrics import worst
from workbench.verification.responses import Value

Step = tuple[float, float]
Rows = list[tuple[Cell | str, ...]]

NONE = Value(math.nan, "not run")


@dataclass(frozen=True)
class Evidence:
    """What a study found about the steps of one case.

    Args:
        want: How the evidence is read.
    """

    result: StudyResult
    want: Limitations
    case: Case

    @property
    def steps(self) -> tuple[Step, ...]:
        """Steps that are compared with the physical limit, in SI."""
        return self.result.study.report.limit_steps

    @cached_property
    def output(self) -> Output:
        """The controlled output that steps."""
        scenario = self.result.study.scenarios[self.want.scenario]
        return output_of(self.result.study, next(iter(scenario.references)))

    def shown(self, value: float) -> float:
        """Return an SI value of the output in its display unit."""
        return round(float(from_si(value, self.output.display_unit)), 6)

    def words(self, step: Step) -> str:
        """Write a step as people read it."""
        return " to ".join(value_text(v, self.output.display_unit) for v in step)

    def size(self, step: Step) -> str:
        """Write the size of a step as people read it."""
        return value_text(_size(step), self.output.display_unit)

    @property
    def variations(self) -> list[Variation]:
        """Variations of the case."""
        every = self.result.study.variations.values()
        return [v for v in every if v.case == self.case.name]

    @property
    def judged(self) -> list[str]:
        """Kinds of the variations that are judged."""
        return [v.kind for v in self.variations if v.judged]

    @property
    def controllers(self) -> list[str]:
        """Controllers that ran and are judged."""
        return [
            c
            for c in self.case.controllers
            if self.result.study.selection(c).judged and self.has(c, NOMINAL)
        ]

    def has(self, controller: str, kind: str) -> bool:
        """Tell whether a controller ran a variation."""
        return bool(self._records(controller, kind))

    def limit(self, step: Step, kind: str = NOMINAL) -> float:
        """Return the physical limit of a step, in s; NaN if there is none."""
        names = [v.name for v in self.variations if v.kind == kind]
        for name, move, limit in self.result.distances.limits:
            if name in names and (move.initial, move.final) == step:
                return limit.value
        return math.nan

    def settling(self, controller: str, kind: str, step: Step) -> Value:
        """Return the settling time of a step, in s, the worst seed."""
        return self._worst(controller, kind, step, "settling")

    def planned(self, controller: str, step: Step) -> float:
        """Return when the plan itself stays within the band of a step, in s."""
        return self._worst(controller, NOMINAL, step, "planned").value

    def metric(self, controller: str, kind: str, name: str) -> Value:
        """Return a metric of the steps, in its SI unit, the worst seed."""
        found = [
            Value(r.metrics[name].value, r.metrics[name].reason)
            for r in self._records(controller, kind)
            if r.metrics is not None and name in r.metrics
        ]
        return worst(found) if found else NONE

    def of_size(self, controller: str, kind: str, name: str, size: float) -> Value:
        """Return settling time (s) or overshoot (a fraction) of the steps of a size (SI), worst."""
        found = [v for r in self._records(controller, kind) for v in r.values_of_steps(name, size)]
        return worst(found) if found else NONE

    def ratio(self, controller: str, kind: str, step: Step) -> Value:
        """Return settling over the limit of the nominal plant, a ratio."""
        settling, limit = self.settling(controller, kind, step), self.limit(step)
        if math.isnan(limit):
            return Value(math.nan, "there is no physical limit")
        return Value(settling.value / limit, settling.reason)

    def worst_ratio(self, controller: str, step: Step) -> Value:
        """Return settling over the limit, the worst of the variations that are judged."""
        kinds = [k for k in self.judged if self.has(controller, k)]
        return worst([self.ratio(controller, k, step) for k in kinds] or [NONE])

    def _records(self, controller: str, kind: str) -> list[Record]:
        names = [v.name for v in self.variations if v.kind == kind]
        return [
            r
            for r in self.result.records
            if r.controller == controller
            and r.variation in names
            and r.scenario == self.want.scenario
        ]

    def _worst(self, controller: str, kind: str, step: Step, what: str) -> Value:
        found = []
        for record in self._records(controller, kind):
            for s in record.steps:
                if math.isclose(s.initial, step[0]) and math.isclose(s.final, step[1]):
                    value = getattr(s, what)
                    found.append(value if isinstance(value, Value) else Value(value))
        return worst(found) if found else NONE


def evidence(result: StudyResult) -> list[Evidence]:
    """Return the evidence of each case; none if the study has no section on limitations."""
    want = result.study.report.limitations
    if want is None:
        return []
    return [Evidence(result, want, case) for case in result.study.cases.values()]


def margins_table(result: StudyResult) -> Table | None:
    """Return the margins of designs that were searched: linear models, and late on the plant."""
    rows: Rows = []
    seen = set()
    late = {v.case: v.name for v in result.study.variations.values() if v.late_samples}
    for record in result.records:
        case = result.study.variations[record.variation].case
        key = (case, record.controller)
        if not record.margins or key in seen:
            continue
        seen.add(key)
        own = [
            r for r in result.records if r.controller == key[1] and r.variation == late.get(case)
        ]
        oscillation = _shown(own[0].metrics, "oscillation") if own and own[0].metrics else "–"
        over = _shown(own[0].metrics, "overshoot") if own and own[0].metrics else "–"
        rows.append(
            (case, key[1], *(number(v) for v in record.margins.values()), over, oscillation)
        )
    if not rows:
        return None
    head = ("speed rad/s", "Ms", "Mt", "late: Ms", "late: overshoot", "late: oscillation")
    note = (
        "The fastest design within the limits on Ms and Mt, the largest over the models on which"
        " they hold. Late: every command one sample late, as from a slow computer."
    )
    return Table("Margins", ("plant", "controller", *head), tuple(rows), note)


def _shown(metrics: Metrics, name: str) -> str:
    value, unit = metrics[name].shown()
    return with_unit(number(value), unit)


def _limitations(result: StudyResult) -> list[Block]:
    found = evidence(result)
    if not found:
        return []
    want = found[0].want
    blocks: list[Block] = [
        reached_table(result),
        steps_table(result, nominal=True),
        steps_table(result, nominal=False),
        missed_table(result),
        Words(f"{want.unknown.name}. {want.unknown.text}{_unknown_words(found)}"),
        *(t for t in (plan_table(result),) if t.rows),
        *(Words(text) for e in found for text in plan_words(e)),
        limits_table(result),
        *(t for t in (known_table(result),) if t.rows),
        Words(f"{want.neglected.name}. {want.neglected.text}"),
        *(t for t in (ladder_table(result),) if t.rows),
        *(Words(text) for e in found for text in ladder_words(e)),
        Words(f"{want.loop.name}. {want.loop.text}"),
        time_table(result),
        *(Words(text) for text in want.notes),
    ]
    return blocks


def limitation_tables(result: StudyResult) -> list[Table]:
    """Return the tables of both sections, for a terminal."""
    if not evidence(result):
        return []
    found = [
        reached_table(result),
        steps_table(result, nominal=True),
        steps_table(result, nominal=False),
        margins_table(result),
        plan_table(result),
        ladder_table(result),
        known_table(result),
        missed_table(result),
    ]
    return [table for table in found if table is not None and table.rows]


def _size(step: Step) -> float:
    return abs(step[1] - step[0])


def _mark(value: float, limit: float) -> Mark:
    if math.isnan(value):
        return "open"
    return "met" if value <= limit else "missed"


def reached_table(result: StudyResult) -> Table:
    """Return how many requirements every controller meets on all plants that are judged."""
    cases = evidence(result)
    rows: Rows = []
    for controller in result.study.controllers:
        if not result.study.selection(controller).judged:
            continue
        cells: list[Cell | str] = []
        for e in cases:
            own = [
                j
                for j in result.judgements
                if j.controller == controller
                and result.study.variations[j.variation].case == e.case.name
            ]
            if not own:
                cells.append(Cell("–", reason="not run"))
                continue
            met = [
                all(j.met for j in own if j.demand is demand)
                for demand in result.study.demands
                if any(j.demand is demand for j in own)
            ]
            ratios = [e.worst_ratio(controller, step).value for step in e.steps]
            limited = not math.isnan(e.limit(e.steps[0])) if e.steps else False
            met += [r <= e.want.ratio for r in ratios] if limited else []
            cells.append(Cell(f"{sum(met)} of {len(met)}", "met" if all(met) else "missed"))
        rows.append((controller, *cells))
    head = ("controller", *(e.case.name for e in cases))
    return Table("Requirements met in all variations", head, tuple(rows))


def steps_table(result: StudyResult, *, nominal: bool) -> Table:
    """Return settling, overshoot and rest of every controller, nominal or the worst variation."""
    rows: Rows = []
    cases = evidence(result)
    steps = cases[0].steps
    names = ("overshoot", "steady_error", "oscillation")
    for e in cases:
        for controller in e.controllers:
            kinds = [NOMINAL] if nominal else [k for k in e.judged if e.has(controller, k)]
            settling = [
                worst([e.of_size(controller, k, "settling_time", _size(s)) for k in kinds])
                for s in steps
            ]
            ratios = [worst([e.ratio(controller, k, s) for k in kinds]) for s in steps]
            rest = [worst([e.metric(controller, k, n) for k in kinds]).value for n in names]
            limits = [_limit_of(result, e, controller, n) for n in names]
            rows.append(
                (
                    e.case.name,
                    controller,
                    *(Cell(number(v.value), "", v.reason) for v in settling),
                    *(
                        Cell(number(r.value), _mark(r.value, e.want.ratio), r.reason)
                        for r in ratios
                    ),
                    *(
                        Cell(number(100 * v if n == "overshoot" else e.shown(v)), _mark(v, limit))
                        for n, v, limit in zip(names, rest, limits, strict=True)
                    ),
                )
            )
    sizes = [cases[0].size(s) for s in steps]
    unit = written(cases[0].output.display_unit)
    which = "nominal" if nominal else "worst of all variations"
    head = (
        "plant",
        "controller",
        *(f"settling {s} s" for s in sizes),
        *(f"{s} / limit" for s in sizes),
        "overshoot %",
        f"steady error {unit}",
        f"oscillation {unit}",
    )
    return Table(f"Steps, {which}", head, tuple(rows))


def _limit_of(result: StudyResult, e: Evidence, controller: str, metric: str) -> float:
    """Return the limit of a metric of the steps, in SI; infinite without one."""
    for j in result.judgements:
        required = j.demand.requirement
        if (
            required.metric == metric
            and j.controller == controller
            and j.scenario == e.want.scenario
            and j.demand.step is None
        ):
            return float(to_si(required.limit, required.unit))
    return math.inf


def missed_table(result: StudyResult) -> Table:
    """List every requirement that is missed, and every ratio to the limit, each with its cause."""
    rows: Rows = []
    for e in evidence(result):
        for controller in e.controllers:
            rows += _missed_requirements(result, e, controller)
            for step in e.steps:
                nominal, most = e.ratio(controller, NOMINAL, step), e.worst_ratio(controller, step)
                if math.isnan(e.limit(step)) or most.value <= e.want.ratio:
                    continue
                rows.append(
                    (
                        e.case.name,
                        controller,
                        f"settling {e.size(step)} / limit",
                        number(nominal.value),
                        number(most.value),
                        f"{e.want.ratio:g}",
                        cause_of_ratio(e, controller, step),
                    )
                )
    head = ("plant", "controller", "metric", "nominal", "worst", "limit", "what prevents it")
    note = (
        "Each cause is shown below, with its runs."
        if rows
        else "Every requirement is met in every variation."
    )
    return Table("Requirements that are missed", head, tuple(rows), note)


def _missed_requirements(result: StudyResult, e: Evidence, controller: str) -> Rows:
    rows: Rows = []
    cases = result.study.variations
    for demand in result.study.demands:
        own = {
            cases[j.variation].kind: j
            for j in result.judgements
            if j.demand is demand
            and j.controller == controller
            and cases[j.variation].case == e.case.name
        }
        if all(j.met for j in own.values()):
            continue
        most = max(own.values(), key=lambda j: j.score)
        required = demand.requirement
        step = "" if demand.step is None else f" {e.size((0.0, demand.step))}"
        rows.append(
            (
                e.case.name,
                controller,
                f"{metric_title(required.metric)}{step}, {most.scenario}",
                number(own[NOMINAL].value) if NOMINAL in own else "–",
                number(most.value),
                f"{required.limit:g} {written(required.unit)}".strip(),
                cause_of_miss(result, e, controller, own),
            )
        )
    return rows


def cause_of_miss(
    result: StudyResult, e: Evidence, controller: str, own: dict[str, Judgement]
) -> str:
    """Say what keeps a metric from its limit, with the numbers that show it.

    Args:
        own: How the requirement is met, by variation.
    """
    demand = next(iter(own.values())).demand
    most = max(own.values(), key=lambda j: j.score)
    better: dict[str, float] = {}
    for other in e.controllers:
        judged = [
            j
            for j in result.judgements
            if j.demand is demand
            and j.controller == other
            and result.study.variations[j.variation].case == e.case.name
        ]
        if other != controller and judged and all(j.met for j in judged):
            better[other] = max(j.value for j in judged)
    if better:
        best = min(better, key=lambda name: better[name])
        return (
            f"{e.want.design.name}: {best} reaches {number(better[best])} at worst; this one"
            f" {number(most.value)}."
        )
    bad = [kind for kind, j in own.items() if not j.met]
    said = [f"{number(own[NOMINAL].value)} nominal"] if NOMINAL in own else []
    listed = ", ".join(f"{number(own[k].value)} with {k}" for k in bad if k != NOMINAL)
    both = "; ".join(part for part in (*said, listed) if part)
    if bad == [e.want.unknown.variation]:
        return f"{e.want.unknown.name}: {both}."
    if NOMINAL in bad:
        name = demand.requirement.metric
        without = e.metric(controller, e.want.neglected.variation, name).value
        if demand.step is not None:
            without = e.of_size(controller, e.want.neglected.variation, name, demand.step).value
        limit = float(to_si(demand.requirement.limit, demand.requirement.unit))
        if without <= limit and demand.requirement.scenario == e.want.scenario:
            shown = from_si(without, demand.requirement.unit)
            return f"{e.want.neglected.name}: {both}; {number(shown)} without it."
    return f"{e.want.loop.name}: {both}."


def cause_of_ratio(e: Evidence, controller: str, step: Step) -> str:
    """Say what keeps a step from its required ratio to the limit, with the numbers that show it."""
    want, limit = e.want, e.limit(step)
    allowed = want.ratio * limit
    better = {
        other: e.worst_ratio(other, step).value for other in e.controllers if other != controller
    }
    better = {other: r for other, r in better.items() if r <= want.ratio}
    if better:
        best = min(better, key=lambda name: better[name])
        own = e.worst_ratio(controller, step).value
        return (
            f"{want.design.name}: {best} reaches {number(better[best])} at worst; this one"
            f" {number(own)}."
        )
    plan = e.planned(controller, step)
    if plan > allowed:
        return (
            f"{want.unknown.name}: the plan alone takes {number(plan)} s of {number(allowed)} s"
            " that are allowed."
        )
    nominal = e.settling(controller, NOMINAL, step).value
    without = e.settling(controller, want.neglected.variation, step).value
    if not nominal <= allowed:
        if without <= allowed:
            return (
                f"{want.neglected.name}: {number(nominal)} s of {number(allowed)} s,"
                f" {number(without)} s without it."
            )
        bare = "" if math.isnan(without) else f" ({number(without)} s without what is neglected)"
        planned = "" if math.isnan(plan) else f"the plan takes {number(plan)} s, "
        return (
            f"{want.loop.name}: {planned}the output {number(nominal)} s{bare} of"
            f" {number(allowed)} s that are allowed."
        )
    late = {
        kind: e.settling(controller, kind, step).value
        for kind in e.judged
        if e.has(controller, kind) and not e.settling(controller, kind, step).value <= allowed
    }
    words = ", ".join(f"{number(t)} s with {kind}" for kind, t in late.items())
    name = want.unknown.name if list(late) == [want.unknown.variation] else want.loop.name
    return f"{name}: {number(nominal)} s nominal of {number(allowed)} s; {words}."


def _unknown_words(found: Sequence[Evidence]) -> str:
    """Say what the unknown does to the limit itself, where it grows most."""
    grown: list[tuple[float, Evidence, Step]] = []
    for e in found:
        for step in e.steps:
            ratio = e.limit(step, e.want.unknown.variation) / e.limit(step)
            if not math.isnan(ratio):
                grown.append((ratio, e, step))
    if not grown:
        return ""
    ratio, e, step = max(grown, key=lambda row: row[0])
    light, heavy = e.limit(step), e.limit(step, e.want.unknown.variation)
    return (
        f" The limit itself grows with it, for {e.case.name} and {e.words(step)} from"
        f" {number(light)} s to {number(heavy)} s: a move in {number(2 * heavy)} s, twice the limit"
        f" with it, is {number(2 * ratio)} times that of the plant as known. What shorter plans"
        " cost is shown next, on the same plants."
    )


def _paces(e: Evidence) -> dict[float, list[Variation]]:
    """Return the variations with planned moves of each duration, the design's own among them."""
    paced = [v for v in e.variations if v.plan_duration != 1.0]
    bases = {_base(v) for v in paced}
    found: dict[float, list[Variation]] = {1.0: [v for v in e.variations if v.kind in bases]}
    for v in paced:
        found.setdefault(v.plan_duration, []).append(v)
    return dict(sorted(found.items())) if paced else {}


def _base(v: Variation) -> str:
    return v.kind.rpartition(", plan x ")[0] or NOMINAL


def _paced_by(e: Evidence, v: Variation) -> list[str]:
    return [c for c in (v.controllers or e.controllers) if c in e.case.controllers]


def plan_table(result: StudyResult) -> Table:
    """Return what planned moves cost that are made shorter and longer."""
    rows: Rows = []
    steps = result.study.report.limit_steps
    names = ""
    for e in evidence(result):
        paces = _paces(e)
        for pace, own in paces.items():
            first = next(v for v in own if _base(v) == NOMINAL)
            for controller in _paced_by(e, next(iter(paces.values()))[0]):
                if not e.has(controller, first.kind):
                    continue
                names = names or controller
                ratios = [e.ratio(controller, first.kind, s).value for s in steps]
                kinds = [v.kind for v in own if e.has(controller, v.kind)]
                overs = [
                    worst([e.of_size(controller, k, "overshoot", _size(s)) for k in kinds]).value
                    for s in steps
                ]
                oscillation = worst([e.metric(controller, k, "oscillation") for k in kinds]).value
                limit = _limit_of(result, e, controller, "oscillation")
                rows.append(
                    (
                        e.case.name,
                        f"× {pace:g}",
                        *(Cell(number(r), _mark(r, e.want.ratio)) for r in ratios),
                        *(Cell(number(100 * o), _mark(o, e.want.overshoot)) for o in overs),
                        Cell(number(e.shown(oscillation)), _mark(oscillation, limit)),
                    )
                )
    one = evidence(result)[0]
    sizes = [one.size(s) for s in steps]
    head = (
        "plant",
        "duration of the plan",
        *(f"as known: {s} / limit" for s in sizes),
        *(f"worst: overshoot {s}, %" for s in sizes),
        f"worst: oscillation {written(one.output.display_unit)}",
    )
    note = "The feedback is the same in all rows of a plant."
    return Table(f"{names} with its planned moves made shorter and longer", head, tuple(rows), note)


def plan_words(e: Evidence) -> list[str]:
    """Say what a faster plan costs, where the plan is longer than required."""
    paces = _paces(e)
    if not paces or not e.steps:
        return []
    controller = next(
        (c for c in _paced_by(e, next(iter(paces.values()))[0]) if e.has(c, NOMINAL)), ""
    )
    ratios, overs = {}, {}
    for pace, own in paces.items():
        first = next(v for v in own if _base(v) == NOMINAL)
        kinds = [v.kind for v in own if e.has(controller, v.kind)]
        if not kinds:
            return []
        ratios[pace] = max(e.ratio(controller, first.kind, s).value for s in e.steps)
        overs[pace] = worst([e.metric(controller, k, "overshoot") for k in kinds]).value
    if not ratios[1.0] > e.want.ratio:
        return []
    bearable = [pace for pace in ratios if overs[pace] <= e.want.overshoot]
    required = [pace for pace in ratios if ratios[pace] <= e.want.ratio]
    most = f"{100 * e.want.overshoot:g} %"
    text = f"{e.case.name}: " + (
        f"the shortest plan that stays within {most} with what it does not know is"
        f" × {bearable[0]:g}, with {number(ratios[bearable[0]])} times the limit as the largest of"
        " the steps"
        if bearable
        else f"no plan that was tried stays within {most}"
    )
    fastest = required[-1] if required else min(ratios)
    what = (
        f"{e.want.ratio:g} times the limit is reached with × {fastest:g}"
        if required
        else f"even × {fastest:g} does not reach {e.want.ratio:g} times the limit"
        f" ({number(ratios[fastest])} times)"
    )
    over = overs[fastest]
    ends = "does not settle" if math.isnan(over) else f"overshoots by {number(100 * over)} %"
    return [f"{text}; {what}, and there it {ends} with what it does not know."]


def limits_table(result: StudyResult) -> Table:
    """Return the physical limits of every plant."""
    rows: Rows = []
    steps = result.study.report.limit_steps
    for e in evidence(result):
        for kind in (NOMINAL, *result.study.report.limit_variations):
            values = [e.limit(step, kind) for step in steps]
            name = e.case.name if kind == NOMINAL else f"{e.case.name}, {kind}"
            rows.append((name, *(number(v) for v in values)))
    head = ("plant", *(f"{evidence(result)[0].words(s)}, s" for s in steps))
    note = (
        "Full command one way, then the other, known to the last parameter, without noise and"
        " without what the design models leave out."
    )
    title = "Physical limit: time-optimal moves of the full plant into the 2 % band"
    return Table(title, head, tuple(rows), note)


def known_table(result: StudyResult) -> Table:
    """Return what tolerance costs: designs that are not judged beside those that are."""
    rows: Rows = []
    steps = result.study.report.limit_steps
    for e in evidence(result):
        shown = [c for c in e.want.controllers if c in e.case.controllers]
        if not any(c not in e.controllers for c in shown):
            continue
        for controller in shown:
            for kind in (NOMINAL, e.want.unknown.variation):
                if not e.has(controller, kind):
                    continue
                over = e.metric(controller, kind, "overshoot").value
                oscillation = e.metric(controller, kind, "oscillation").value
                ratios = [e.ratio(controller, kind, s).value for s in steps]
                rows.append(
                    (
                        e.case.name,
                        controller,
                        "as known" if kind == NOMINAL else kind,
                        *(number(r) for r in ratios),
                        number(100 * over),
                        number(e.shown(oscillation)),
                    )
                )
    first = evidence(result)[0]
    sizes = [f"{first.size(s)} / limit" for s in steps]
    unit = written(first.output.display_unit)
    head = ("plant", "controller", "varied", *sizes, "overshoot %", f"oscillation {unit}")
    return Table("Speed against tolerance of what nobody announced", head, tuple(rows))


def ladder_table(result: StudyResult) -> Table:
    """Return settling with one limitation less at a time."""
    rows: Rows = []
    steps = result.study.report.limit_steps
    for e in evidence(result):
        for controller in e.want.controllers:
            for kind, what in ((NOMINAL, "everything"), *e.want.ladder):
                if controller not in e.case.controllers or not e.has(controller, kind):
                    continue
                cells = []
                for step in steps:
                    settled, ratio = (
                        e.settling(controller, kind, step),
                        e.ratio(controller, kind, step),
                    )
                    text = number(settled.value)
                    if math.isnan(ratio.value):
                        cells.append(Cell(text, reason=settled.reason))
                    else:
                        mark = _mark(ratio.value, e.want.ratio)
                        cells.append(Cell(f"{text} ({number(ratio.value)})", mark))
                rows.append((e.case.name, controller, what, *cells))
    head = ("plant", "controller", "the plant has", *(evidence(result)[0].words(s) for s in steps))
    note = (
        "Each row has what the row above has, less what it names. What is left in the last row is"
        " the smooth plan, the sample time and the margins of the loop."
    )
    title = "One limitation less at a time: settling in s, and over the limit"
    return Table(title, head, tuple(rows), note)


def ladder_words(e: Evidence) -> list[str]:
    """Say what every limitation costs, where the required ratio is missed."""
    found = []
    controller = next((c for c in e.want.controllers if c in e.case.controllers), "")
    kinds = (NOMINAL, *(kind for kind, _ in e.want.ladder))
    if not all(e.has(controller, kind) for kind in kinds):
        return []
    for step in e.steps:
        limit = e.limit(step)
        times = [e.settling(controller, kind, step).value for kind in kinds]
        if not times[0] > e.want.ratio * limit:
            continue
        parts = [
            f"{1e3 * (before - after):.0f} ms go with {what}"
            for (_, what), before, after in zip(e.want.ladder, times, times[1:], strict=False)
        ]
        plan = e.planned(controller, step)
        planned = "" if math.isnan(plan) else f" the plan takes {number(plan)} s and"
        found.append(
            f"{e.case.name}, {e.words(step)}: the limit is {number(limit)} s,{planned}"
            f" the output {number(times[0])} s. Of that {'; '.join(parts)}; the other"
            f" {1e3 * (times[-1] - limit):.0f} ms lie between the limit, which knows the plant"
            " exactly and commands fully, and a smooth move followed by a loop with margins."
        )
    return found


def time_table(result: StudyResult) -> Table:
    """Return where the time of a step goes, nominal runs."""
    rows: Rows = []
    steps = result.study.report.limit_steps
    for e in evidence(result):
        for controller in e.controllers:
            cells = [
                " / ".join(
                    number(v)
                    for v in (
                        e.limit(step),
                        e.planned(controller, step),
                        e.settling(controller, NOMINAL, step).value,
                    )
                )
                for step in steps
            ]
            rows.append((e.case.name, controller, *cells))
    head = ("plant", "controller", *(evidence(result)[0].words(s) for s in steps))
    title = "Time into the 2 % band: limit / planned move / output, in s"
    return Table(title, head, tuple(rows))


MARGINS = Figure("margins", margins_table, title="How close to the edge", order=4)
LIMITATIONS = Figure(
    "limitations", _limitations, title="What is not reached, and what prevents it", order=5
)
