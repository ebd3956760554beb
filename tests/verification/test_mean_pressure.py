"""The predicted mean pressure against closed loops on the full plant."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers.pid import design_pid
from controllers.protocol import Controller
from workbench.errors import WorkbenchError
from workbench.linearisation import linearise
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.physics.hysteresis import bouc_wen_hysteresis
from workbench.plants.arm import arm
from workbench.plants.arm.two_valves import two_valve_arm
from workbench.verification import Run, Scenario, Sine, verify
from workbench.verification.mean_pressure import mean_pressure, mean_pressure_bounds

BOX = {"centre_leakage.fraction": (0.002, 0.01), "supply_pressure": (5.7e5, 6.3e5)}


@pytest.fixture(scope="module")
def plant() -> Model:
    return arm(3)


@pytest.fixture(scope="module")
def pid(plant: Model) -> Controller:
    point = operating_point(plant, {"angle": math.radians(30)})
    return design_pid(linearise(point, verdict=False))


def sine(controller: Controller, plant: Model) -> Run:
    motion = Sine(math.radians(30), math.radians(15), 0.5)
    return verify(
        controller, plant, Scenario("sine", {"angle": motion}, 2.5).without_imperfections()
    )


def measured(run: Run) -> np.ndarray:
    return np.asarray(0.5 * (run["pressure_1"] + run["pressure_2"]))


def test_the_prediction_is_what_a_closed_loop_does(plant: Model, pid: Controller) -> None:
    run = sine(pid, plant)
    mean = measured(run)
    begin = 100
    found = mean_pressure(plant, run.time[begin:], run["angle"][begin:], start=mean[begin])
    moved = np.ptp(mean[begin:])
    assert moved > 0.02e5
    # It starts from temperatures at rest and neglects the spool's 3 ms.
    assert np.abs(found.mean - mean[begin:]).max() < 0.008e5
    difference = (run["pressure_1"] - run["pressure_2"])[begin:]
    assert np.abs(found.difference - difference)[5:].max() < 0.05e5
    assert found.within_reach


def test_bounds_hold_for_plants_inside_the_box(plant: Model, pid: Controller) -> None:
    time = 0.002 * np.arange(1250)
    wanted = Sine(math.radians(30), math.radians(15), 0.5).sample(time)
    bounds = mean_pressure_bounds(plant, time, wanted, BOX)
    assert bounds.corners == 5
    rough = plant.with_effect(bouc_wen_hysteresis(level=10.0, level_per_pressure=7e-5))
    for leakage, supply in ((0.003, 6.2e5), (0.008, 5.8e5)):
        values = {"centre_leakage.fraction": leakage, "supply_pressure": supply}
        mean = measured(sine(pid, rough.with_parameters(values)))
        assert np.all(mean >= bounds.lowest - 0.05e5)
        assert np.all(mean <= bounds.highest + 0.05e5)
    # A bound that held everything would say nothing.
    assert np.max(bounds.highest - bounds.lowest) < 1.0e5


def test_a_mean_that_leakage_does_not_hold_drifts_towards_the_one_it_holds(plant: Model) -> None:
    time = 0.01 * np.arange(3000)
    angle = np.full(time.size, math.radians(30))
    rest = operating_point(plant, {"angle": math.radians(30)})
    held = 0.5 * (rest["pressure_1"] + rest["pressure_2"])
    found = mean_pressure(plant, time, angle, start=3e5)
    assert np.all(np.diff(found.mean)[200:] > 0.0)
    assert abs(found.mean[-1] - held) < 0.6 * abs(3e5 - held)
    # The rate at the start is that of the drifting operating point.
    drifting = operating_point(plant, {"angle": math.radians(30)}, mean_pressure=3e5)
    rate = np.mean(list(drifting.drift.values()))
    assert (found.mean[20] - found.mean[0]) / 0.2 == pytest.approx(rate, rel=0.1)


def test_a_motion_too_fast_for_the_valve_is_said(plant: Model) -> None:
    time = 0.002 * np.arange(100)
    s = np.clip(time / 0.12, 0.0, 1.0)
    angle = math.radians(20) + math.radians(30) * s**3 * (10 - 15 * s + 6 * s**2)
    assert not mean_pressure(plant, time, angle).within_reach


def test_wrong_arguments_are_named(plant: Model) -> None:
    time = 0.002 * np.arange(20)
    with pytest.raises(WorkbenchError, match="evenly spaced"):
        mean_pressure(plant, time**2, np.full(20, 0.5))
    with pytest.raises(WorkbenchError, match="20 times and 3 angles"):
        mean_pressure(plant, time, [0.5, 0.5, 0.5])
    with pytest.raises(WorkbenchError, match="spool"):
        mean_pressure(two_valve_arm(3), time, np.full(20, 0.5))
    with pytest.raises(WorkbenchError, match="at most eight"):
        names = [q.name for q in plant.parameters[:9]]
        mean_pressure_bounds(plant, time, np.full(20, 0.5), dict.fromkeys(names, (0.0, 1.0)))
