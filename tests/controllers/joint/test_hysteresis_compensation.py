"""Compensation by a fitted law: the loss is known along the plan, and nothing is paid twice."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers.arithmetic import FLOATS
from controllers.joint.hysteresis_compensation import (
    HysteresisCompensation,
    hysteresis_compensation,
)
from controllers.joint.schedule import JointSchedule
from controllers.pid import CascadePID, ScheduledPIDSpecification, design_scheduled_pid
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.verification import Scenario, Sine, verify


def test_turning_follows_dahls_law() -> None:
    law = HysteresisCompensation(10.0, 7e-5, 5e-4, 0.03, 7.6e-5)
    turn, speed, h = 0.0, 0.05, 1e-4
    for _ in range(2000):
        turn = law.turned(turn, speed, h, FLOATS)
    # z = 1 - exp(-way / breakaway)
    way = 0.03 * speed * 2000 * h
    assert turn == pytest.approx(1.0 - math.exp(-way / 5e-4), abs=2e-3)
    for _ in range(100_000):
        turn = law.turned(turn, -1e3, h, FLOATS)
    assert -1.0 <= turn < -0.999


def test_a_slow_sine_is_followed_better(
    schedule: JointSchedule, plant_with_hysteresis: Model
) -> None:
    # weak integral action, so that the hysteresis is seen at all
    plain = replace(
        design_scheduled_pid(schedule, ScheduledPIDSpecification(frequency=15.0)), compensation=0.0
    )
    # a fit that is 20 % off
    fitted = {
        "muscle_hysteresis.level": 8.0,
        "muscle_hysteresis.level_per_pressure": 5.6e-5,
        "muscle_hysteresis.breakaway": 6e-4,
    }
    torque = 0.466 * schedule.at(math.radians(30), 3.8e5).b
    own = hysteresis_compensation(fitted, torque_per_difference=torque)
    helped = replace(plain, tracking=replace(plain.tracking, hysteresis=own))
    sine = Scenario("s", {"angle": Sine(math.radians(30), math.radians(15), 0.5)}, 4.0, settle=0.3)

    def error(law: CascadePID) -> float:
        run = verify(law, plant_with_hysteresis, sine)
        late = run.time > 1.0
        return float(np.sqrt(np.mean((run.references["angle"] - run["angle"])[late] ** 2)))

    assert error(helped) < 0.5 * error(plain)


def test_a_missing_parameter_is_named() -> None:
    with pytest.raises(WorkbenchError, match=r"muscle_hysteresis\.level_per_pressure"):
        hysteresis_compensation({"muscle_hysteresis.level": 1.0}, torque_per_difference=7e-5)
