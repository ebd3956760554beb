"""What rubs in a joint that no command works on, such as the hinge of a pendulum on a cart.

No port carries the torque of such a joint: it works on every body, each through its inertia, as its
damping does. So the law is a damping that changes with the speed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import EXACT, Expression
from workbench.physics.law import Fit, Law, Own, shape, size, with_subject
from workbench.physics.place import Local, Place, Survey, per


def _joints(survey: Survey) -> Iterator[Fit]:
    for q, places, speed in survey.joints:
        yield (
            f"_{q.name}",
            tuple(
                (replace(at, parameters=(q,), signals={**at.signals, "turning": speed}),)
                for at in places
            ),
        )


def _damping(at: Place) -> tuple[str, float, Local]:
    """Return unit and typical size of a damping, and the speed over which it acts."""
    speed = at.signals.get("turning", Local("turning", "1"))
    return (
        (at.parameters[0].unit, at.parameters[0].scale, speed)
        if at.parameters
        else ("1", 1.0, speed)
    )


def _friction(at: Place) -> tuple[Own, ...]:
    unit, damping, speed = _damping(at)
    typical = damping * speed.scale
    return (
        size("level", per(unit, speed.unit, -1), typical, 50.0 * typical, "dry friction level"),
        shape("transition_speed", speed.unit, 0.02 * speed.scale, "speed scale of the reversal",
              around=(1e-4, 1e4), fitted=False),
    )  # fmt: skip


def _rubbing(at: PortView) -> Expression:
    s = at.signals.turning / at.p.transition_speed
    # tanh(s) / s, and its limit where that is 0 / 0.
    slope = ca.if_else(s * s > 1e-12, ca.tanh(s) / (s + 1e-300), 1.0)
    return with_subject(at, at.subject + at.p.level / at.p.transition_speed * slope)


joint_friction = Law(
    "joint_friction",
    "damping + level tanh(speed / transition_speed) / speed",
    _joints,
    _friction,
    _rubbing,
    dry=True,
    of_parameter=True,
    source="C. A. Coulomb; regularised with tanh",
    look_alikes=("joint_drag", "parameter_curve"),
    separated_by="a swing that dies out: by equal steps with friction, by equal factors without",
)


def _drag(at: Place) -> tuple[Own, ...]:
    unit, damping, speed = _damping(at)
    typical = damping / speed.scale
    return (
        size("coefficient", per(unit, speed.unit), typical, 50.0 * typical,
             "drag over squared speed"),
    )  # fmt: skip


joint_drag = replace(
    joint_friction,
    name="joint_drag",
    equation="damping + coefficient |speed|",
    parameters=_drag,
    transform=lambda at: with_subject(
        at, at.subject + at.p.coefficient * EXACT.absolute(at.signals.turning, 0)
    ),
    dry=False,
    source="I. Newton, drag of a blunt body",
    look_alikes=("joint_friction", "parameter_curve"),
    separated_by="large and small swings: drag dies out with them, friction does not",
)
