"""Findings on several plants are one entry that names the worst and the others."""

from __future__ import annotations

import math

from workbench.study.baseline import Change, Way
from workbench.study.grouped import changes_by_plant, missed_by_plant
from workbench.study.judgements import Judgement
from workbench.study.study import Demand
from workbench.verification import Requirement

SETTLING = Demand(Requirement("settling_time", 0.5, "s"))
RMSE = Demand(Requirement("rmse", 1.0, "deg"))


def missed(demand: Demand, plant: str, score: float, scenario: str = "step") -> Judgement:
    return Judgement(demand, "pid", plant, scenario, 1, score * demand.requirement.limit, score)


def change(metric: str, plant: str, after: float, way: Way = "worse") -> Change:
    return Change(("pid", plant, "step", 1), metric, 1.0, after, "s", way, True, 0.1)


def test_one_entry_per_requirement_and_scenario_with_the_worst_plant_first() -> None:
    judged = [
        missed(SETTLING, "nominal", 1.2),
        missed(RMSE, "4 kg", 1.5),
        missed(SETTLING, "4 kg", 3.0),
        missed(SETTLING, "late, noisy", math.inf),
        missed(SETTLING, "nominal", 1.1, "sine"),
    ]
    found = missed_by_plant(judged)
    assert [(g.worst.variation, g.worst.scenario, g.others) for g in found] == [
        ("late, noisy", "step", ("nominal", "4 kg")),
        ("4 kg", "step", ()),
        ("nominal", "sine", ()),
    ]
    assert found[0].also == "also with nominal; 4 kg" and found[1].also == ""


def test_required_metrics_come_first_then_what_is_furthest_beyond_its_tolerance() -> None:
    changes = [
        change("air", "nominal", 9.0),
        change("rmse", "nominal", 1.2),
        change("rmse", "4 kg", 1.4),
        change("rmse", "5 bar", 0.5, "better"),
        change("settling_time", "nominal", math.nan),
    ]
    found = changes_by_plant(changes, ["rmse", "settling_time"])
    named = [(g.worst.metric, g.worst.way, g.worst.key[1], g.others) for g in found]
    assert named == [
        ("settling_time", "worse", "nominal", ()),
        ("rmse", "better", "5 bar", ()),
        ("rmse", "worse", "4 kg", ("nominal",)),
        ("air", "worse", "nominal", ()),
    ]
    assert found[0].worst.numbers() == "1 -> none"
