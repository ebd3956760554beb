"""The planner: steps become smooth moves within limits, a sine passes without lag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers.arithmetic import FLOATS
from controllers.reference.planned import Planner
from workbench.errors import WorkbenchError

H = 0.002
PLANNER = Planner(jerk=2000.0, acceleration=40.0, speed=10.0)


def planned(reference: np.ndarray, planner: Planner = PLANNER) -> np.ndarray:
    state, rows = planner.start(float(reference[0])), []
    for r in reference.tolist():
        plan, state = planner.plan(state, r, FLOATS)
        rows.append(plan)
    return np.array(rows)


@pytest.mark.parametrize("step", [0.0873, 0.2618, -0.5236, 1e-3])
def test_a_step_is_a_move_within_the_limits(step: float) -> None:
    reference = np.where(np.arange(500) * H < 0.1, 0.3, 0.3 + step)
    angle, speed, acceleration, jerk = planned(reference).T
    assert np.abs(acceleration).max() <= PLANNER.acceleration * 1.001
    # a step too small to count as a jump is two bends, and what the sample between leaves adds 4 %
    assert np.abs(jerk).max() <= PLANNER.jerk * (1.05 if abs(step) < 0.01 else 1.001)
    # never beyond the step, and there at the planned time
    assert ((angle - 0.3) / step).max() <= 1.0 + 1e-9
    arrived = np.flatnonzero(np.abs(angle - reference) > 1e-9)[-1] * H - 0.1
    assert arrived == pytest.approx(PLANNER._duration(step, 0.0, FLOATS), abs=2 * H)
    # the derivatives are those of the planned angle
    np.testing.assert_allclose(
        np.gradient(angle, H)[60:-2], speed[60:-2], atol=0.03 * np.abs(speed).max() + 1e-9
    )


def test_a_jump_during_a_move_keeps_angle_and_speed_continuous() -> None:
    time = np.arange(500) * H
    reference = np.where(time < 0.1, 0.0, np.where(time < 0.2, 0.3, 0.1))
    angle, speed, *_ = planned(reference).T
    assert np.abs(np.diff(angle)).max() < 1.5 * np.abs(speed).max() * H
    # an acceleration within twice the limit: two moves overlap
    assert np.abs(np.diff(speed)).max() / H < 3 * PLANNER.acceleration
    assert angle[-1] == pytest.approx(0.1, abs=1e-12)


def test_a_sine_passes_without_lag() -> None:
    time = np.arange(2000) * H
    w = 2 * np.pi
    reference = 0.5 + 0.26 * np.sin(w * time)
    angle, speed, acceleration, _ = planned(reference).T
    late = time > 0.6
    np.testing.assert_allclose(angle[late], reference[late], atol=1e-12)
    # backward differences are half and one sample late
    np.testing.assert_allclose(speed[late], 0.26 * w * np.cos(w * time[late]), atol=0.015)
    np.testing.assert_allclose(
        acceleration[late], -0.26 * w * w * np.sin(w * time[late]), atol=0.15
    )
    # the start at full speed is a smooth move too
    assert np.abs(np.diff(speed)).max() / H < PLANNER.acceleration + 12.0


@pytest.mark.parametrize("time", [0.006, 0.05])
def test_ahead_is_the_plan_that_comes(time: float) -> None:
    seconds = np.arange(1000) * H
    reference = 0.5 + 0.1 * np.sin(2 * np.pi * 0.5 * seconds) + np.where(seconds < 1.0, 0.0, 0.2)
    state, now, then = PLANNER.start(0.5), [], []
    for r in reference.tolist():
        plan, state = PLANNER.plan(state, r, FLOATS)
        now.append(plan)
        then.append(PLANNER.ahead(state, plan, time, FLOATS))
    later = round(time / H)
    before, after = 510, 1000 - later
    came = np.array(now)[before + later : after + later]
    for k, tolerance in enumerate((1e-4, 6e-3, 0.15)):
        np.testing.assert_allclose(np.array(then)[before:after, k], came[:, k], atol=tolerance)
    # without the look ahead it is much further away while the arm moves
    assert np.abs(np.array(now)[before:after, 0] - came[:, 0]).max() > 5e-3


def test_far_ahead_a_course_goes_straight_on() -> None:
    seconds = np.arange(500) * H
    state = PLANNER.start(0.0)
    for r in (0.2 * np.sin(2 * np.pi * seconds)).tolist():
        plan, state = PLANNER.plan(state, r, FLOATS)
    near, far, further = (PLANNER.ahead(state, plan, t, FLOATS) for t in (0.1, 0.3, 0.4))
    assert further.speed == far.speed == near.speed
    assert further.angle - far.angle == pytest.approx(0.1 * far.speed)


def test_limits_must_be_positive() -> None:
    with pytest.raises(WorkbenchError, match="jerk of the planned reference"):
        Planner(jerk=0.0, acceleration=1.0, speed=1.0)


def test_a_long_move_is_planned_anew_half_way_for_a_joint_that_is_behind() -> None:
    own = replace(PLANNER, jerk=200.0, renewal=0.3)
    duration = float(own._duration(0.2618, 0.0, FLOATS))

    def followed(behind: float) -> np.ndarray:
        state, rows = own.start(0.0), []
        for _ in range(500):
            plan, state = own.plan(state, 0.2618, FLOATS)
            # The joint is a share behind in angle and in speed.
            joint = ((1.0 - behind) * plan.angle, (1.0 - behind) * plan.speed)
            plan, state = own.renewed(state, plan, *joint, FLOATS)
            rows.append(plan)
        return np.array(rows)

    def there(plan: np.ndarray) -> float:
        return float(np.flatnonzero(np.abs(plan[:, 0] - 0.2618) > 1e-6)[-1]) * H

    exact, late = followed(0.0), followed(0.1)
    assert there(exact) == pytest.approx(duration, abs=5 * H)
    # A tenth more of the way is left, and a tenth of the speed is missing.
    assert there(late) == pytest.approx((0.5 + 0.5 * 1.2) * duration, rel=0.03)
    assert late[-1, 0] == pytest.approx(0.2618, abs=1e-12)
    # What the joint is behind is given up at once.
    half = int(0.5 * duration / H)
    jumps = np.abs(np.diff(late[:, 0]) - H * late[1:, 1])
    assert jumps.max() == pytest.approx(0.1 * late[half, 0], rel=0.15)
    assert late[half + 1, 1] == pytest.approx(0.9 * late[half, 1], rel=1e-3)
    # A short move is not.
    short = replace(own, renewal=1.0)
    state = short.start(0.0)
    for _ in range(500):
        plan, state = short.plan(state, 0.2618, FLOATS)
        assert short.renewed(state, plan, 0.0, 0.0, FLOATS) == (plan, state)
