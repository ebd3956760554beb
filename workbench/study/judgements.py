"""Requirements judged over all runs of a study."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from workbench.model.units import with_unit
from workbench.study.feasible import can_have
from workbench.study.study import Demand, Study
from workbench.study.tasks import Record
from workbench.verification import judge
from workbench.verification.metrics import metric_of, worst

LARGEST = 10.0
"""Score that counts in a mean where a requirement was missed by more, or could not be judged."""


RUN_FAILED = "the run failed"
"""How the reason of a requirement begins that has no value because its run failed."""


@dataclass(frozen=True)
class Judgement:
    """A requirement on one controller, variation and scenario: the worst seed counts.

    Args:
        value: Its metric, in the unit of the limit; NaN if there is none.
        score: Value over limit (or limit over value), a ratio: at most 1 means met.
    """

    demand: Demand
    controller: str
    variation: str
    scenario: str
    seed: int
    value: float
    score: float
    reason: str = ""

    @property
    def met(self) -> bool:
        """Whether the requirement is met."""
        return self.score <= 1.0

    @property
    def hard(self) -> bool:
        """Whether missing it fails the study."""
        return self.demand.requirement.hard

    def excess(self) -> str:
        """Return in words by how much the requirement is missed or met."""
        required = self.demand.requirement
        value, limit = (with_unit(f"{v:.4g}", required.unit) for v in (self.value, required.limit))
        if math.isnan(self.value):
            return f"has no value ({self.reason}); the limit of {limit} is not met"
        if required.limit == 0.0:
            how = "above" if self.value > 0 else "at"
        else:
            ratio = self.value / required.limit - 1.0
            where = "over" if ratio > 0 else "under"
            how = (
                f"{abs(100 * ratio):.3g} % {where}" if ratio <= 1.0 else f"{ratio + 1.0:.3g} times"
            )
        return f"is {value}, {how} the limit of {limit}"

    def __str__(self) -> str:
        what = f"{self.demand.metric} {self.excess()}"
        return f"{self.controller}, {self.scenario}, {self.variation}: {what}"


@dataclass(frozen=True)
class Score:
    """One number for a controller.

    Args:
        worst: Worst score of the hard requirements over all runs, a ratio; at most 1 means all are
            met.
        mean: Weighted mean over all requirements of their worst scores, ratios of at most 10.
        judgement: The requirement, scenario and variation that the worst score comes from, or None.
    """

    controller: str
    worst: float
    mean: float
    judgement: Judgement | None

    @property
    def met(self) -> bool:
        """Whether all hard requirements are met."""
        return self.worst <= 1.0


def judge_records(study: Study, records: Iterable[Record]) -> tuple[Judgement, ...]:
    """Judge every requirement on every run it applies to.

    Args:
        records: Runs; a failed one meets no requirement.
    """
    most: dict[tuple[int, str, str, str], Judgement] = {}
    for record in records:
        for i, demand in enumerate(study.demands):
            if not _judged(study, demand, record):
                continue
            found = _judgement(demand, record)
            key = (i, record.controller, record.variation, record.scenario)
            if key not in most or found.score > most[key].score:
                most[key] = found
    return tuple(most[key] for key in sorted(most, key=lambda key: key[0]))


def _judged(study: Study, demand: Demand, record: Record) -> bool:
    metric = demand.requirement.metric
    if not study.judges(demand, record.controller, record.variation, record.scenario):
        return False
    scenario = study.scenarios.get(record.scenario)
    if scenario is not None and not can_have(metric, scenario, study.metrics):
        return False
    # A PID neither solves nor slides, and few have a guard with limits; a failed run is judged by
    # what it would have had.
    known = metric_of(metric, study.metrics)
    if known is not None and known.needs in ("solver", "surface", "guard"):
        return record.metrics is not None and metric in record.metrics
    return True


def _judgement(demand: Demand, record: Record) -> Judgement:
    identity = (demand, record.controller, record.variation, record.scenario, record.seed)
    if record.metrics is None:
        return Judgement(*identity, math.nan, math.inf, f"{RUN_FAILED}: {record.reason}")
    measured = record.metrics
    if demand.step is not None:
        found = worst(record.values_of_steps(demand.requirement.metric, demand.step))
        metric = replace(
            measured[demand.requirement.metric], value=found.value, reason=found.reason
        )
        measured = replace(measured, values=(metric,))
    return Judgement(*identity, *judge(demand.requirement, measured))


def worst_score(judgements: Sequence[Judgement]) -> float:
    """Return the worst score of the hard requirements, a ratio: at most 1 if all are met."""
    return max((j.score for j in judgements if j.hard), default=0.0)


def scores(study: Study, judgements: Sequence[Judgement]) -> tuple[Score, ...]:
    """Return one score per controller."""
    found = []
    for name in study.controllers:
        if not study.selection(name).judged:
            continue
        own = [j for j in judgements if j.controller == name]
        hard = [j for j in own if j.hard]
        by_demand: dict[int, float] = {}
        for j in own:
            key = study.demands.index(j.demand)
            by_demand[key] = max(by_demand.get(key, 0.0), min(j.score, LARGEST))
        weight = sum(study.demands[key].weight for key in by_demand)
        mean = sum(study.demands[key].weight * value for key, value in by_demand.items())
        first = max(hard, key=lambda j: j.score, default=None)
        found.append(
            Score(name, first.score if first else 0.0, mean / weight if weight else 0.0, first)
        )
    return tuple(found)
