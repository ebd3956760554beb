"""A load that is not rigidly attached: it swings on a spring and a damper.

With J_l = load radius^2 and the load's own angle phi, ``T_c`` acts on the joint and moves the load;
the loose share of the load's inertia no longer moves with the joint.
"""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.law import Fit, Law, shape, size
from workbench.physics.place import Survey

RADIUS = 0.3698
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
    inertia = at.p.share * at.signals.load * RADIUS**2
    return at.value - (inertia if at.index == 0 else inertia * _coupling(at))


def _torque(e: EffectView) -> PortView:
    return list(e.at.values())[1]


loose_load = Law(
    "loose_load",
    "J_l d2phi/dt2 = T_c = J_l [w^2 (theta - phi) + 2 d w (omega - dphi/dt)]",
    _inertia_and_torque,
    lambda at: (
        size("share", "1", 1.0, 0.1, 1.0, "part of the load that is loose"),
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
    shapes=lambda at: [{"frequency": f} for f in (40.0, 20.0, 10.0, 100.0)],
    whole=True,
    far=True,
    source="two-mass oscillator",
    look_alikes=("load_error", "viscous_friction"),
    separated_by="a sweep through the loose load's frequency, or an accelerometer on it",
)  # fmt: skip
