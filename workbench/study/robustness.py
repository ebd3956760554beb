"""Robustness over a parameter box: draws, worst case, probabilities, and what hurts most.

The draws are the same for every controller: a scrambled Sobol sequence, which covers the box more
evenly than independent draws. The share of draws that meet a requirement estimates its probability,
with an interval that is exact for independent draws (Clopper and Pearson, Biometrika 26, 1934), so
on the safe side. The worst draw is where a
local search begins: it first tries the corner to which a straight line through all scores points,
then moves one parameter at a time, with steps that shrink when nothing gets worse (compass search;
Kolda, Lewis and Torczon, SIAM Review 45, 2003). The same straight line tells how much each
parameter changes the score from its lowest to its highest value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.checked_json import TableShape, listed, number
from workbench.files import picked
from workbench.study.designs import ControllerRecipe
from workbench.study.execution import Progress, Workers
from workbench.study.judgements import LARGEST, Judgement, judge_records, worst_score
from workbench.study.study import Box, Demand, Study, Variation
from workbench.study.tasks import RECORD, Record, Task, execute, record_from_table

CONFIDENCE = 0.95
"""Probability that an interval covers."""


def unit_draws(parameters: int, draws: int, seed: int) -> Vector:
    """Draw points of the unit cube, shape (draws, parameters), by a scrambled Sobol sequence."""
    from scipy.stats import qmc

    sampler = qmc.Sobol(parameters, scramble=True, rng=np.random.default_rng(seed))
    whole = sampler.random_base2(max(1, math.ceil(math.log2(draws))))
    return np.asarray(whole[:draws], dtype=float)


def scaled(box: Box, unit: Vector) -> Vector:
    """Return points of the box, in SI, for points of the unit cube, both shape (n, n_parameters).

    They have 9 digits, so that a stored run is found again.
    """
    ends = np.array(list(box.ranges.values()))
    values = ends[:, 0] + unit * (ends[:, 1] - ends[:, 0])
    return np.array([[float(f"{v:.9g}") for v in row] for row in values]).reshape(np.shape(unit))


def straight_line(unit: Vector, values: Vector) -> tuple[float, Vector, float]:
    """Fit a straight line to scores over the unit cube.

    Args:
        unit: Points, shape (n, n_parameters), 0 to 1.
        values: Scores, shape (n,).

    Returns:
        Constant, change over the whole range of each parameter, shape (n_parameters,), and the
        ratio of the variance that is explained.
    """
    matrix = np.column_stack([np.ones(len(unit)), unit - 0.5])
    solution, *_ = np.linalg.lstsq(matrix, values, rcond=None)
    spread = float(np.sum((values - values.mean()) ** 2))
    rest = float(np.sum((values - matrix @ solution) ** 2))
    # Equal scores leave nothing to explain.
    explained = 1.0 - rest / spread if spread > 1e-12 else 0.0
    changes = np.asarray(solution[1:], dtype=float) if spread > 1e-12 else np.zeros(unit.shape[1])
    return float(solution[0]), changes, explained


@dataclass(frozen=True)
class Probability:
    """How often a requirement was met over the box.

    Args:
        low: Lower end of the 95 % interval of the probability (a ratio).
        high: Upper end of the interval (a ratio).
        worst: Worst value of the metric over draws and search, in the unit of the limit; NaN if a
            run had none.
    """

    requirement: str
    hard: bool
    met: int
    draws: int
    low: float
    high: float
    worst: float

    @property
    def share(self) -> float:
        """Share of the draws that met it, a ratio."""
        return self.met / self.draws if self.draws else math.nan


@dataclass(frozen=True)
class Robustness:
    """What a parameter box does to a controller.

    Args:
        points: Drawn plants and those of the search, shape (n, n_parameters), in SI.
        scores: Worst score of the hard requirements at each point, shape (n,), at most 10.
        drawn: Number of leading points that were drawn; the rest were searched.
        effects: Change of the score (a ratio) from lowest to highest value by parameter, hardest
            first.
        explained: R squared, the ratio of the scores' variance that the straight line explains.
        worst: Values of the worst plant by parameter, in SI.
        judgement: The requirement that gives the worst score there, or None.
        worst_runs: Runs at the worst plant, one per scenario, with their trajectories.
    """

    controller: str
    points: Vector
    scores: Vector
    drawn: int
    probabilities: tuple[Probability, ...]
    effects: Mapping[str, float]
    explained: float
    worst: Mapping[str, float]
    judgement: Judgement | None
    failed: tuple[str, ...] = ()
    worst_runs: tuple[Record, ...] = ()

    @property
    def worst_score(self) -> float:
        """Worst score of the hard requirements, a ratio; 10 stands for 10 and above."""
        return float(self.scores.max())

    @property
    def missed(self) -> bool:
        """Whether a plant of the box misses a hard requirement, or a run on it failed."""
        return self.worst_score > 1.0 or bool(self.failed)

    def why(self) -> str:
        """Return in words what is missed in the box, and how often."""
        hard = [p for p in self.probabilities if p.hard]
        least = min(hard, key=lambda p: p.share, default=None)
        if least is not None and least.share < 1.0:
            what = least.requirement.replace("_", " ")
            return f"{what} holds at {100 * least.share:.0f} % of {self.drawn} plants"
        if self.worst_score > 1.0 and self.judgement is not None:
            what = self.judgement.demand.requirement.metric.replace("_", " ")
            return f"{what} {self.judgement.excess()} at the worst plant"
        return f"a run failed: {self.failed[0]}" if self.failed else ""

    def table(self) -> dict[str, Any]:
        """Return the figures as plain numbers and words."""
        return {
            "controller": self.controller,
            "draws": self.drawn,
            "searched": len(self.points) - self.drawn,
            "worst_score": self.worst_score,
            "missed": self.missed,
            "worst_plant": dict(self.worst),
            "worst_requirement": str(self.judgement) if self.judgement else "",
            "effects_on_score": dict(self.effects),
            "explained": self.explained,
            "requirements": [
                picked(p, "requirement hard met draws probability=share worst")
                | {"interval_95": [p.low, p.high]}
                for p in self.probabilities
            ],
            "failed": list(self.failed),
        }


def robustness(
    study: Study, workers: Workers, progress: Progress | None = None
) -> tuple[Robustness, ...]:
    """Search the parameter box of a study."""
    box = study.box
    if box is None:
        return ()
    unit = unit_draws(len(box.ranges), box.draws, box.seed)
    points = scaled(box, unit)
    chosen = [study.controllers[name] for name in box.controllers or study.controllers]
    asked = [
        task
        for c in chosen
        for i, point in enumerate(points)
        for task in _tasks(study, c, point, f"draw {i + 1}")
    ]
    records = workers.records(asked, progress)
    left = iter(records)
    groups = {
        c.name: [tuple(islice(left, len(box.scenarios))) for _ in range(box.draws)] for c in chosen
    }
    searches = [_search(study, c, unit, groups[c.name]) for c in chosen]

    def name(asked: Search) -> str:
        return f"{asked.controller.name} / worst plant"

    tables = workers.finished(searches, search, _TRIED, name=name, progress=progress)
    results = [
        _result(study, c.name, unit, groups[c.name], table["tried"])
        for c, table in zip(chosen, tables, strict=True)
    ]
    shown = [
        replace(task, traces=True)
        for c, result in zip(chosen, results, strict=True)
        for task in _tasks(study, c, np.array(list(result.worst.values())), "worst plant")
    ]
    runs = workers.records(shown)
    return tuple(
        replace(r, worst_runs=tuple(run for run in runs if run.controller == r.controller))
        for r in results
    )


def _tasks(study: Study, controller: ControllerRecipe, point: Vector, label: str) -> list[Task]:
    assert study.box is not None
    values = zip(study.box.ranges, point.tolist(), strict=True)
    variation = Variation(label, study.plant.varied(parameters=values), kind=label)
    scenarios = [replace(study.scenarios[name], name=name) for name in study.box.scenarios]
    seed, own = study.seeds[0], study.own_metrics
    return [Task(controller, variation, scenario, seed, own) for scenario in scenarios]


def _score(study: Study, records: Sequence[Record]) -> float:
    return min(worst_score(_judgements(study, records)), LARGEST)


def _judgements(study: Study, records: Sequence[Record]) -> tuple[Judgement, ...]:
    """Judge drawn plants by the requirements on the nominal one."""
    judged = judge_records(study, [replace(r, variation=study.nominal().name) for r in records])
    return tuple(replace(j, variation=records[0].variation) for j in judged)


@dataclass(frozen=True)
class Search:
    """A local search that is to be done.

    Args:
        tasks: Runs at the point where it begins: one per scenario.
        start: Point of the unit cube where it begins.
        corner: Point of the unit cube that is tried first.
        start_score: Score at the start, a ratio.
    """

    tasks: tuple[Task, ...]
    box: Box
    demands: tuple[Demand, ...]
    start: tuple[float, ...]
    corner: tuple[float, ...]
    start_score: float
    study: Study = field(repr=False)

    @property
    def controller(self) -> ControllerRecipe:
        """The controller for which bad plants are searched."""
        return self.tasks[0].controller


_TRIED = TableShape(
    {"tried": listed(TableShape({"point": listed(number), "runs": listed(RECORD)}))}
)


def _search(
    study: Study, controller: ControllerRecipe, unit: Vector, groups: Sequence[Sequence[Record]]
) -> Search:
    """Return the search that begins at the worst draw."""
    assert study.box is not None
    values = np.array([_score(study, records) for records in groups])
    worst = int(np.argmax(values))
    _, slopes, _ = straight_line(unit, values)
    return Search(
        tuple(_tasks(study, controller, scaled(study.box, unit)[worst], f"draw {worst + 1}")),
        study.box,
        study.demands,
        tuple(unit[worst].tolist()),
        tuple(1.0 if s > 0 else 0.0 for s in slopes),
        float(values[worst]),
        study,
    )


def search(asked: Search) -> dict[str, Any]:
    """Move from a bad point of the box to a worse one."""
    study, box = asked.study, asked.box
    tried: dict[tuple[float, ...], list[Any]] = {}

    def at(point: tuple[float, ...]) -> float:
        values = scaled(box, np.array([point]))[0]
        label = f"search {len(tried) + 1}"
        records = [execute(t) for t in _tasks(study, asked.controller, values, label)]
        tried[point] = [r.table() for r in records]
        return _score(study, records)

    best, worst = asked.start, asked.start_score
    if box.search and asked.corner != best and (value := at(asked.corner)) > worst:
        best, worst = asked.corner, value
    step = 0.25
    while len(tried) < box.search and step > 0.02 and worst < LARGEST:
        moved = False
        for i in range(len(best)):
            for sign in (1.0, -1.0):
                other = list(best)
                other[i] = round(min(max(other[i] + sign * step, 0.0), 1.0), 9)
                point = tuple(other)
                if point in tried or point == asked.start or len(tried) >= box.search:
                    continue
                value = at(point)
                if value > worst:
                    best, worst, moved = point, value, True
                    break
        if not moved:
            step /= 2.0
    return {"tried": [{"point": list(p), "runs": tables} for p, tables in tried.items()]}


def _result(
    study: Study,
    name: str,
    unit: Vector,
    drawn: Sequence[Sequence[Record]],
    searched: Sequence[Mapping[str, Any]],
) -> Robustness:
    from scipy.stats import binomtest

    assert study.box is not None
    groups = [*drawn, *([record_from_table(row) for row in one["runs"]] for one in searched)]
    everywhere = np.vstack([unit, *(np.array([one["point"]]) for one in searched)])
    judged = [_judgements(study, records) for records in groups]
    values = np.array([min(worst_score(j), LARGEST) for j in judged])
    _, slopes, explained = straight_line(unit, values[: len(unit)])
    order = np.argsort(-np.abs(slopes), kind="stable")
    names = list(study.box.ranges)
    points = scaled(study.box, everywhere)
    worst = int(np.argmax(values))
    hard = [j for j in judged[worst] if j.hard]
    probabilities = []
    for demand in study.demands:
        own = [[j for j in found if j.demand is demand] for found in judged]
        if not any(own):
            continue
        met = sum(all(j.met for j in found) for found in own[: len(unit)])
        low, high = binomtest(met, len(unit)).proportion_ci(CONFIDENCE)
        most = max((j for found in own for j in found), key=lambda j: j.score)
        counted = str(demand), demand.requirement.hard, met, len(unit)
        probabilities.append(Probability(*counted, float(low), float(high), most.value))
    failed = tuple(dict.fromkeys(r.reason for records in groups for r in records if r.failed))
    told = tuple(probabilities)
    effects = {names[i]: float(slopes[i]) for i in order}
    at = dict(zip(names, points[worst].tolist(), strict=True))
    judgement = max(hard, key=lambda j: j.score, default=None)
    return Robustness(
        name, points, values, len(unit), told, effects, explained, at, judgement, failed
    )
