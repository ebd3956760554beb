"""What a front end knows of the valve: the opening that holds, and where the centre is."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from controllers.arithmetic import FLOATS
from controllers.joint.hysteresis_compensation import HysteresisCompensation
from controllers.joint.learning import MotionLearning
from controllers.joint.schedule import JointSchedule
from controllers.state_feedback import StateFeedbackSpecification, design_state_feedback
from workbench.model import Model
from workbench.physics.offset_gain import valve_offset
from workbench.verification import step_scenario, verify


def law(schedule: JointSchedule, **numbers: Any) -> Any:
    return design_state_feedback(schedule, StateFeedbackSpecification(radius=12.0, **numbers))


def test_a_valve_that_leaks_is_held_open_by_the_feedforward(schedule: JointSchedule) -> None:
    # At 30 degrees the muscles are alike; away from there the leak of the one is larger.
    middle, above, below = (schedule.at(math.radians(a), 3.8e5).opening for a in (30.0, 50.0, 10.0))
    assert above == pytest.approx(-below, rel=1e-3) and 1e-3 < above < 4e-3
    assert abs(middle) < 1e-6
    own = law(schedule)
    rest = (math.radians(50.0), 4.5e5, 2.6e5)
    start = own.initial_state(rest)
    now, _ = own.tracking.context(start.tracking, rest, rest[0], FLOATS)
    assert now.opening == pytest.approx(schedule.at(rest[0], 3.55e5).opening, rel=1e-6)


@pytest.mark.parametrize("learning", [None, MotionLearning()], ids=["design", "learned"])
def test_a_move_is_braked_with_the_inertia_of_the_design_until_another_is_learned(
    schedule: JointSchedule, learning: MotionLearning | None
) -> None:
    heavier = replace(
        schedule,
        low=(tuple(0.8 * b for b in schedule.low[0]), *schedule.low[1:]),
        high=(tuple(0.8 * b for b in schedule.high[0]), *schedule.high[1:]),
    )
    own = law(schedule.with_inertia_of(heavier), learning=learning)
    rest = (0.5, 3.8e5, 3.8e5)
    state = own.initial_state(rest).tracking
    for _ in range(30):
        now, state = own.tracking.context(state, rest, 0.7, FLOATS)
    b = heavier.at(now.plan.angle, 3.8e5).b
    held = schedule.at(now.plan.angle, 3.8e5).difference
    pushed = now.plan.acceleration + schedule.at(now.plan.angle, 3.8e5).a1 * now.plan.speed
    assert now.reference_difference == pytest.approx(held + pushed / b, rel=1e-2)


def test_the_pressures_of_a_compensated_hysteresis_are_fed_forward_by_the_valve(
    schedule: JointSchedule,
) -> None:
    dahl = HysteresisCompensation(10.0, 7e-5, 5e-4, 0.0295, 7.6e-5)
    plain, own = law(schedule), law(schedule, hysteresis=dahl)
    rest = (0.5, 3.8e5, 3.8e5)
    state, before = own.initial_state(rest).tracking, plain.initial_state(rest).tracking
    difference = opening = 0.0
    for _ in range(100):
        now, state = own.tracking.context(state, rest, 0.7, FLOATS)
        nominal, before = plain.tracking.context(before, rest, 0.7, FLOATS)
        difference = now.reference_difference - nominal.reference_difference
        opening += 0.002 * nominal.joint.g * (now.opening - nominal.opening)
    # What the valve adds over time is what the pressures have to rise by.
    assert difference > 1e4 and opening == pytest.approx(difference, rel=0.1)


def test_what_is_learned_of_the_valve_moves_nothing_at_rest(schedule: JointSchedule) -> None:
    own = law(schedule, centring=3.0)
    rest = (0.5, 3.8e5, 3.8e5)
    state = own.initial_state(rest).tracking
    for _ in range(2000):
        _, state = own.tracking.context(state, rest, 0.5, FLOATS)
        state = own.tracking.sent(state, 0.004)
    assert state.rest.known + state.rest.opening == pytest.approx(0.004, rel=1e-3)
    assert own.tracking.command(own.valve, state, 0.004) == pytest.approx(
        own.valve.command(0.004), abs=1e-3
    )
    # Around the centre that was learned the curve is as flat as the true one is there.
    rise = own.tracking.command(own.valve, state, 0.024) - own.valve.command(0.004)
    assert rise == pytest.approx(own.valve.command(0.020) - 5.0, abs=0.01)
    assert replace(own.tracking, centring=0.0).command(own.valve, state, 0.004) == pytest.approx(
        own.valve.command(0.004)
    )


def test_a_valve_whose_centre_was_learned_moves_the_joint_as_it_should(
    schedule: JointSchedule, plant: Model
) -> None:
    off = plant.with_effect(valve_offset(amount=0.2))
    scenario = step_scenario("angle", 20, 35, unit="deg")

    def largest_error(**numbers: Any) -> float:
        own = law(schedule, pressure_speed=12.0, integral=0.6, jerk_limit=300.0, **numbers)
        run = verify(own, off, replace(scenario, settle=1.5))
        return float(np.max(np.abs(run["angle"] - run.info("plan"))))

    learned, known = largest_error(rest_integration=5.0, centring=3.0), largest_error()
    assert learned < 0.6 * known
