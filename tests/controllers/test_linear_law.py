"""The derivatives of a law are those of its expressions: differences of its step agree."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import control as ct
import numpy as np
import pytest

from controllers import cascade_pid
from controllers.joint.schedule import JointSchedule
from controllers.linear_law import linear_law
from controllers.named_state import flat, restored
from controllers.plain.state_feedback import LQISpecification, design_lqi
from tests.controllers.families import family
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel

LAWS = {
    "pid": family("pid"),
    "sliding mode": family("sliding-mode"),
    "mpc": family("mpc"),
    "scheduled pid": family("scheduled-pid", lag=0.005),
    "integral": family("scheduled-sliding-mode", kind="integral"),
    "state feedback": family("scheduled-state-feedback", lag=0.005),
    "scheduled mpc": family("scheduled-mpc", lag=0.005),
}


@pytest.mark.parametrize("make", LAWS.values(), ids=LAWS.keys())
def test_differences_of_the_step_agree(
    make: Any, linear: LinearModel, schedule: JointSchedule
) -> None:
    law = make(schedule, linear)
    # Away from the corners of the schedule, with pressures that hold the joint there.
    angle = 0.45
    difference = float(linear.y0[1] - linear.y0[2])
    if hasattr(law, "tracking") and hasattr(law.tracking, "schedule"):
        difference = law.tracking.schedule.at(angle, 3.6e5).difference
    rest = (angle, 3.6e5 + 0.5 * difference, 3.6e5 - 0.5 * difference)
    found = linear_law(law, rest, (angle,) * (1 + law.preview))
    state = law.initial_state(rest)

    def run(m: Any) -> tuple[float, Any]:
        command, following, _ = law.step(state, tuple(m), (angle,))
        return law.linear_command(command)[0], np.array(flat(following))

    for i, size in enumerate((1e-5, 30.0, 30.0)):
        moved = np.zeros(3)
        moved[i] = size
        ahead, behind = run(np.array(rest) + moved), run(np.array(rest) - moved)
        slope = (ahead[0] - behind[0]) / (2 * size)
        assert found.J[0, i] == pytest.approx(slope, rel=2e-4, abs=1e-10)


def test_a_gain_alone_has_its_matrices() -> None:
    pid = cascade_pid(6e5, 0.0, 0.0, inner=2e-6, pressure_filter=0.0, reference_speed=0.0)
    found = linear_law(pid, (0.5, 3e5, 3e5), (0.5,))
    # The opening -1.2 per rad times 50 V per opening on the tangent of the curve at rest.
    np.testing.assert_allclose(found.J, [[-60.0, -1e-4, 1e-4]], rtol=1e-12)


def test_a_law_without_symbols_is_differenced() -> None:
    pid = cascade_pid(6e5, 2e6, 1e5, inner=2e-6)

    class Own:
        sensors, controlled, actuators = pid.sensors, pid.controlled, pid.actuators
        name, sample_time, preview = "own", pid.sample_time, 0
        initial_state, step, linear_command = pid.initial_state, pid.step, pid.linear_command

    rest = (0.5, 4e5, 3e5)
    # In which coordinates is the law's own affair: what counts is from measurement to command.
    own: Any = Own()
    for ours, theirs in zip(
        linear_law(own, rest, (0.5,)), linear_law(pid, rest, (0.5,)), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-3, atol=1e-6)


def test_a_law_that_remembers_in_itself_or_no_numbers_has_no_margins() -> None:
    class Own:
        name, sample_time, preview, integral = "own", 0.01, 0, 0.0
        sensors = controlled = ("y",)
        actuators = ("u",)

        def initial_state(self, measurement: tuple[float, ...]) -> Any:
            return self.first

        def step(self, state: Any, measurement: tuple[float, ...], reference: Any) -> Any:
            self.integral += reference[0] - measurement[0]
            return (self.integral,), state, {}

        def linear_command(self, command: Any) -> Any:
            return command

    own: Any = Own()
    own.first = None
    with pytest.raises(WorkbenchError, match="otherwise the second time"):
        linear_law(own, (0.0,), (0.0,))
    own.first = b"memory"
    with pytest.raises(WorkbenchError, match="keeps bytes in its state"):
        linear_law(own, (0.0,), (0.0,))


def test_states_keep_their_form() -> None:
    pid = cascade_pid(6e5, 2e6, 1e5, inner=2e-6)
    state = pid.initial_state((0.5, 4e5, 3e5))
    assert restored(state, flat(state)) == state


def test_a_law_that_ends_elsewhere_is_the_same_between_its_ends() -> None:
    # What feeds the level 2 asks for is twice what the command has.
    law = design_lqi(ct.ss(-1.0, 1.0, 1.0, 0.0), LQISpecification(sample_time=0.01))
    law = replace(law, upper=(1.0,))
    two = linear_law(law, (0.0,), (0.0,)), linear_law(law, (2.0,), (2.0,))
    for here, elsewhere in zip(*two, strict=True):
        np.testing.assert_array_equal(here, elsewhere)
