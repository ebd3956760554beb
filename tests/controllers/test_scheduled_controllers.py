"""Scheduled controllers on the full plant with hysteresis that no design knows."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from controllers.arithmetic import SYMBOLS
from controllers.joint.schedule import JointSchedule
from controllers.largest_bandwidth import largest_bandwidth
from controllers.mpc.along_plan import design_scheduled_mpc
from controllers.named_state import flat, restored
from controllers.pid import ScheduledPIDSpecification, design_scheduled_pid
from controllers.sensitivity import peak_sensitivities
from controllers.sliding_mode import (
    ScheduledSlidingModeSpecification,
    design_scheduled_sliding_mode,
)
from controllers.state_feedback import design_state_feedback
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.verification import Scenario, Sine, Steps, metrics, verify

DESIGNS: dict[str, Any] = {
    "pid": design_scheduled_pid,
    "super-twisting": design_scheduled_sliding_mode,
    "integral": lambda schedule: design_scheduled_sliding_mode(
        schedule, ScheduledSlidingModeSpecification(kind="integral")
    ),
    "state feedback": design_state_feedback,
    "mpc": design_scheduled_mpc,
}

ANGLES = (20.0, 35.0, 50.0, 20.0)
STEPS = Scenario(
    "steps",
    {"angle": Steps((0.0, 0.1, 0.9, 1.7), tuple(math.radians(a) for a in ANGLES))},
    duration=2.5,
    settle=0.3,
)


@pytest.mark.parametrize("make", DESIGNS.values(), ids=DESIGNS.keys())
def test_steps_settle_fast_without_overshoot(
    make: Any, schedule: JointSchedule, plant_with_hysteresis: Model
) -> None:
    found = metrics(verify(make(schedule), plant_with_hysteresis, STEPS))
    # 30 degrees within 0.4 s, half of what unscheduled designs need
    assert found["settling_time"].value < 0.4
    assert found["overshoot"].value < 0.05
    assert found["steady_error"].value < math.radians(0.05)
    assert found["oscillation"].value < math.radians(0.05)
    if "fallbacks" in found:
        assert found["fallbacks"].value == 0.0


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
    law = DESIGNS[name](schedule)
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


@pytest.mark.parametrize("name", ["pid", "super-twisting", "state feedback"])
def test_symbols_agree_with_floats(name: str, schedule: JointSchedule) -> None:
    law = DESIGNS[name](schedule)
    state = law.initial_state((0.5, 4e5, 4e5))
    z, m, r = ca.SX.sym("z", len(flat(state))), ca.SX.sym("m", 3), ca.SX.sym("r")
    symbols = restored(state, ca.vertsplit(z))
    command, following, _ = law.law(symbols, tuple(ca.vertsplit(m)), (r,), SYMBOLS)
    function = ca.Function("law", [z, m, r], [ca.vcat(command), ca.vcat(flat(following))])
    rng = np.random.default_rng(1)
    for k in range(60):
        measured = (0.5 + 0.1 * math.sin(0.2 * k), *rng.uniform(2e5, 5e5, 2).tolist())
        wanted = (0.5 if k < 20 else 0.7,)
        numbers = function(ca.DM(flat(state)), ca.DM(list(measured)), wanted[0])
        command, state, _ = law.step(state, measured, wanted)
        assert float(numbers[0]) == pytest.approx(command[0], abs=1e-9)
        np.testing.assert_allclose(numbers[1].full().ravel(), flat(state), rtol=1e-9, atol=1e-9)
