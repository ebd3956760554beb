"""LuGre friction: bristles that bend before they slip.

With the bristle's bend ``z`` relative to the presliding distance, sigma_0 = level / presliding and
sigma_1 = level damping_time / presliding in the usual notation; in steady motion the friction is
``level s(v)`` with ``s(v) = 1 + stribeck_share exp(-(v / stribeck_speed)^2)``.
"""

from __future__ import annotations

import casadi as ca

from workbench.model import Names, PortView, State
from workbench.model.regularisation import Expression, Form
from workbench.physics.law import Law, each, floor, shape, size
from workbench.physics.place import EFFORTS


def _bristle_rate(v: Expression, bend: Expression, p: Names, form: Form) -> Expression:
    speed = form.absolute(v, 1e-3 * p.stribeck_speed)
    steady = 1.0 + p.stribeck_share * ca.exp(-((v / p.stribeck_speed) ** 2))
    # The presliding distance is stretched at high speed, where the bristle is saturated anyway, so
    # that no rate is faster than samples show.
    return (v - speed * bend / steady) / (p.presliding + speed * p.floor)


def _friction(at: PortView) -> Expression:
    rate = _bristle_rate(at.signals.speed, at.x.bend, at.p, at.form)
    return at.value - at.p.level * (at.x.bend + at.p.damping_time * rate)


lugre_friction = Law(
    "lugre_friction",
    "T = -level (z + damping_time dz/dt), dz/dt = (v - |v| z / s(v)) / presliding",
    each(*EFFORTS, needs=("speed",)),
    lambda at: (
        size("level", at.unit, 0.05 * at.scale, 0.5 * at.scale,
             "friction at high speed", resists=True),
        shape("presliding", at.coordinate.unit, 2e-3 * at.coordinate.scale,
              "displacement over which the bristles bend", around=(0.02, 50.0)),
        shape("stribeck_share", "1", 0.5, "break-away above the level, relative to it",
              around=None, between=(0.0, 20.0)),
        shape("stribeck_speed", at.speed.unit, 0.1 * at.speed.scale,
              "speed over which the break-away fades", around=(0.05, 10.0), fitted=False),
        shape("damping_time", "s", 0.0, "damping of the bristle over its stiffness",
              around=None, between=(0.0, 0.1), scale=1e-3, fitted=False),
        floor(at, 0.5),
    ),
    _friction,
    states=lambda at: (
        State("bend", "1", 1.0, "bend of the bristles over the presliding distance", start_rms=0.5),
    ),
    rates=lambda e: {"bend": _bristle_rate(e.here.signals.speed, e.x.bend, e.p, e.form)},
    shapes=lambda at: [{"presliding": k * at.coordinate.scale} for k in (2e-3, 5e-4, 1e-2)],
    dry=True,
    source="Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE TAC 40 (1995)",
    look_alikes=("coulomb_friction", "stribeck_friction", "joint_hysteresis"),
    separated_by="motions smaller than the presliding distance: here friction is a spring",
)  # fmt: skip
