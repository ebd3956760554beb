"""The comparison on a part of its runs: figures, tables, page and results."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from workbench.benchmark.cases import (
    BEGIN,
    CASES,
    FRESH_CASES,
    FRESH_VARIATIONS,
    HOLD,
    OTHER_STEPS_DEG,
    STEPS_DEG,
    VARIATIONS,
    Case,
    changes_at_rest,
    scenarios,
    varied_plant,
)
from workbench.benchmark.designs import available_families, design
from workbench.benchmark.evidence import DRY, EVIDENCE_FAMILY, EXACT, SWIFT
from workbench.benchmark.figures_of_run import SIZES_DEG, step_figures, worst_of_all
from workbench.benchmark.obstacles import obstacle_words, obstacles_table
from workbench.benchmark.page import missed_table, write_comparison
from workbench.benchmark.run import Comparison, compare_controllers
from workbench.benchmark.table import comparison_table, figures_of, ratio_to_limit
from workbench.verification.responses import Value

CASE = Case(3.0)


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return compare_controllers(
        families=("cascade PID",), cases=(CASE,), variations=("nominal",), limits=False, jobs=1
    )


def test_the_staircase_has_every_size_in_both_directions() -> None:
    steps = np.diff(STEPS_DEG)
    for size in SIZES_DEG:
        assert {-size, size} <= set(steps.tolist())
    assert set(np.abs(steps)) == set(SIZES_DEG)
    assert (min(STEPS_DEG), max(STEPS_DEG)) == (5.0, 55.0)
    assert scenarios("valve 0.15 V")[0].disturbances[0].level == 0.15
    assert changes_at_rest(Case(8.0)).changes[0].value == 7.0


def test_goals_are_reached_with_3_kg(comparison: Comparison) -> None:
    found = figures_of(comparison, "cascade PID", CASE.name, nominal=True)
    assert found["settling_15_s"].value <= 0.5
    assert found["overshoot_percent"].value <= 5.0
    assert found["steady_deg"].value <= 0.05
    assert found["swing_deg"].value <= 0.05
    assert found["rmse_0.2_Hz_deg"].value <= 0.3
    assert found["rmse_0.5_Hz_deg"].value <= 0.6
    assert found["rmse_1_Hz_deg"].value <= 1.5
    assert found["stop_impacts"].value == 0.0
    # without a physical limit there is no ratio, and it says so
    assert math.isnan(found["ratio_15"].value)
    assert "limit" in found["ratio_15"].reason


def test_ratio_and_missed_goals(comparison: Comparison) -> None:
    limited = replace(comparison, limits={(CASE.name, size): Value(0.1) for size in SIZES_DEG})
    own = limited.figures["cascade PID", CASE.name, "nominal"]
    ratio = ratio_to_limit(limited, CASE.name, own, 15)
    assert ratio.value == pytest.approx(own["settling_limited_15_s"].value / 0.1)
    slow = replace(comparison, limits={(CASE.name, size): Value(0.01) for size in SIZES_DEG})
    assert "settling 15° / limit" in str(missed_table(slow))
    assert "✗" in str(comparison_table(slow, nominal=True))


def test_figures_take_the_worst_step() -> None:
    count = len(STEPS_DEG) - 1
    time = np.arange(round((BEGIN + HOLD * count) / 0.002)) * 0.002
    index = np.clip(((time - BEGIN) // HOLD).astype(int) + 1, 0, count)
    reference = np.radians(np.array(STEPS_DEG)[np.where(time < BEGIN - 1e-9, 0, index)])
    late = np.roll(reference, 50)
    late[:50] = reference[0]

    class Made:
        def __init__(self) -> None:
            self.time, self.references = time, {"angle": reference}
            self.scenario = scenarios("nominal")[0]

        def __getitem__(self, name: str) -> np.ndarray:
            return late

    figures = step_figures(Made())  # type: ignore[arg-type]
    for size in SIZES_DEG:
        assert figures[f"settling_{size}_s"].value == pytest.approx(0.1, abs=0.003)
        assert figures[f"overshoot_{size}_percent"].value == pytest.approx(0.0, abs=1e-9)


def test_fresh_variations_differ_from_the_usual_ones() -> None:
    steps = np.diff(OTHER_STEPS_DEG)
    for size in SIZES_DEG:
        assert {-size, size} <= set(steps.tolist())
    assert set(np.abs(steps)) == set(SIZES_DEG)
    usual = set(pairwise(STEPS_DEG))
    assert not usual & set(pairwise(OTHER_STEPS_DEG))
    assert not {c.load for c in CASES} & {c.load for c in FRESH_CASES}
    assert not set(VARIATIONS) & set(FRESH_VARIATIONS)
    seen = set()
    for variation in (*VARIATIONS, *FRESH_VARIATIONS):
        plant, first = varied_plant(CASE, variation), scenarios(variation)[0]
        offset = tuple(d.level for d in first.disturbances)
        seen.add((plant.values.tobytes(), offset, first.references["angle"].changes))
    assert len(seen) == len(VARIATIONS) + len(FRESH_VARIATIONS)


def test_the_worst_of_several_seeds_counts() -> None:
    def run(seed: int, seeds: int) -> Comparison:
        return compare_controllers(
            families=("cascade PID",),
            cases=(CASE,),
            variations=("nominal",),
            limits=False,
            seed=seed,
            seeds=seeds,
            jobs=1,
        )

    both = run(3, 2)
    own = [run(seed, 1).figures["cascade PID", CASE.name, "nominal"] for seed in (3, 4)]
    found = both.figures["cascade PID", CASE.name, "nominal"]
    for name in ("settling_15_s", "overshoot_percent", "swing_deg"):
        assert found[name].value == max(figures[name].value for figures in own)
    assert own[0]["swing_deg"].value != own[1]["swing_deg"].value
    # sines are run with the first seed
    assert found["rmse_1_Hz_deg"].value == own[0]["rmse_1_Hz_deg"].value


def test_obstacles_are_counted_one_by_one(comparison: Comparison) -> None:
    def settled(value: float) -> dict[str, Value]:
        return {f"settling_{kind}_{s}_s": Value(value) for kind in ("limited", "planned")
                for s in SIZES_DEG}  # fmt: skip

    made = {
        (EVIDENCE_FAMILY, CASE.name, "nominal"): settled(0.30),
        (EVIDENCE_FAMILY, CASE.name, DRY): settled(0.25),
        (EVIDENCE_FAMILY, CASE.name, EXACT): settled(0.24),
        (EVIDENCE_FAMILY, CASE.name, SWIFT): settled(0.21),
    }
    limits = {(CASE.name, 5): Value(0.1), (CASE.name, 15): Value(0.2)}
    some = replace(comparison, figures=made, limits=limits)
    words = obstacle_words(some)
    # 15 degrees are within twice the limit, 30 degrees have none
    assert len(words) == 1
    assert "50 ms" in words[0]
    assert "10 ms" in words[0]
    assert "30 ms" in words[0]
    assert "110 ms" in words[0]
    assert len(obstacles_table(some).rows) == 4


def test_without_slycot_the_family_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "H-infinity" in available_families()
    monkeypatch.setattr("workbench.benchmark.designs.has_slycot", lambda: False)
    assert "H-infinity" not in available_families()


def test_worst_is_worst() -> None:
    missing = Value(math.nan, "not settled")
    found = worst_of_all([{"a": Value(1.0), "b": missing}, {"a": Value(2.0), "b": Value(1.0)}])
    assert found["a"].value == 2.0
    assert found["b"].reason == "not settled"


def test_page_and_results(comparison: Comparison, tmp_path: Path) -> None:
    page = write_comparison(comparison, tmp_path)
    text = page.read_text()
    assert "cascade PID" in text
    assert "<svg" in text
    read = json.loads((tmp_path / "results.json").read_text())
    nominal = read["summary"][CASE.name]["cascade PID"]["nominal"]
    assert nominal["settling_15_s"] < 0.5
    assert read["margins"][f"cascade PID, {CASE.name}"]["Ms"] <= 2.0


def test_a_design_is_reproducible() -> None:
    assert design("cascade PID", CASE).controller == design("cascade PID", CASE).controller
