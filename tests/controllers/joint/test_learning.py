"""Inertia and hysteresis of a joint, learned while it moves."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.arithmetic import FLOATS
from controllers.joint.hysteresis_compensation import HysteresisCompensation
from controllers.joint.learning import INERTIA, Learned, MotionLearning
from controllers.joint.model import JointModel
from controllers.joint.schedule import JointSchedule
from controllers.state_feedback import StateFeedbackSpecification, design_state_feedback
from workbench.model import Model
from workbench.verification import step_scenario, verify
from workbench.verification.each_step import step_responses

JOINT = JointModel(b=1.3e-4, a1=1.2, a0=67.0, g=3.4e7, e=5e5, d=0.8)
DAHL = HysteresisCompensation(10.0, 7e-5, 5e-4, 0.0295, 7.6e-5)
H = 0.002


def moved(inertia: float, hysteresis: float, *, upto: float = 1.0, planned: bool = True) -> Learned:
    """Return what is known of a joint after a part of a move of 15° in 0.4 s."""
    learning = MotionLearning()
    state = learning.start(0.35, 0.0)
    s = np.clip(np.arange(0.0, 0.4, H) / 0.4, 0.0, 1.0)
    angle = 0.35 + 0.26 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
    speed = np.gradient(angle, H)
    push = inertia * (np.gradient(speed, H) + JOINT.a1 * speed) / JOINT.b
    turn = 0.0
    for k in range(round(upto * len(s))):
        turn = DAHL.turned(turn, speed[k] / learning.spread, H, FLOATS)
        beyond = push[k] + hysteresis * DAHL.difference(turn, 3.5e5)
        plan = (speed[k] if planned else 0.0, 3.5e5)
        state = learning.step(state, angle[k], beyond, plan, JOINT, DAHL, FLOATS)
    return state


@pytest.mark.parametrize("inertia", [1.5, 0.5, 1.3])
def test_half_a_move_tells_of_the_inertia(inertia: float) -> None:
    # How fast it is believed is a choice: a third half way, most of it in the end.
    half, whole = (moved(inertia, 1.0, upto=share) for share in (0.5, 1.0))
    assert (half.inertia - 1.0) / (inertia - 1.0) > 0.3
    assert whole.inertia == pytest.approx(inertia, abs=0.2)
    assert moved(inertia, 0.1).hysteresis < moved(inertia, 1.0).hysteresis - 0.05


def test_nothing_is_learned_where_nothing_is_planned() -> None:
    pushed = moved(1.5, 1.0, planned=False)
    assert (pushed.inertia, pushed.hysteresis) == (1.0, 1.0)


def test_what_is_believed_has_bounds() -> None:
    assert moved(9.0, 1.0).inertia == INERTIA[1]


def test_rest_stays_what_it_is() -> None:
    learning, state = MotionLearning(), MotionLearning().start(0.35, 2e4)
    for _ in range(500):
        state = learning.step(state, 0.35, 2e4, (0.0, 3.5e5), JOINT, DAHL, FLOATS)
    assert (state.inertia, state.rest) == (1.0, pytest.approx(2e4))
    # The walk of the rest is bounded by what is measured.
    assert 0.0 < state.covariance[5] < learning.walk**2


def test_a_joint_that_learned_its_load_goes_past_its_goal_by_less(
    schedule: JointSchedule, plant: Model
) -> None:
    heavy, scenario = (
        plant.with_parameters({"load": 5.0}),
        step_scenario("angle", 20, 35, unit="deg"),
    )
    changes = scenario.references["angle"].changes
    numbers = {"jerk_limit": 300.0, "rest_integration": 15.0, "integral": 0.6}
    numbers |= {"pressure_speed": 12.0, "unexplained_bandwidth": 7.5, "compensation": 0.4}

    def overshoot(learning: MotionLearning | None) -> float:
        want = StateFeedbackSpecification(radius=8.5, **numbers, hysteresis=DAHL, learning=learning)
        run = verify(design_state_feedback(schedule, want), heavy, scenario)
        return step_responses("angle", run.time, run["angle"], changes)[0].overshoot

    plain, learned = overshoot(None), overshoot(MotionLearning(noise=3e4, inertia=0.3))
    # The first half of the move is gone before the load is known.
    assert plain > 0.2 and learned < 0.9 * plain
