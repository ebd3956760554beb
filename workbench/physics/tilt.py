"""Gravity on a joint whose plane is not level: a body and its load at their centres of gravity."""

from __future__ import annotations

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, each, size

GRAVITY = 9.81
"""Acceleration of gravity, m/s^2."""

BODY_MASS = 0.987
"""Mass of the body without load, kg."""

BODY_CENTRE = (0.205, 0.0176)
"""Centre of gravity of the body (along, above), m."""

LOAD_CENTRE = (0.367, -0.024)
"""Centre of gravity of the load (along, above), m."""


def _tilted(at: PortView) -> Expression:
    angle, load = at.signals.angle, at.signals.load
    along = BODY_MASS * BODY_CENTRE[0] + load * LOAD_CENTRE[0]
    above = BODY_MASS * BODY_CENTRE[1] + load * LOAD_CENTRE[1]
    weight = GRAVITY * (along * ca.cos(angle) - above * ca.sin(angle))
    return at.value - ca.sin(at.p.tilt) * weight


tilt_gravity = Law(
    "tilt_gravity",
    "T = -g sin(tilt) sum(m r cos(theta))",
    each("force", needs=("speed", "angle", "load")),
    lambda at: (
        size("tilt", "rad", 0.05, 0.005, 0.5, "angle of the plane to the level", signed=True),
    ),
    _tilted,
    source="statics of a heavy arm in an inclined plane",
    look_alikes=("constant_torque", "force_gain", "linear_spring"),
    separated_by="the same holding positions with another load: only a weight scales",
)
