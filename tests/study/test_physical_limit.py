"""Distance to the physical limit: of each step, worst per scenario, with reasons, kept once."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.study.small_study import small_study
from workbench.errors import NumericalError
from workbench.files import json_text
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.reports.summary import summary
from workbench.study import physical_limit
from workbench.study.baseline import baseline_text
from workbench.study.execution import Workers, store_of
from workbench.study.physical_limit import Move, distances, find_limits, limit_of, no_limit
from workbench.study.plants import PlantRecipe
from workbench.study.read import load_study
from workbench.study.result import run_study
from workbench.study.study import Study
from workbench.study.summary import plain_summary
from workbench.study.tasks import Record, record_from_table
from workbench.verification import Change, Disturbance, Metrics, Scenario, Sine, Steps
from workbench.verification.each_step import StepResponse
from workbench.verification.responses import Value

UP = {"angle": Steps((0.0, 0.1), (0.4, 0.6))}
ASKED = ('name = "small"', 'name = "small"\n[report]\nphysical_limit = true')


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float]]:
    """Moves that were solved; a limit takes seconds, so here it is 0.1 s."""
    made: list[tuple[float, float]] = []

    def found(model: Any, initial: float, final: float, **_: Any) -> Any:
        made.append((initial, final))
        return SimpleNamespace(seconds=0.1)

    monkeypatch.setattr(physical_limit, "physical_limit", found)
    return made


def asking(folder: Path, *changes: tuple[str, str]) -> Study:
    return load_study(small_study(folder, ASKED, *changes))


@pytest.mark.parametrize(
    ("scenario", "reason"),
    [
        (Scenario("up", UP, 1.0), ""),
        (Scenario("sine", {"angle": Sine(0.5, 0.1, 1.0)}, 1.0), "the reference has no step"),
        (
            Scenario("load", UP, 1.0, changes=(Change(0.5, "load", 2.0),)),
            "the load changes during the run",
        ),
        (
            Scenario(
                "two",
                UP,
                1.0,
                changes=(Change(0.5, "load", 2.0), Change(0.6, "supply_pressure", 5e5)),
            ),
            "the load and the supply pressure change during the run",
        ),
        (
            Scenario("push", UP, 1.0, disturbances=(Disturbance(0.5, "joint.torque", 1.0),)),
            "a disturbance acts during the run",
        ),
        (Scenario("both", {**UP, "pressure_1": Steps((0.0,), (3e5,))}, 1.0), "several outputs"),
    ],
)
def test_why_there_is_no_limit(scenario: Scenario, reason: str) -> None:
    said = no_limit(scenario, arm(3))
    assert said.startswith(reason) and bool(said) == bool(reason)


def test_a_plant_without_that_position_has_no_limit() -> None:
    assert "'angle' shows no state" in no_limit(Scenario("up", UP, 1.0), servo_axis())


def test_not_asked_for_is_said_and_nothing_is_solved(
    tmp_path: Path, calls: list[tuple[float, float]]
) -> None:
    study = load_study(small_study(tmp_path))
    outcome = run_study(study, tmp_path / "out")
    table = json.loads(json_text(outcome.table()))["physical_limit"]
    assert calls == [] and table["asked"] is False and table["steps"] == []
    unknown = dict.fromkeys(("ratio", "limit_s", "begin_s", "seed"))
    told = {"controller": "pid", "scenario": "step", "reason": "not asked for"}
    assert table["worst"] == [unknown | told]
    assert "time-optimal" not in summary(outcome) and "physical limit" not in plain_summary(outcome)


def test_asked_for_it_is_in_results_and_summary_but_in_no_metric_or_baseline(
    tmp_path: Path, calls: list[tuple[float, float]]
) -> None:
    study = asking(tmp_path)
    outcome = run_study(study, tmp_path / "out")
    assert calls == [(pytest.approx(math.radians(25)), pytest.approx(math.radians(35)))]
    record = outcome.record("pid", "step")
    assert record is not None and record.metrics is not None
    settling = record.metrics["settling_time"].value
    (row,) = json.loads(json_text(outcome.table()))["physical_limit"]["steps"]
    assert row["settling_s"] == settling and row["limit_s"] == 0.1
    assert row["ratio"] == pytest.approx(settling / 0.1)
    assert row["variation"] == "nominal" and row["begin_s"] == pytest.approx(0.1)
    text = summary(outcome)
    assert f"pid takes {settling / 0.1:.2g} times the limit of 0.100 s" in text
    assert f"| {settling:#.3g} s ({settling / 0.1:.2g} ×) |" in text
    assert f"{settling / 0.1:.2g} (" in plain_summary(outcome)
    assert not any("limit" in name for name in record.metrics)
    stored = baseline_text(study.name, outcome.records, {})
    assert "limit" not in stored and '"steps"' not in stored


def test_found_once_it_is_kept(tmp_path: Path, calls: list[tuple[float, float]]) -> None:
    study, said = asking(tmp_path), []
    for _ in range(2):
        workers = Workers(store_of(study, tmp_path / "out"))
        found = find_limits(study, workers, progress=lambda *a: said.append(a))
    assert len(calls) == 1 and list(found.values()) == [Value(0.1)]
    assert said[-1] == (1, 1, "finished before")


def test_the_same_move_is_solved_once(tmp_path: Path, calls: list[tuple[float, float]]) -> None:
    own, again = "times = [0.0, 0.1]\n", "times = [0, 0.1, 0.6, 1.1]\n"
    study = asking(tmp_path, (f"{own}values = [25, 35]", f"{again}values = [25, 35, 25, 35]"))
    found = find_limits(study, Workers(store_of(study, tmp_path / "out")))
    assert len(calls) == len(found) == 2


def test_a_solver_that_fails_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any, **__: Any) -> Any:
        raise NumericalError("the time-optimal move did not converge (Restoration_Failed); do so")

    monkeypatch.setattr(physical_limit, "physical_limit", fails)
    found = limit_of(Move(PlantRecipe(), "angle", 0.4, 0.6))
    assert math.isnan(found.value)
    assert found.reason == "the time-optimal move did not converge (Restoration_Failed)"

    def breaks(*_: Any, **__: Any) -> Any:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(physical_limit, "physical_limit", breaks)
    assert "ZeroDivisionError: by nothing" in limit_of(Move(PlantRecipe(), "a", 0.4, 0.6)).reason


def record(*settled: Value, seed: int = 1, reason: str = "") -> Record:
    ends = (0.4, 0.6, 0.4, 0.8)
    steps = tuple(
        StepResponse("angle", float(i), ends[i], ends[i + 1], s) for i, s in enumerate(settled)
    )
    metrics = None if reason else Metrics("pid", "nominal", "step", ())
    return Record("pid", "nominal", "step", seed, reason, metrics, steps=steps)


def limits_of(study: Study, *seconds: Value) -> dict[Move, Value]:
    ends = (0.4, 0.6, 0.4, 0.8)
    return {Move(study.plant, "angle", ends[i], ends[i + 1]): s for i, s in enumerate(seconds)}


def test_the_worst_step_and_seed_count(tmp_path: Path) -> None:
    study = asking(tmp_path)
    own = limits_of(study, Value(0.1), Value(0.2), Value(0.1))
    records = [
        record(Value(0.2), Value(0.3), Value(0.15)),
        record(Value(0.2), Value(0.8), Value(0.15), seed=2),
    ]
    found = distances(study, records, own)
    worst = found.worst[0]
    assert worst is not None and worst.ratio == Value(4.0)
    assert worst.worst is not None and (worst.worst.seed, worst.worst.begin) == (2, 1.0)
    assert len(found.steps) == 6


def test_a_step_that_never_settles_is_the_worst(tmp_path: Path) -> None:
    study = asking(tmp_path)
    own = limits_of(study, Value(0.1), Value(0.2), Value(0.1))
    never = Value(math.nan, "not within 2 % of the step by the end of the record")
    worst = distances(study, [record(Value(0.2), never, Value(9.0))], own).worst[0]
    assert worst is not None and math.isnan(worst.ratio.value) and worst.ratio == never


def test_a_step_without_a_limit_says_nothing_about_the_controller(tmp_path: Path) -> None:
    study = asking(tmp_path)
    gone = Value(math.nan, "the time-optimal move did not converge")
    own = limits_of(study, Value(0.1), gone, gone)
    records = [record(Value(0.2), Value(0.3), Value(0.4))]
    worst = distances(study, records, own).worst[0]
    assert worst is not None and worst.ratio == Value(2.0)
    none = distances(study, records, dict.fromkeys(own, gone)).worst[0]
    assert none is not None and none.ratio == gone and none.worst is None


def test_a_failed_run_has_no_distance(tmp_path: Path) -> None:
    study = asking(tmp_path)
    found = distances(study, [record(reason="diverged at 0.2 s")], limits_of(study, Value(0.1)))
    worst = found.worst[0]
    assert worst is not None and worst.ratio.reason == "the run failed: diverged at 0.2 s"


def test_settled_steps_come_back_from_a_table() -> None:
    first = record(Value(0.2), Value(math.nan, "not settled"))
    again = record_from_table(json.loads(json.dumps(first.table())))
    assert again.steps[0] == first.steps[0] and again.steps[1].settling.reason == "not settled"
    assert math.isnan(again.steps[1].settling.value)
    old = {key: value for key, value in first.table().items() if key != "steps"}
    assert record_from_table(old).steps == ()


@pytest.mark.system
def test_the_real_limit_is_below_what_the_controller_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    coarse = partial(physical_limit.physical_limit, intervals=16, degree=2)
    monkeypatch.setattr(physical_limit, "physical_limit", coarse)
    study = asking(tmp_path)
    study = replace(study, variations={"nominal": study.nominal()})
    outcome = run_study(study, tmp_path / "out")
    (step,) = outcome.distances.steps
    # The move of this plant takes a tenth of a second; no loop is faster than that.
    assert 0.05 < step.limit.value < 0.2
    assert 1.0 < step.ratio.value < 10.0
