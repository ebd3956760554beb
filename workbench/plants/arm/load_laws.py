"""Laws of the arm's load: a plane that is not level, a load misstated, a load that swings."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.law import Fit, Law, each, shape, size
from workbench.physics.place import Survey
from workbench.plants.arm.inertia import ArmBody

_BODY = ArmBody()


def _lever(at: PortView, centre: tuple[float, float]) -> Expression:
    """Horizontal distance of a centre of gravity from the pivot, m."""
    return centre[0] * ca.cos(at.signals.angle) - centre[1] * ca.sin(at.signals.angle)


def _tilted(at: PortView) -> Expression:
    weight = _BODY.gravity * (
        _BODY.arm_mass * _lever(at, _BODY.arm_centre)
        + at.signals.load * _lever(at, _BODY.plate_centre)
    )
    return at.value - ca.sin(at.p.tilt) * weight


tilt_gravity = Law(
    "tilt_gravity",
    "T = -g sin(tilt) sum(m r cos(theta))",
    each("force", needs=("speed", "angle", "load")),
    lambda at: (size("tilt", "rad", 0.05, 0.5, "angle of the plane to the level", signed=True),),
    _tilted,
    source="statics of a heavy arm in an inclined plane",
    look_alikes=("constant_torque", "force_gain", "linear_spring"),
    separated_by="the same holding positions with another load: only a weight scales",
)


def _inertia_and_weight(survey: Survey) -> Iterator[Fit]:
    weight = any(effect.name == "gravity" for effect in survey.model.effects)
    for inertia in survey.fitting("inertia", needs=("load",)):
        torques = [
            q for q in survey.fitting("force", needs=("angle",))
            if weight and q.port.group == inertia.port.group
        ]  # fmt: skip
        yield "", ((inertia, *torques[:1]),)


def _heavier(at: PortView) -> Expression:
    if at.index == 0:
        along, above = _BODY.plate_centre
        return at.value + at.p.mass * (along**2 + above**2 + _BODY.plate_inertia)
    weight = at.p.gravity_share * _BODY.gravity * at.p.mass
    return at.value - weight * _lever(at, _BODY.plate_centre)


load_error = Law(
    "load_error",
    "J = J + mass r^2, T = T - share g mass x cos(theta)",
    _inertia_and_weight,
    lambda at: (
        size("mass", "kg", 0.5, 8.0, "mass in excess of the notes", signed=True),
        shape("gravity_share", "1", 1.0 if at.others else 0.0,
              "share of gravity in the plane of motion", around=None, between=(-1.0, 1.0),
              scale=1.0, source="", fitted=False),
    ),
    _heavier,
    source="parallel-axis theorem",
    look_alikes=("loose_load", "force_gain"),
    separated_by="weigh the load; free swings with the load taken off",
)  # fmt: skip

_RADIUS = 0.3698
"""Radius of gyration of the load about the joint, m."""


def _inertia_and_torque(survey: Survey) -> Iterator[Fit]:
    for inertia in survey.fitting("inertia", needs=("load",)):
        for torque in survey.fitting("force", needs=("angle", "speed", "load")):
            if torque.port.group == inertia.port.group:
                yield "", ((inertia, torque),)


def _coupling(at: PortView) -> Expression:
    """Torque on the load over its inertia, 1/s^2."""
    spring = at.p.frequency * at.p.frequency * (at.signals.angle - at.x.angle)
    return spring + 2.0 * at.p.damping * at.p.frequency * (at.signals.speed - at.x.speed)


def _loose(at: PortView) -> Expression:
    inertia = at.p.share * at.signals.load * _RADIUS**2
    return at.value - (inertia if at.index == 0 else inertia * _coupling(at))


def _torque(e: EffectView) -> PortView:
    return list(e.at.values())[1]


# A loose load is on a spring and a damper. With J_l = load radius^2 and its own angle phi, T_c acts
# on the joint and moves the load; the loose share of its inertia no longer moves with the joint.
loose_load = Law(
    "loose_load",
    "J_l d2phi/dt2 = T_c = J_l [w^2 (theta - phi) + 2 d w (omega - dphi/dt)]",
    _inertia_and_torque,
    lambda at: (
        size("share", "1", 1.0, 1.0, "part of the load that is loose"),
        shape("frequency", "rad/s", 40.0, "natural frequency with the arm held", around=None,
              between=(5.0, 300.0)),
        shape("damping", "1", 0.1, "damping ratio", around=None, between=(0.0, 2.0)),
    ),
    _loose,
    states=lambda at: (
        State("angle", "rad", 1.0, "angle of the loose load", 0.5),
        State("speed", "rad/s", 1.0, "speed of the loose load"),
    ),
    rates=lambda e: {"angle": e.x.speed, "speed": _coupling(_torque(e))},
    start=lambda e: {
        "angle": _torque(e).signals.angle,
        "speed": _torque(e).signals.speed,
    },
    shapes=lambda at: [{"frequency": f} for f in (40.0, 20.0, 10.0, 100.0, 28.0, 14.0)],
    whole=True,
    far=True,
    source="two-mass oscillator",
    look_alikes=("load_error", "viscous_friction"),
    separated_by="a sweep through the loose load's frequency, or an accelerometer on it",
)  # fmt: skip
