"""Scheduled controllers on the full plant with hysteresis that no design knows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from controllers.joint.schedule import JointSchedule
from controllers.largest_bandwidth import largest_bandwidth
from controllers.mpc.along_plan import ScheduledMPCSpecification, design_scheduled_mpc
from controllers.pid import ScheduledPIDSpecification, design_scheduled_pid
from controllers.sensitivity import loop_matrices, peak_sensitivities
from tests.controllers.families import Make, assert_settles, family, moves
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.verification import Scenario, Sine, metrics, verify

DESIGNS = {
    "pid": family("scheduled-pid"),
    "super-twisting": family("scheduled-sliding-mode"),
    "integral": family("scheduled-sliding-mode", kind="integral"),
    "state feedback": family("scheduled-state-feedback"),
    "mpc": family("scheduled-mpc"),
}

STEPS = moves((0.1, 0.9, 1.7), 20, 35, 50, 20, duration=2.5, settle=0.3)


@pytest.mark.parametrize("make", DESIGNS.values(), ids=DESIGNS.keys())
def test_steps_settle_fast_without_overshoot(
    make: Make, schedule: JointSchedule, linear: LinearModel, plant_with_hysteresis: Model
) -> None:
    # 30 degrees within 0.4 s, half of what unscheduled designs need
    assert_settles(make(schedule, linear), plant_with_hysteresis, STEPS, 0.4)


def test_a_sine_at_1_hz_is_followed(schedule: JointSchedule, plant_with_hysteresis: Model) -> None:
    sine = Scenario(
        "sine", {"angle": Sine(math.radians(30), math.radians(15), 1.0)}, 2.0, settle=0.3
    )
    run = verify(design_scheduled_pid(schedule), plant_with_hysteresis, sine)
    error = np.degrees(run.references["angle"] - run["angle"])[run.time > 0.5]
    assert math.sqrt(float(np.mean(error**2))) < 0.5


@pytest.mark.parametrize("name", ["pid", "state feedback", "mpc"])
def test_the_same_object_runs_on_the_linear_model(
    name: str, schedule: JointSchedule, linear_by_opening: LinearModel
) -> None:
    law = DESIGNS[name](schedule, linear_by_opening)
    run = verify(law, linear_by_opening, STEPS.without_imperfections())
    assert metrics(run)["steady_error"].value < math.radians(0.05)
    ms, mt = peak_sensitivities(law, linear_by_opening)
    assert ms < 2.5
    assert mt < 2.5


def test_the_fastest_design_keeps_its_margins(
    schedule: JointSchedule, linear_by_opening: LinearModel
) -> None:
    def design(frequency: float) -> Any:
        return design_scheduled_pid(schedule, ScheduledPIDSpecification(frequency=frequency))

    found = largest_bandwidth(design, [linear_by_opening], [60.0, 40.0, 25.0, 20.0])
    assert found.sensitivity <= 2.0
    assert found.speed < 60.0
    with pytest.raises(WorkbenchError, match="no speed from 60 to 60"):
        largest_bandwidth(design, [linear_by_opening], [60.0])


def test_an_mpc_that_weighs_speed_damps_what_swings(
    schedule: JointSchedule, linear: LinearModel
) -> None:
    def least_damping(weight: float) -> float:
        want = ScheduledMPCSpecification(radius=9.0, prediction_time=0.02, damping=weight)
        A, B, C, F, G, H, J = loop_matrices(design_scheduled_mpc(schedule, want), linear)
        closed = np.linalg.eigvals(np.block([[A + B @ J @ C, B @ H], [G @ C, F]]))
        poles = np.log(closed[np.abs(closed) > 1e-9]) / want.sample_time
        swinging = poles[(np.abs(poles.imag) > 5.0) & (np.abs(poles) < 30.0)]
        return float(np.min(-swinging.real / np.abs(swinging)))

    assert least_damping(2.0) > 1.4 * least_damping(0.0) > 0.0
