"""Tuning of a specification on the full plant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import pytest

from controllers.pid import CascadePID, PIDSpecification, design_pid
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel, linearise
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.physics.hysteresis import bouc_wen_hysteresis
from workbench.plants.arm import arm
from workbench.verification import Requirement, step_scenario
from workbench.verification.tuning import Tuning, tune, variations

BOX = {
    "load": (2.0, 4.0),
    "supply_pressure": (5e5, 6e5),
    "valve_centre": (4.9, 5.1),
    "muscle_hysteresis.level": (5.0, 15.0),
}
VARIABLES = {"reference_speed": (8.0, 60.0), "inner_bandwidth": (60.0, 160.0)}
START = {"reference_speed": 10.0, "inner_bandwidth": 80.0}
REQUIREMENTS = (
    Requirement("settling_time", 0.5, unit="s"),
    Requirement("overshoot", 5.0, unit="%"),
    Requirement("steady_error", 0.05, unit="deg"),
)


@pytest.fixture(scope="module")
def rough() -> Model:
    return arm(3).with_effect(bouc_wen_hysteresis(level=10.0, level_per_pressure=7e-5))


@pytest.fixture(scope="module")
def linear_at_30() -> LinearModel:
    return linearise(operating_point(arm(3), {"angle": math.radians(30)}), verdict=False)


def design(linear: LinearModel, values: Mapping[str, float]) -> CascadePID:
    return design_pid(linear, PIDSpecification(**values))


def tuned(rough: Model, linear: LinearModel, *, jobs: int, seed: int = 1) -> Tuning:
    return tune(
        partial(design, linear),
        VARIABLES,
        rough,
        [step_scenario(from_deg=20, to_deg=35, hold=1.0)],
        REQUIREMENTS,
        start=START,
        plants=variations(rough, BOX, draws=2, seed=3),
        evaluations=8,
        seed=seed,
        jobs=jobs,
    )


def test_the_worst_score_is_lowered_and_repeatable(rough: Model, linear_at_30: LinearModel) -> None:
    first = tuned(rough, linear_at_30, jobs=1)
    # A reference filter of 10 rad/s settles in 0.6 s at best.
    assert first.start.worst > 1.1
    assert first.best.worst < 1.0
    assert first.best.objective == min(c.objective for c in first.history)
    assert len(first.history) == 8
    assert all(
        low <= c.values[name] <= high
        for c in first.history
        for name, (low, high) in VARIABLES.items()
    )
    assert max(v.score for v in first.verdicts) == pytest.approx(first.best.worst)
    # The same numbers from two processes.
    again = tuned(rough, linear_at_30, jobs=2)
    assert [c.values for c in again.history] == [c.values for c in first.history]
    assert again.best.objective == pytest.approx(first.best.objective, rel=1e-12)
    assert "worst score" in str(first) and "reference_speed" in str(first)


def test_variations_fill_the_box(rough: Model) -> None:
    drawn = variations(rough, BOX, draws=10, seed=2)
    assert drawn == variations(rough, BOX, draws=10, seed=2)
    assert drawn != variations(rough, BOX, draws=10, seed=4)
    assert drawn[0]["load"] == 3.0
    for name, (low, high) in BOX.items():
        # One draw in each tenth of the range
        tenths = sorted(int(10 * (v[name] - low) / (high - low)) for v in drawn[1:])
        assert tenths == list(range(10))
    with pytest.raises(WorkbenchError, match="valid range"):
        variations(rough, {"load": (0.0, 20.0)})


def test_a_design_that_does_not_exist_only_scores_badly(rough: Model) -> None:
    def refuse(values: Mapping[str, float]) -> CascadePID:
        if values["gain"] > 2.0:
            raise WorkbenchError("no such controller")
        return CascadePID(4e6, 2e7, 2e5, inner=2.5e-6 * values["gain"])

    found = tune(
        refuse,
        {"gain": (0.5, 8.0)},
        rough,
        [step_scenario(from_deg=20, to_deg=25, hold=0.5)],
        [Requirement("rmse", 1.0, unit="deg")],
        start={"gain": 1.9},
        evaluations=5,
        seed=3,
    )
    assert found.best.worst < 100.0
    assert any(c.worst == 1000.0 for c in found.history)


def test_wrong_arguments_are_named(rough: Model, linear_at_30: LinearModel) -> None:
    build = partial(design, linear_at_30)
    scenario = step_scenario(from_deg=20, to_deg=35)
    with pytest.raises(WorkbenchError, match="start of reference_speed"):
        tune(
            build, VARIABLES, rough, [scenario], REQUIREMENTS, start=START | {"reference_speed": 1}
        )
    with pytest.raises(WorkbenchError, match="no hard requirement"):
        tune(build, VARIABLES, rough, [scenario], [], start=START)
    with pytest.raises(WorkbenchError, match="variable is 'bandwith'"):
        tune(build, VARIABLES, rough, [scenario], REQUIREMENTS, start=START | {"bandwith": 1.0})
    with pytest.raises(WorkbenchError, match="0 scenarios"):
        tune(build, VARIABLES, rough, [], REQUIREMENTS, start=START)
