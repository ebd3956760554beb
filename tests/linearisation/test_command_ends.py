"""Commands that a plant's equations clip and whose author declares no end."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.machines import at_rest, machine
from workbench.model import Scope


def _tank(m: Scope) -> dict[str, Any]:
    opened = ca.fmin(ca.fmax(m.u.valve, 0.0), 1.0)
    inner = ca.fmin(ca.fmax(m.u.goal - m.x.level, -0.3), 0.3)
    soft = ca.tanh(m.u.soft / 3.0) / (1.0 + m.x.level**2) + ca.log(2.0 + ca.fabs(m.u.root))
    rate = 0.02 * opened - 0.01 * m.x.level + inner + m.u.leak + soft - math.log(2.0)
    return {"level": rate}


def test_a_command_ends_where_the_equations_no_longer_answer() -> None:
    tank = machine(
        _tank,
        "level 1 1",
        "valve 1 nominal=0.5, goal 1 nominal=1, leak 1, soft 1 lower=-100, root 1",
        "level 1",
    )
    linear = at_rest(tank)
    known = linear.operating_point.model
    ends = {q.name: (q.lower, q.upper) for q in known.inputs}
    assert ends["valve"] == pytest.approx((0.0, 1.0), abs=1e-9)
    # The ends of a clipped error move with what it is the error of; what is linear has none.
    assert ends["goal"] == ends["leak"] == ends["root"] == (-math.inf, math.inf)
    # What bends ends where a twentieth of its slope is left.
    assert ends["soft"] == pytest.approx((-6.53, 6.53), abs=0.01)
    # All of it is no more than what a straight line does with 2.92.
    assert linear.ends[:, 3] == pytest.approx(np.array([[-2.92, 0.0], [2.92, 0.0]]), abs=0.01)
    assert np.isinf(linear.ends[:, [0, 1, 2, 4], 0][:, [0, 2, 3]]).all()
    assert all(math.isinf(q.upper) for q in tank.inputs)


def test_ends_that_move_are_told_with_the_states_that_move_them() -> None:
    def drive(m: Scope) -> dict[str, Any]:
        """A cart whose speed is held by a loop of its own, with a force that is clipped."""
        goal = ca.fmin(m.u.goal, 3.0)
        force = ca.fmin(ca.fmax(80.0 * (goal - m.x.speed), -2.0), 2.0)
        return {"way": m.x.speed, "speed": force - 0.1 * m.x.speed, "heat": force - m.x.heat}

    cart = machine(drive, "way m, speed m/s, heat 1", "other 1, goal m/s lower=-5", "way m")
    linear = at_rest(cart)
    assert linear.ends[:, 1] == pytest.approx(np.array([[-0.025, 0, 1, 0], [0.025, 0, 1, 0]]))
    assert np.isinf(linear.ends[:, 0, 0]).all()
    # The loop within does not let go of a speed that swings further than it reaches.
    assert linear.A[1, 1] == pytest.approx(-80.1)
    # Behind them is where it ends whatever the states.
    goal = linear.operating_point.model.inputs[1]
    assert (goal.lower, goal.upper) == pytest.approx((-5.0, 3.0))
    # They go with the inputs and the states of what is made of the model.
    seen = linear.select(inputs=["goal"]).without_unseen()
    assert seen.state_names == ("way", "speed") and seen.ends is not None
    assert seen.ends[1, 0] == pytest.approx([0.025, 0.0, 1.0])
