"""Comparison with a baseline: tolerances, directions, invariants, and what is new or gone."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from workbench.errors import WorkbenchError
from workbench.files import write_whole
from workbench.study.baseline import (
    Baseline,
    Change,
    baseline_text,
    changes,
    read_baseline,
)
from workbench.study.tasks import Record
from workbench.verification import METRICS, Metrics, MetricValue
from workbench.verification.metrics import tolerance_of

TOLERANCES = {name: metric.tolerance for name, metric in METRICS.members().items()}


def record(controller: str = "pid", **values: float) -> Record:
    units = {"settling_time": "s", "rmse": "rad", "stiffness_lowest": "N m/rad"}
    found = tuple(
        MetricValue(n, v, units.get(n, "1"), "it never settles" if math.isnan(v) else "")
        for n, v in values.items()
    )
    return Record(controller, "nominal", "step", 1, "", Metrics(controller, "", "step", found))


def compare(before: Record, after: Record) -> list[Change]:
    # Of a step every 2 ms, of angles around 1 rad.
    sizes = {"settling_time": 2e-3, "rmse": 1.0}
    names = {m for r in (before, after) if r.metrics for m in r.metrics}
    rules = {m: tolerance_of(m).sized(sizes.get(m, 0.0)) for m in names}
    return list(changes(rules, [after], Baseline({before.key: before}, "s", Path("b"))))


def test_within_tolerance_nothing_is_said() -> None:
    assert not compare(record(settling_time=0.400), record(settling_time=0.411))


@pytest.mark.parametrize(("after", "way"), [(0.413, "worse"), (0.387, "better")])
def test_beyond_tolerance(after: float, way: str) -> None:
    # 4 ms and 2 % of 0.4 s are 12 ms.
    (change,) = compare(record(settling_time=0.400), record(settling_time=after))
    assert change.way == way and change.fails == (way == "worse")
    assert change.tolerance == pytest.approx(0.012)


def test_what_only_describes_does_not_fail() -> None:
    (change,) = compare(record(stiffness_lowest=30.0), record(stiffness_lowest=40.0))
    assert change.way == "changed" and not change.fails


def test_a_value_that_is_lost_is_worse_and_one_gained_better() -> None:
    (lost,) = compare(record(settling_time=0.4), record(settling_time=math.nan))
    assert lost.fails and "it never settles" in str(lost)
    (gained,) = compare(record(settling_time=math.nan), record(settling_time=0.4))
    assert gained.way == "better"
    assert not compare(record(settling_time=math.nan), record(settling_time=math.nan))


def test_a_sliding_mode_is_held_to_its_invariants() -> None:
    before = record(surface_rms=0.2, rmse=0.1)
    (worse,) = compare(before, record(surface_rms=0.2, rmse=0.2))
    assert worse.metric == "rmse" and worse.way == "worse" and not worse.fails
    (strays,) = compare(before, record(surface_rms=0.3, rmse=0.1))
    assert strays.metric == "surface_rms" and strays.fails


def test_times_of_computation_are_not_compared() -> None:
    before, after = record(solve_time_p99=1e-4), record(solve_time_p99=1.0)
    assert not compare(before, after)


def test_a_run_that_fails_is_worse_one_that_is_gone_too() -> None:
    good, bad = record(rmse=0.1), Record("pid", "nominal", "step", 1, "diverged")
    (failed,) = compare(good, bad)
    assert failed.fails and "diverged" in str(failed)
    assert [c.way for c in compare(bad, good)] == ["better"]
    other = replace(good, controller="mpc")
    ways = {c.way: c.fails for c in compare(good, other)}
    assert ways == {"new": False, "gone": True}


def test_every_gating_metric_states_a_tolerance() -> None:
    counts = {"stop_impacts", "fallbacks", *(n for n in TOLERANCES if n.startswith("guard_"))}
    own = [r for n, r in TOLERANCES.items() if n not in counts]
    assert all(r.absolute or r.typical or r.relative for r in own)


def test_a_baseline_reads_back(tmp_path: Path) -> None:
    records = [record(rmse=1 / 3, settling_time=math.nan, solve_time_p99=1.0),
               Record("mpc", "nominal", "step", 1, "diverged")]  # fmt: skip
    path = write_whole(tmp_path / "b.json", baseline_text("s", records, {}))
    found = read_baseline(path)
    assert found.study == "s" and len(found.records) == 2
    back = found.records[("pid", "nominal", "step", 1)]
    assert back.metrics is not None and "solve_time_p99" not in back.metrics
    assert back.metrics["rmse"].value == pytest.approx(1 / 3, rel=1e-8)
    assert math.isnan(back.metrics["settling_time"].value)
    assert baseline_text("s", reversed(records), {}) == path.read_text(encoding="utf-8")
    assert "seconds" not in json.loads(path.read_text(encoding="utf-8"))["runs"][0]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("{", "no JSON"),
        ("[]", "it must be a table"),
        ('{"schema": 9, "runs": [], "conditions": {}}', "schema 9"),
        ('{"schema": 2, "runs": []}', "has no 'conditions'"),
        ('{"schema": 2, "runs": [{"controller": "pid"}], "conditions": {}}', "has no 'variation'"),
    ],
)
def test_a_bad_baseline(text: str, word: str, tmp_path: Path) -> None:
    path = tmp_path / "b.json"
    path.write_text(text)
    with pytest.raises(WorkbenchError, match=word):
        read_baseline(path)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ('{"schema": 2, "study": "s", "runs": [], "conditions": {}}', "holds no runs"),
        (baseline_text("other", [record(rmse=1.0)], {}), "is that of study 'other'"),
    ],
)
def test_a_baseline_by_which_all_would_pass_is_refused(
    text: str, word: str, tmp_path: Path
) -> None:
    path = write_whole(tmp_path / "b.json", text)
    with pytest.raises(WorkbenchError, match=word):
        read_baseline(path, of="s")
