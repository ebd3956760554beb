"""What a design must tolerate: corners, late and lagging loops, prediction over a known latency."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers.joint.schedule import JointSchedule
from controllers.largest_bandwidth import Limits, held, largest_bandwidth
from controllers.pid import CascadePID, ScheduledPIDSpecification, design_scheduled_pid
from controllers.sensitivity import frequencies, loops_at, peaks_of
from controllers.uncertainty import NONE, Uncertainty
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel

ANGLES = frequencies()
LATE = Uncertainty(delay=(0.0, 0.006), sensor_lag=(0.0, 0.004), trusted_frequency=200.0)


def pid(schedule: JointSchedule, frequency: float = 10.0, **more: float) -> CascadePID:
    want = ScheduledPIDSpecification(
        frequency=frequency, inner_speed=2.8, real_pole=0.8, damping=0.6, **more
    )
    return design_scheduled_pid(schedule, want)


def test_ranges_of_times_only() -> None:
    with pytest.raises(WorkbenchError, match="largest delay that is tolerated"):
        Uncertainty(delay=(0.004, 0.002))
    with pytest.raises(WorkbenchError, match="model is trusted is 0.0"):
        Uncertainty(trusted_frequency=0.0)
    half = LATE.reduced(0.5)
    assert half.delay == (0.0, 0.003) and half.trusted_frequency == 200.0


def test_a_late_loop_is_the_loop_with_a_delay(
    schedule: JointSchedule, linear_by_opening: LinearModel
) -> None:
    law = pid(schedule)
    z = np.exp(2j * np.pi * 0.002 * np.array([0.5, 2.0, 9.0]))

    def response(corner: tuple[float, float]) -> np.ndarray:  # type: ignore[type-arg]
        A, B, C, *_ = loops_at(law, linear_by_opening, [corner])[0]
        return np.array([C @ np.linalg.solve(w * np.eye(len(A)) - A, B) for w in z])[:, :, 0]

    prompt = response((0.0, 0.0))
    # Whole samples are exact; a part of one is between its neighbours.
    assert response((0.004, 0.0)) == pytest.approx(prompt / z[:, None] ** 2, rel=1e-9)
    late = response((0.005, 0.0)) / prompt
    assert np.angle(late[0, 0]) == pytest.approx(-2 * math.pi * 0.5 * 0.005, rel=2e-2)
    seen = response((0.0, 0.010))
    assert seen[:, 0] == pytest.approx(prompt[:, 0], rel=1e-9)
    assert abs(seen[2, 1] / prompt[2, 1]) == pytest.approx(
        1 / math.hypot(1, 2 * math.pi * 9 * 0.010), rel=2e-2
    )


def test_the_search_gives_up_speed_for_what_it_must_tolerate(
    schedule: JointSchedule, linear_by_opening: LinearModel
) -> None:
    speeds = [30.0, 22.0, 16.0, 11.0, 8.0]
    bold = largest_bandwidth(lambda w: pid(schedule, w), [linear_by_opening], speeds)
    safe = largest_bandwidth(
        lambda w: pid(schedule, w), [linear_by_opening], speeds, Limits(uncertainty=LATE)
    )
    assert safe.speed < bold.speed and safe.limit
    with pytest.raises(WorkbenchError, match=r"it bears \S+ ms of delay with \S+ ms of lag"):
        largest_bandwidth(
            lambda w: pid(schedule, w),
            [linear_by_opening],
            [18.0],
            Limits(uncertainty=replace(LATE, trusted_frequency=math.inf, delay=(0.0, 0.03))),
        )


def test_nothing_is_trusted_above_a_frequency(
    schedule: JointSchedule, linear_by_opening: LinearModel
) -> None:
    strict = replace(NONE, trusted_frequency=5.0)
    found = held(pid(schedule), [linear_by_opening], Limits(uncertainty=strict))
    assert "trusted frequency at the command" in found.missed


def test_a_known_latency_is_predicted_over(
    schedule: JointSchedule, linear_by_opening: LinearModel
) -> None:
    def peak(latency: float) -> float:
        law = pid(schedule, 16.0, latency=latency)
        return peaks_of(loops_at(law, linear_by_opening, [(0.012, 0.0)])[0], ANGLES)[0]

    prompt = peaks_of(loops_at(pid(schedule, 16.0), linear_by_opening, [(0.0, 0.0)])[0], ANGLES)[0]
    assert peak(0.012) < 1.25 * prompt < peak(0.0)


def test_integration_at_rest_is_no_part_of_the_loop_in_motion(
    schedule: JointSchedule, linear_by_opening: LinearModel
) -> None:
    plain, patient = (pid(schedule, rest_integration=speed) for speed in (0.0, 8.0))
    loops = [loops_at(law, linear_by_opening, [(0.0, 0.0)])[0] for law in (plain, patient)]
    assert peaks_of(loops[0], ANGLES) == pytest.approx(peaks_of(loops[1], ANGLES), rel=1e-9)
    at_rest = (0.5, 3e5, 3e5)
    state = patient.initial_state(at_rest)
    for _ in range(200):
        _, state, _ = patient.step(state, at_rest, (0.505,))
    assert state.tracking.rest.held > 0.0 and plain.initial_state(at_rest).tracking.rest is None
