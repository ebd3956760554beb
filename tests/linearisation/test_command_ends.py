"""Commands that a plant's equations clip and whose author declares no end."""

from __future__ import annotations

import math

import casadi as ca
import pytest

from workbench.linearisation import linearise
from workbench.model import Input, Model, Output, Scope, State
from workbench.model.trace import Equations
from workbench.operating_point import operating_point


def _tank(m: Scope) -> Equations:
    opened = ca.fmin(ca.fmax(m.u.valve, 0.0), 1.0)
    inner = ca.fmin(ca.fmax(m.u.goal - m.x.level, -0.3), 0.3)
    return {"level": 0.02 * opened - 0.01 * m.x.level + inner + m.u.leak}, {"level": m.x.level}


def test_a_command_ends_where_the_equations_no_longer_answer() -> None:
    tank = Model(
        "tank",
        _tank,
        states=(State("level", "1", initial=1.0),),
        inputs=(
            Input("valve", "1", nominal=0.5),
            Input("goal", "1", nominal=1.0),
            Input("leak", "1"),
        ),
        outputs=(Output("level", "1"),),
    )
    known = linearise(operating_point(tank), verdict=False).operating_point.model
    ends = {q.name: (q.lower, q.upper) for q in known.inputs}
    assert ends["valve"] == pytest.approx((0.0, 1.0), abs=1e-9)
    # The ends of a clipped error move with what it is the error of; what is linear has none.
    assert ends["goal"] == ends["leak"] == (-math.inf, math.inf)
    assert all(math.isinf(q.upper) for q in tank.inputs)
