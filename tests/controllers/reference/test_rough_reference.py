"""A reference that is quantised, held or noisy is followed along what a filter knows of it."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from controllers.arithmetic import FLOATS, SYMBOLS
from controllers.joint.schedule import JointSchedule
from controllers.pid import ScheduledPIDSpecification, design_scheduled_pid
from controllers.reference.planned import PlannerState
from tests.controllers.reference.test_planned import PLANNER, planned
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.verification import Recorded, Run, Scenario, verify

H, DEG = 0.002, math.pi / 180.0
TIME = np.arange(0.0, 2.0, H)
SINE = 30.0 * DEG + 20.0 * DEG * np.sin(math.pi * TIME)
LSB = 60.0 * DEG / 4096
ROUGH = replace(PLANNER, bandwidth=40.0)


def quantised(values: np.ndarray) -> np.ndarray:
    return np.round(values / LSB) * LSB


def test_derivatives_of_a_quantised_sine_are_those_of_the_sine() -> None:
    angle, speed, acceleration, jerk = planned(quantised(SINE), ROUGH)[500:].T
    w, size = math.pi, 20.0 * DEG
    phase = w * TIME[500:]
    # An error of (v / w)^3 for the filter, and of some steps of the converter times its poles.
    late = (w / 40.0) ** 3 * size
    assert np.abs(angle - SINE[500:]).max() < 2 * late + LSB
    assert np.abs(speed - size * w * np.cos(phase)).max() < 3 * 40.0 * LSB + 3 * late * 40.0
    assert np.abs(acceleration + size * w**2 * np.sin(phase)).max() < 1.0
    assert np.abs(jerk).max() < 60.0
    # By differences nothing of that is left.
    assert np.abs(planned(quantised(SINE))[500:, 2]).max() > 30.0


def test_a_step_is_the_same_move() -> None:
    step = np.where(TIME < 0.1, 0.3, 0.6)
    for with_filter, without in zip(planned(step, ROUGH).T, planned(step).T, strict=True):
        np.testing.assert_allclose(with_filter, without, atol=1e-9 * np.abs(without).max())


def test_symbols_do_the_same() -> None:
    state, r = ca.SX.sym("state", 8), ca.SX.sym("r")
    plan, following = ROUGH.plan(PlannerState(*ca.vertsplit(state)), r, SYMBOLS)
    step = ca.Function("step", [state, r], [ca.vcat(plan), ca.vcat(following)])
    memory = ROUGH.start(0.3)
    for value in (0.3, 0.301, 0.5, 0.5003, 0.5, 0.2):
        for _ in range(5):
            by_symbols = step(np.array(memory), value)
            own, memory = ROUGH.plan(memory, value, FLOATS)
            np.testing.assert_allclose(by_symbols[0].full().ravel(), own, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(by_symbols[1].full().ravel(), memory, rtol=1e-9, atol=1e-12)


def test_sine_of_twelve_bits_is_followed_with_a_quiet_valve(
    schedule: JointSchedule, plant: Model
) -> None:
    def followed(values: np.ndarray, bandwidth: float) -> tuple[float, float]:
        law = design_scheduled_pid(
            schedule, ScheduledPIDSpecification(reference_bandwidth=bandwidth)
        )
        played = Recorded(tuple(TIME.tolist()), tuple(values.tolist()))
        scenario = Scenario("sine", {"angle": played}, TIME[-1], start={"angle": 30.0 * DEG})
        run: Run = verify(law, plant, scenario)
        count = run.time > 1.0
        error = np.abs(run["angle"] - np.interp(run.time, TIME, SINE))[count].max()
        return float(error), float(np.abs(np.diff(run["valve"][count])).sum())

    _, ideal = followed(SINE, 0.0)
    error, travel = followed(quantised(SINE), 40.0)
    assert error < 0.1 * DEG
    assert travel < 1.5 * ideal
    # Without the filter the valve hammers, ten times as much and more.
    assert followed(quantised(SINE), 0.0)[1] > 10.0 * ideal


def test_refusals() -> None:
    with pytest.raises(WorkbenchError, match="bandwidth of the reference filter"):
        replace(PLANNER, bandwidth=1e4)
    with pytest.raises(WorkbenchError, match="jump of a rough reference"):
        replace(PLANNER, jump=0.0)
