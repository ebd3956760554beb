"""Metrics and requirements of runs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from controllers import design_mpc, design_pid
from tests.machines import at_rest, machine
from tests.verification.scripted import Scripted
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.plants.arm import arm
from workbench.verification import (
    Change,
    Requirement,
    Run,
    Scenario,
    Sine,
    Steps,
    judge,
    metrics,
    verify,
)

STEP = Scenario(
    "step", {"angle": Steps((0.0, 0.2), (math.radians(20), math.radians(35)))}, duration=1.5
)


@pytest.fixture(scope="module")
def plant() -> Model:
    return arm(load_kg=3)


@pytest.fixture(scope="module")
def linear(plant: Model) -> LinearModel:
    return at_rest(plant, angle=math.radians(30))


@pytest.fixture(scope="module")
def run(plant: Model, linear: LinearModel) -> Run:
    return verify(design_pid(linear), plant, STEP)


def test_air_is_what_left_through_the_supply(run: Run, plant: Model) -> None:
    found = metrics(run)["air"]
    # An independent route: what came in is what is in the muscles more, plus what went out.
    h = run.scenario.sample_time
    volume = [run[f"chamber_{i}.volume"] for i in (1, 2)]
    pressure = [
        run.states[:, [q.name for q in plant.states].index(f"pressure_{i}")] for i in (1, 2)
    ]
    warmth = [run[f"temperature_{i}"] for i in (1, 2)]
    mass = sum(p * v / (287.05 * t) for p, v, t in zip(pressure, volume, warmth, strict=True))
    out = sum(np.sum(run[f"exhaust_{i}.flow"]) * h for i in (1, 2))
    # Sums over held samples are first order in the sample time.
    assert found.value == pytest.approx(float(mass[-1] - mass[0] + out), rel=0.02)
    assert found.shown()[1] == "g"


def test_stiffness_is_the_slope_of_the_torque(run: Run, plant: Model) -> None:
    from workbench.verification.joint_metrics import joint_stiffness

    k = 400
    at = [q.name for q in plant.states].index("angle")
    torque = []
    for moved in (-1e-5, 1e-5):
        x = run.states[k].copy()
        x[at] += moved
        torque.append(plant.signals(x, run.inputs[k])["joint.torque"])
    slope = -(torque[1] - torque[0]) / 2e-5
    assert joint_stiffness(run)[k] == pytest.approx(slope, rel=1e-5)


def test_worst_step_counts(plant: Model, linear: LinearModel) -> None:
    # The second step comes too soon for the first to settle.
    angles = tuple(math.radians(a) for a in (20.0, 35.0, 20.0))
    hasty = Scenario("hasty", {"angle": Steps((0.0, 0.2, 0.3), angles)}, duration=2.0)
    found = metrics(verify(design_pid(linear), plant, hasty))["settling_time"]
    assert math.isnan(found.value)
    assert "2 % of the step" in str(found)


def test_what_rests_is_judged_where_others_have_arrived() -> None:
    """A short run: at its middle, too, something steps and moves what rests for 20 ms."""
    plant = machine(
        lambda m: ({"x": (m.u.u - m.x.x) / 4e-3}, {"y": m.x.x, "moved": m.u.u - m.x.x}),
        "x K",
        "u K -10 10",
        "y K, moved K",
    )
    steps = {"y": Steps((0.0, 0.1, 0.3), (0.0, 1.0, 0.0)), "moved": Steps((0.0,), (0.0,))}
    given = (*[0.0] * 50, *[1.0] * 100, *[0.0] * 100)
    held = Scripted(given, controlled=("y", "moved"), actuators=("u",))
    run = verify(held, plant, Scenario("short", steps, 0.5, start={"y": 0.0}, settle=0.0))
    assert metrics(run)["moved.steady_error"].value < 1e-4


@pytest.mark.parametrize("at", [1.0, 0.9])
def test_what_never_settles_beside_a_command_at_its_limit_says_so(at: float) -> None:
    slow = machine(lambda m: ({"x": m.u.u - m.x.x}, {"y": m.x.x}), "x K", "u K -1 1", "y K")
    held = Scripted((*[0.0] * 50, *[at] * 450), controlled=("y",), actuators=("u",))
    asked = Scenario("far", {"y": Steps((0.0, 0.1), (0.0, 2.0))}, 1.0, start={"y": 0.0}, settle=0.0)
    told = metrics(verify(held, slow, asked))["settling_time"].reason
    assert ("u is still at the limit" in told) == (at == 1.0)


def test_sine_has_no_step_figures(plant: Model, linear: LinearModel) -> None:
    wave = Sine(math.radians(30), math.radians(5), 1.0)
    found = metrics(verify(design_pid(linear), plant, Scenario("sine", {"angle": wave}, 1.0)))
    for name in ("settling_time", "overshoot", "steady_error", "oscillation"):
        assert math.isnan(found[name].value)
        assert found[name].reason
    assert 0.0 < found["rmse"].value < math.radians(5)


def test_open_loop_run_into_the_stop_is_counted(plant: Model) -> None:
    held = Scripted((7.0,))
    found = metrics(verify(held, plant, replace(STEP, settle=0.0)))
    assert found["stop_impacts"].value >= 1.0
    assert found["stop_peak_torque"].value > 10.0


def test_solver_figures_belong_to_solvers(run: Run, plant: Model, linear: LinearModel) -> None:
    assert "fallbacks" not in metrics(run)
    solved = metrics(verify(design_mpc(linear), plant, replace(STEP, duration=0.4)))
    assert solved["fallbacks"].value == 0.0
    assert solved["solve_time_p99"].value > 0.0


def test_linear_model_has_no_air(linear: LinearModel) -> None:
    found = metrics(verify(design_pid(linear), linear, STEP))
    assert "air" not in found
    assert "stop_impacts" not in found


def test_load_change_is_followed_by_the_signals(plant: Model, linear: LinearModel) -> None:
    heavier = replace(STEP, changes=(Change(0.8, "load", 5.0),))
    inertia = verify(design_pid(linear), plant, heavier)["joint.inertia"]
    # Added: 2 kg at (0.367^2 + 0.024^2 + 0.0015) m2 per kg.
    assert inertia[-1] - inertia[0] == pytest.approx(2 * (0.367**2 + 0.024**2 + 0.0015))


def test_table_is_aligned(run: Run) -> None:
    lines = str(metrics(run)).splitlines()
    assert lines[0] == "cascade PID on arm, step"
    assert any(line.startswith("  steady_error") and line.endswith("deg") for line in lines)
    starts = {len(line[:37].rstrip()) for line in lines[1:]}
    assert starts == {37}


def test_requirements_are_scored_in_their_unit(run: Run) -> None:
    measured = metrics(run)
    verdict = judge(Requirement("overshoot", 5.0, unit="%"), measured)
    assert verdict.score == pytest.approx(measured["overshoot"].value / 0.05)
    assert verdict.met
    firm = judge(Requirement("stiffness_lowest", 10.0, kind="at_least"), measured)
    assert firm.score == pytest.approx(10.0 / measured["stiffness_lowest"].value)


def test_what_has_no_value_is_never_met(linear: LinearModel) -> None:
    resting = replace(STEP, references={"angle": Sine(0.5, 0.01, 1.0)})
    measured = metrics(verify(design_pid(linear), linear, resting))
    verdict = judge(Requirement("settling_time", 1.0, unit="s"), measured)
    assert verdict.score == math.inf
    assert not verdict.met
    assert "no step" in verdict.reason


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"limit": -1}, "positive"),
        ({"limit": 1, "kind": "at_mots"}, "did you mean 'at_most'"),
        ({"limit": math.nan}, "not finite"),
    ],
)
def test_bad_requirements_are_refused(given: dict[str, Any], problem: str) -> None:
    with pytest.raises(WorkbenchError, match=problem):
        Requirement("rmse", **given)


def test_unknown_metric_is_named(run: Run) -> None:
    with pytest.raises(WorkbenchError, match="did you mean 'overshoot'"):
        judge(Requirement("overshot", 1.0), metrics(run))
