"""Sections of a study about what its controllers reach, their margins, and what limits them.

Evidence is what the study ran beside the plants that are judged: one limitation less at a time, and
planned moves that are made shorter and longer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

from workbench.model import Output
from workbench.model.units import from_si, of_difference, to_si, with_unit
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
from workbench.verification.each_step import StepResponse
from workbench.verification.metrics import worst
from workbench.verification.responses import Value

Step = tuple[float, float]
Row = tuple[Cell | str, ...]


@dataclass(frozen=True)
class Evidence:
    """What a study found about the steps of one case."""

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

    @property
    def unit(self) -> str:
        """Unit of its differences as written."""
        return written(of_difference(self.output.display_unit))

    def shown(self, value: float) -> float:
        """Return a difference of the output, in SI, as people read it."""
        return round(float(from_si(value, of_difference(self.output.display_unit))), 6)

    def words(self, step: Step) -> str:
        """Write a step as people read it."""
        return " to ".join(value_text(v, self.output.display_unit) for v in step)

    def size(self, step: Step) -> str:
        """Write the size of a step as people read it."""
        return value_text(_size(step), of_difference(self.output.display_unit))

    @property
    def ratios(self) -> list[str]:
        """What stands above the ratios of the steps to the physical limit."""
        return [f"{self.size(step)} / limit" for step in self.steps]

    @property
    def variations(self) -> list[Variation]:
        """Variations of the case."""
        every = self.result.study.variations.values()
        return [v for v in every if v.case == self.case.name]

    def judged(self, controller: str) -> list[str]:
        """Kinds of the variations that are judged and that a controller ran."""
        return [v.kind for v in self.variations if v.judged and self.has(controller, v.kind)]

    @property
    def controllers(self) -> list[str]:
        """Controllers that ran and are judged."""
        judged = self.result.study.selection
        return [c for c in self.case.controllers if judged(c).judged and self.has(c, NOMINAL)]

    def has(self, controller: str, kind: str) -> bool:
        """Tell whether a controller ran a variation."""
        return bool(self._records(controller, kind))

    def judgements(self, controller: str) -> list[Judgement]:
        """Return how the requirements judge a controller here."""
        known = self.result.study.variations
        return [
            j
            for j in self.result.judgements
            if j.controller == controller and known[j.variation].case == self.case.name
        ]

    def limit(self, step: Step, kind: str = NOMINAL) -> float:
        """Return the physical limit of a step, in s; NaN if there is none."""
        names = [v.name for v in self.variations if v.kind == kind]
        for name, move, limit in self.result.distances.limits:
            if name in names and all(map(_same, (move.initial, move.final), step)):
                return limit.value
        return math.nan

    def settling(self, controller: str, kind: str, step: Step) -> Value:
        """Return the settling time of a step, in s, the worst seed."""
        return _most(s.settling for s in self._steps(controller, kind, step))

    def planned(self, controller: str, step: Step) -> float:
        """Return when the plan itself stays within the band of a step, in s."""
        return _most(Value(s.planned) for s in self._steps(controller, NOMINAL, step)).value

    def metric(
        self, controller: str, kinds: Sequence[str], name: str, size: float | None = None
    ) -> Value:
        """Return a metric, in its SI unit, the worst of some variations and all seeds.

        Args:
            size: Size of the steps that count, in SI; all if None.
        """
        records = [r for kind in kinds for r in self._records(controller, kind)]
        if size is not None:
            return _most(v for r in records for v in r.values_of_steps(name, size))
        found = [r.metrics[name] for r in records if r.metrics is not None and name in r.metrics]
        return _most(Value(m.value, m.reason) for m in found)

    def ratio(self, controller: str, kinds: Sequence[str], step: Step) -> Value:
        """Return settling over the limit of the nominal plant, a ratio, the worst variation."""
        limit = self.limit(step)
        if math.isnan(limit):
            return Value(math.nan, "there is no physical limit")
        found = [self.settling(controller, kind, step) for kind in kinds]
        return _most(Value(v.value / limit, v.reason) for v in found)

    def _records(self, controller: str, kind: str) -> list[Record]:
        own = {(controller, v.name, self.want.scenario) for v in self.variations if v.kind == kind}
        return [r for r in self.result.records if r.key[:3] in own]

    def _steps(self, controller: str, kind: str, step: Step) -> list[StepResponse]:
        return [
            s
            for r in self._records(controller, kind)
            for s in r.steps
            if all(map(_same, (s.initial, s.final), step))
        ]


def _same(a: float, b: float) -> bool:
    """Tell whether two references are one: text such as ``"35 deg"`` has 12 digits."""
    return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-12)


def _most(values: Iterable[Value]) -> Value:
    found = list(values)
    return worst(found) if found else Value(math.nan, "not run")


def evidence(result: StudyResult) -> list[Evidence]:
    """Return the evidence of each case; none if the study has no section on limitations."""
    want = result.study.report.limitations
    if want is None:
        return []
    return [Evidence(result, want, case) for case in result.study.cases.values()]


def margins_table(result: StudyResult) -> Table | None:
    """Return the margins of designs that were searched: linear models, and late on the plant."""
    rows: dict[tuple[str, str], tuple[str, ...]] = {}
    late = {v.case: v.name for v in result.study.variations.values() if v.late_samples}
    for record in result.records:
        case = result.study.variations[record.variation].case
        key = (case, record.controller)
        if not record.margins or key in rows:
            continue
        own = (record.controller, late.get(case))
        found = next(
            (r.metrics for r in result.records if r.metrics and (r.controller, r.variation) == own),
            None,
        )
        beside = [_shown(found, n) if found else "–" for n in ("overshoot", "oscillation")]
        rows[key] = (*key, *map(number, record.margins.values()), *beside)
    if not rows:
        return None
    head = ("speed rad/s", "Ms", "Mt", "late: Ms", "late: overshoot", "late: oscillation")
    note = (
        "The fastest design within the limits on Ms and Mt, the largest over the models on which"
        " they hold. Late: every command one sample late, as from a slow computer."
    )
    return Table("Margins", ("plant", "controller", *head), tuple(rows.values()), note)


def _shown(metrics: Metrics, name: str) -> str:
    value, unit = metrics[name].shown()
    return with_unit(number(value), unit)


def _limitations(result: StudyResult) -> list[Block]:
    found = evidence(result)
    if not found:
        return []
    want = found[0].want
    # Without such runs there is nothing to tell of them.
    plan, known, ladder = (
        [table] if table.rows else []
        for table in (plan_table(result), known_table(result), ladder_table(result))
    )
    return [
        reached_table(result),
        steps_table(result, nominal=True),
        steps_table(result, nominal=False),
        missed_table(result),
        Words(f"{want.unknown.name}. {want.unknown.text}{_unknown_words(found)}"),
        *plan,
        limits_table(result),
        *known,
        Words(f"{want.neglected.name}. {want.neglected.text}"),
        *ladder,
        Words(f"{want.loop.name}. {want.loop.text}"),
        time_table(result),
        *(Words(text) for text in want.notes),
    ]


def limitation_tables(result: StudyResult) -> list[Table]:
    """Return the tables of both sections, for a terminal."""
    told = (
        reached_table,
        partial(steps_table, nominal=True),
        partial(steps_table, nominal=False),
        margins_table,
        plan_table,
        ladder_table,
        known_table,
        missed_table,
    )
    found = [table(result) for table in told] if evidence(result) else []
    return [table for table in found if table is not None and table.rows]


def _size(step: Step) -> float:
    return abs(step[1] - step[0])


def _cell(value: float, limit: float, text: str = "", reason: str = "") -> Cell:
    """Write a number with its mark: met up to a limit."""
    mark: Mark = "open" if math.isnan(value) else "met" if value <= limit else "missed"
    return Cell(text or number(value), mark, reason)


def reached_table(result: StudyResult) -> Table:
    """Return how many requirements and wished ratios every controller meets on all plants."""

    def met(e: Evidence, controller: str) -> Cell:
        by_demand: dict[int, bool] = {}
        for j in e.judgements(controller):
            by_demand[id(j.demand)] = by_demand.get(id(j.demand), True) and j.met
        if not by_demand:
            return Cell("–", reason="not run")
        found = list(by_demand.values())
        if e.steps and not math.isnan(e.limit(e.steps[0])):
            kinds = e.judged(controller)
            found += [e.ratio(controller, kinds, s).value <= e.want.ratio for s in e.steps]
        return _cell(not all(found), 0, f"{sum(found)} of {len(found)}")

    return Table.of(
        "Requirements met and wished ratios reached in all variations",
        [c for c in result.study.controllers if result.study.selection(c).judged],
        {"controller": str, **{e.case.name: partial(met, e) for e in evidence(result)}},
    )


def _table(
    result: StudyResult,
    title: str,
    head: Sequence[str],
    rows: Callable[[Evidence], Iterator[Row]],
    note: str = "",
) -> Table:
    """Return a table whose rows begin with the plant."""
    every = [(e.case.name, *row) for e in evidence(result) for row in rows(e)]
    return Table(title, ("plant", *head), tuple(every), note)


def steps_table(result: StudyResult, *, nominal: bool) -> Table:
    """Return settling, overshoot and rest of every controller, nominal or the worst variation."""

    def rows(e: Evidence) -> Iterator[Row]:
        for controller in e.controllers:
            kinds = [NOMINAL] if nominal else e.judged(controller)
            settling = [e.metric(controller, kinds, "settling_time", _size(s)) for s in e.steps]
            ratios = [e.ratio(controller, kinds, s) for s in e.steps]
            over, error, oscillation = (
                (e.metric(controller, kinds, n).value, _limit_of(e, controller, n))
                for n in ("overshoot", "steady_error", "oscillation")
            )
            yield (
                controller,
                *(Cell(number(v.value), "", v.reason) for v in settling),
                *(_cell(r.value, e.want.ratio, reason=r.reason) for r in ratios),
                _cell(*over, number(100 * over[0])),
                *(_cell(*rest, number(e.shown(rest[0]))) for rest in (error, oscillation)),
            )

    first = evidence(result)[0]
    head = ["controller", *(f"settling {first.size(s)} s" for s in first.steps), *first.ratios]
    head += ["overshoot %", f"steady error {first.unit}", f"oscillation {first.unit}"]
    which = "nominal" if nominal else "worst of all variations"
    return _table(result, f"Steps, {which}", head, rows)


def _limit_of(e: Evidence, controller: str, metric: str) -> float:
    """Return the limit of a metric of the steps, in SI; infinite without one."""
    for j in e.result.judgements:
        required = j.demand.requirement
        own = (required.metric, j.controller, j.scenario, j.demand.step)
        if own == (metric, controller, e.want.scenario, None):
            return float(to_si(required.limit, required.unit))
    return math.inf


def missed_table(result: StudyResult) -> Table:
    """List every requirement and every wished ratio to the limit that is missed, with its cause."""

    def rows(e: Evidence) -> Iterator[Row]:
        for controller in e.controllers:
            for row in _missed(e, controller):
                yield (controller, *row)

    head = ("controller", "metric", "nominal", "worst", "limit", "what prevents it")
    found = _table(result, "What is missed", head, rows)
    note = (
        "Each cause is shown below, with its runs. A ratio to the limit is wished: it decides no"
        " exit status."
    )
    none = "Every requirement is met and every wished ratio reached in every variation."
    return replace(found, note=note if found.rows else none)


def _missed(e: Evidence, controller: str) -> Iterator[Row]:
    known = e.result.study.variations
    for demand in e.result.study.demands:
        every = e.judgements(controller)
        own = {known[j.variation].kind: j for j in every if j.demand is demand}
        if all(j.met for j in own.values()):
            continue
        most = max(own.values(), key=lambda j: j.score)
        required = demand.requirement
        step = "" if demand.step is None else f" {e.size((0.0, demand.step))}"
        yield (
            f"{metric_title(required.metric)}{step}, {most.scenario}",
            number(own[NOMINAL].value) if NOMINAL in own else "–",
            number(most.value),
            f"{required.limit:g} {written(required.unit)}".strip(),
            _cause_of_miss(e, controller, own),
        )
    for pair in e.steps:
        worst_ratio = e.ratio(controller, e.judged(controller), pair).value
        if not math.isnan(e.limit(pair)) and not worst_ratio <= e.want.ratio:
            yield (
                f"settling {e.size(pair)} / limit",
                number(e.ratio(controller, [NOMINAL], pair).value),
                number(worst_ratio),
                f"{e.want.ratio:g}",
                cause_of_ratio(e, controller, pair),
            )


def _better(e: Evidence, reached: Mapping[str, float], own: float) -> str:
    """Say which other controller reaches the goal, the best of those that do; empty if none."""
    if not reached:
        return ""
    best = min(reached, key=lambda name: reached[name])
    return (
        f"{e.want.design.name}: {best} reaches {number(reached[best])} at worst; this one"
        f" {number(own)}."
    )


def _cause_of_miss(e: Evidence, controller: str, own: Mapping[str, Judgement]) -> str:
    """Say what keeps a metric from its limit, with the numbers that show it."""
    demand = next(iter(own.values())).demand
    most = max(own.values(), key=lambda j: j.score)
    reached = {}
    for other in e.controllers:
        judged = [j for j in e.judgements(other) if j.demand is demand]
        if other != controller and judged and all(j.met for j in judged):
            reached[other] = max(j.value for j in judged)
    if reached:
        return _better(e, reached, most.value)
    required, without = demand.requirement, math.nan
    if required.scenario == e.want.scenario:
        found = e.metric(controller, [e.want.neglected.variation], required.metric, demand.step)
        without = float(from_si(found.value, required.unit))
    values = {kind: j.value for kind, j in own.items()}
    bad = [kind for kind, j in own.items() if not j.met]
    return _cause(e, values, bad, without, required.limit)


def cause_of_ratio(e: Evidence, controller: str, step: Step) -> str:
    """Say what keeps a step from its required ratio to the limit, with the numbers that show it."""
    want = e.want
    allowed = want.ratio * e.limit(step)
    ratios = {c: e.ratio(c, e.judged(c), step).value for c in e.controllers}
    own = ratios.pop(controller)
    reached = {other: r for other, r in ratios.items() if r <= want.ratio}
    if reached:
        return _better(e, reached, own)
    plan = e.planned(controller, step)
    if plan > allowed:
        return (
            f"{want.unknown.name}: the plan alone takes {number(plan)} s of {number(allowed)} s"
            " that are allowed."
        )
    times = {kind: e.settling(controller, kind, step).value for kind in e.judged(controller)}
    late = [kind for kind, seconds in times.items() if not seconds <= allowed]
    without = e.settling(controller, want.neglected.variation, step).value
    return _cause(e, times, late, without, allowed, " s")


def _cause(
    e: Evidence,
    values: Mapping[str, float],
    bad: Sequence[str],
    without: float,
    limit: float,
    unit: str = "",
) -> str:
    """Say what keeps a controller from a limit, with the numbers that show it.

    Args:
        values: What was measured by kind of plant, in the unit of the limit.
        bad: Kinds of the plants on which the limit is missed.
        without: What was measured without what is neglected, in the same unit; NaN if nothing.
        limit: The limit, in its unit.
    """
    want = e.want
    said = [f"{number(values[NOMINAL])}{unit} nominal"] if NOMINAL in values else []
    listed = ", ".join(f"{number(values[k])}{unit} with {k}" for k in bad if k != NOMINAL)
    told = f"{'; '.join(filter(None, (*said, listed)))}; the limit is {number(limit)}{unit}"
    if list(bad) == [want.unknown.variation]:
        return f"{want.unknown.name}: {told}."
    if not math.isnan(without):
        told += f"; {number(without)}{unit} without what is neglected"
    name = want.neglected.name if NOMINAL in bad and without <= limit else want.loop.name
    return f"{name}: {told}."


def _unknown_words(found: Sequence[Evidence]) -> str:
    """Say what the unknown does to the limit itself, where it grows most."""
    grown = [
        (ratio, e, step)
        for e in found
        for step in e.steps
        if (ratio := e.limit(step, e.want.unknown.variation) / e.limit(step)) > 0.0
    ]
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


def _base(v: Variation) -> str:
    return v.kind.rpartition(", plan x ")[0] or NOMINAL


class _Paced(NamedTuple):
    """A controller with its planned moves made shorter or longer.

    Args:
        pace: Duration of the moves, a ratio to the design's own.
        known: Kind of the plant that the design knows, with these moves.
        kinds: Kinds of all plants that it ran with them.
    """

    controller: str
    pace: float
    known: str
    kinds: list[str]


def _paced(e: Evidence) -> Iterator[_Paced]:
    """Yield what ran with moves of every duration, the design's own among them."""
    paced = [v for v in e.variations if v.plan_duration != 1.0]
    if not paced:
        return
    bases = {_base(v) for v in paced}
    compared = [v for v in e.variations if v in paced or v.kind in bases]
    paces = sorted({v.plan_duration for v in compared})
    asked = next(v.controllers for v in compared if v.plan_duration == paces[0])
    for pace in paces:
        own = [v for v in compared if v.plan_duration == pace]
        known = next(v.kind for v in own if _base(v) == NOMINAL)
        for c in asked or e.controllers:
            if c in e.case.controllers and e.has(c, known):
                yield _Paced(c, pace, known, [v.kind for v in own if e.has(c, v.kind)])


def plan_table(result: StudyResult) -> Table:
    """Return what planned moves cost that are made shorter and longer."""

    def rows(e: Evidence) -> Iterator[Row]:
        for p in _paced(e):
            ratios = [e.ratio(p.controller, [p.known], s).value for s in e.steps]
            overs = [e.metric(p.controller, p.kinds, "overshoot", _size(s)).value for s in e.steps]
            rest = e.metric(p.controller, p.kinds, "oscillation").value
            allowed = _limit_of(e, p.controller, "oscillation")
            yield (
                f"× {p.pace:g}",
                *(_cell(r, e.want.ratio) for r in ratios),
                *(_cell(o, e.want.overshoot, number(100 * o)) for o in overs),
                _cell(rest, allowed, number(e.shown(rest))),
            )

    cases = evidence(result)
    first = cases[0]
    head = (
        "duration of the plan",
        *(f"as known: {ratio}" for ratio in first.ratios),
        *(f"worst: overshoot {first.size(s)}, %" for s in first.steps),
        f"worst: oscillation {first.unit}",
    )
    name = next((p.controller for e in cases for p in _paced(e)), "")
    title = f"{name} with its planned moves made shorter and longer"
    return _table(result, title, head, rows, "The feedback is the same in all rows of a plant.")


def limits_table(result: StudyResult) -> Table:
    """Return the physical limits of every plant."""
    cases = evidence(result)
    rows = [
        (
            e.case.name if kind == NOMINAL else f"{e.case.name}, {kind}",
            *(number(e.limit(step, kind)) for step in e.steps),
        )
        for e in cases
        for kind in (NOMINAL, *result.study.report.limit_variations)
    ]
    head = ("plant", *(f"{cases[0].words(s)}, s" for s in cases[0].steps))
    note = (
        "Full command one way, then the other, known to the last parameter, without noise and"
        " without what the design models leave out."
    )
    title = "Physical limit: time-optimal moves of the full plant into the 2 % band"
    return Table(title, head, tuple(rows), note)


def known_table(result: StudyResult) -> Table:
    """Return what tolerance costs: designs that are not judged beside those that are."""

    def rows(e: Evidence) -> Iterator[Row]:
        shown = [c for c in e.want.controllers if c in e.case.controllers]
        kinds = (NOMINAL, e.want.unknown.variation)
        for controller in [] if set(shown) <= set(e.controllers) else shown:
            for kind in (k for k in kinds if e.has(controller, k)):
                yield (
                    controller,
                    "as known" if kind == NOMINAL else kind,
                    *(number(e.ratio(controller, [kind], s).value) for s in e.steps),
                    number(100 * e.metric(controller, [kind], "overshoot").value),
                    number(e.shown(e.metric(controller, [kind], "oscillation").value)),
                )

    first = evidence(result)[0]
    head = ("controller", "varied", *first.ratios, "overshoot %", f"oscillation {first.unit}")
    return _table(result, "Speed against tolerance of what nobody announced", head, rows)


def ladder_table(result: StudyResult) -> Table:
    """Return settling with one limitation less at a time."""

    def settled(e: Evidence, controller: str, kind: str, step: Step) -> Cell:
        found, ratio = e.settling(controller, kind, step), e.ratio(controller, [kind], step).value
        text = number(found.value)
        if math.isnan(ratio):
            return Cell(text, reason=found.reason)
        return _cell(ratio, e.want.ratio, f"{text} ({number(ratio)})")

    def rows(e: Evidence) -> Iterator[Row]:
        for controller in e.want.controllers:
            for kind, what in ((NOMINAL, "everything"), *e.want.ladder):
                if controller in e.case.controllers and e.has(controller, kind):
                    yield (controller, what, *(settled(e, controller, kind, s) for s in e.steps))

    first = evidence(result)[0]
    note = (
        "Each row has what the row above has, less what it names. What is left in the last row is"
        " the smooth plan, the sample time and the margins of the loop."
    )
    title = "One limitation less at a time: settling in s, and over the limit"
    head = ("controller", "the plant has", *map(first.words, first.steps))
    return _table(result, title, head, rows, note)


def time_table(result: StudyResult) -> Table:
    """Return where the time of a step goes, nominal runs."""

    def rows(e: Evidence) -> Iterator[Row]:
        for c in e.controllers:
            times = [
                (e.limit(s), e.planned(c, s), e.settling(c, NOMINAL, s).value) for s in e.steps
            ]
            yield (c, *(" / ".join(map(number, t)) for t in times))

    first = evidence(result)[0]
    head = ("controller", *map(first.words, first.steps))
    title = "Time into the 2 % band: limit / planned move / output, in s"
    return _table(result, title, head, rows)


MARGINS = Figure("margins", margins_table, title="How close to the edge", order=4)
LIMITATIONS = Figure(
    "limitations", _limitations, title="What is not reached, and what prevents it", order=5
)
