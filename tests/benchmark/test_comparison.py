"""The comparison on a part of its runs: figures, tables, page and results."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from workbench.benchmark.cases import BEGIN, HOLD, STEPS_DEG, Case, changes_at_rest, scenarios
from workbench.benchmark.designs import design
from workbench.benchmark.figures_of_run import SIZES_DEG, step_figures, worst_of_all
from workbench.benchmark.page import missed_table, write_comparison
from workbench.benchmark.run import Comparison, compare_controllers
from workbench.benchmark.table import comparison_table, figures_of, ratio_to_limit
from workbench.verification.responses import Figure

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
    limited = replace(comparison, limits={(CASE.name, size): Figure(0.1) for size in SIZES_DEG})
    own = limited.figures["cascade PID", CASE.name, "nominal"]
    ratio = ratio_to_limit(limited, CASE.name, own, 15)
    assert ratio.value == pytest.approx(own["settling_limited_15_s"].value / 0.1)
    slow = replace(comparison, limits={(CASE.name, size): Figure(0.01) for size in SIZES_DEG})
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

        def __getitem__(self, name: str) -> np.ndarray:
            return late

    figures = step_figures(Made())  # type: ignore[arg-type]
    for size in SIZES_DEG:
        assert figures[f"settling_{size}_s"].value == pytest.approx(0.1, abs=0.003)
        assert figures[f"overshoot_{size}_percent"].value == pytest.approx(0.0, abs=1e-9)


def test_worst_is_worst() -> None:
    missing = Figure(math.nan, "not settled")
    found = worst_of_all([{"a": Figure(1.0), "b": missing}, {"a": Figure(2.0), "b": Figure(1.0)}])
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
