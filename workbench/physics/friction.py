"""Friction and drag: against the direction of motion, by speed, presliding and load."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca

from workbench.model import Names, PortView, State
from workbench.model.regularisation import EXACT, Expression, Form
from workbench.model.units import per, same_dimension
from workbench.physics.law import (
    Fit,
    Law,
    Own,
    at_inputs_too,
    by_port,
    each,
    floor,
    rounding,
    shape,
    size,
    size_at,
    twins,
    with_subject,
)
from workbench.physics.parameter_arguments import joint_dampings
from workbench.physics.place import RESISTED, Place
from workbench.physics.survey import Survey

_SMOOTH = 0.02
"""Speed that rounds a reversal, over the usual speed, unless a machine is seen to stick."""


def transition(at: Place, around: float = 1e3) -> Own:
    """Return the speed that rounds the reversal, held in a fit within a factor of its value."""
    return shape("transition_speed", at.speed.unit, _SMOOTH * at.speed.scale,
                 "speed scale of the reversal", around=(1.0 / around, around),
                 fitted=False)  # fmt: skip


def sliding(at: PortView) -> Expression:
    """Return the sign of the speed, dimensionless, rounded over the transition speed."""
    return ca.tanh(at.signals.speed / at.p.transition_speed)


def _reversals(at: Place) -> list[dict[str, float]]:
    """Return reversals: smooth; so short that a machine sticks; and that it does not creep on."""
    return [{"transition_speed": k * at.speed.scale} for k in (_SMOOTH, 5e-4, 2e-5)]


coulomb_friction = Law(
    "coulomb_friction",
    "T = -level tanh(speed / transition_speed)",
    each(*RESISTED, needs=("speed",)),
    lambda at: (
        size_at(at, "level", 0.05, 0.5, "dry friction level", resists=True),
        transition(at, 1e4),
    ),
    lambda at: at.value - at.p.level * sliding(at),
    shapes=_reversals,
    dry=True,
    usual=True,
    source="C. A. Coulomb; regularised with tanh",
    look_alikes=(
        "stribeck_friction", "lugre_friction", "load_dependent_friction", "muscle_hysteresis",
    ),
    separated_by="slow reversals against steady speeds",
)  # fmt: skip

viscous_friction = Law(
    "viscous_friction",
    "T = -coefficient speed",
    each(*RESISTED, needs=("speed",)),
    lambda at: (size_at(at, "coefficient", 0.05, 0.5, "damping", over=at.speed, resists=True),),
    lambda at: at.value - at.p.coefficient * at.signals.speed,
    usual=True,
    source="linear damper",
    look_alikes=("muscle_viscosity", "quadratic_drag"),
    separated_by="swings of small and large amplitude",
)

quadratic_drag = Law(
    "quadratic_drag",
    "T = -coefficient v |v|",
    each(*RESISTED, needs=("speed",)),
    lambda at: (
        size_at(at, "coefficient", 0.02, 0.5, "drag over squared speed", over=at.speed, power=2,
                resists=True),
    ),
    # Its slope has no jump: nothing needs rounding.
    lambda at: at.value - at.p.coefficient * at.signals.speed * EXACT.absolute(at.signals.speed, 0),
    source="I. Newton, drag of a blunt body; turbulent throttling of a damper",
    look_alikes=("viscous_friction", "muscle_viscosity", "cubic_drag"),
    separated_by="fast against slow runs: the decay per swing grows with the amplitude",
)  # fmt: skip

cubic_drag = Law(
    "cubic_drag",
    "T = -coefficient v^3",
    each(*RESISTED, needs=("speed",)),
    lambda at: (
        size_at(at, "coefficient", 0.02, 5.0, "drag over cubed speed", over=at.speed, power=3,
                resists=True),
    ),
    lambda at: at.value - at.p.coefficient * at.signals.speed**3,
    source="damping that grows with the amplitude; wire that its current heats",
    look_alikes=("quadratic_drag", "viscous_friction"),
    separated_by="fast against slow runs: the decay grows with the square of the amplitude",
)  # fmt: skip


def _reverses(at: Place) -> bool:
    """Tell whether the speed had both signs: what goes one way only tells no direction."""
    seen = at.speed.seen
    return seen is None or seen[0] < 0.0 < seen[1]


# With a damper c the difference makes it c + difference / 2 forwards and c - difference / 2
# backwards; on its own it feeds energy in one direction.
direction_dependent_viscous = Law(
    "direction_dependent_viscous",
    "T = -(difference / 2) |v|",
    each(*RESISTED, needs=("speed",), only=_reverses),
    lambda at: (
        size_at(at, "difference", 0.025, 0.5, "damping forwards less damping backwards",
                over=at.speed, signed=True),
        rounding(at),
    ),
    lambda at: at.value
    - 0.5 * at.p.difference * at.form.absolute(at.signals.speed, at.p.rounding_speed),
    source="damper with check valve; bilinear damping",
    look_alikes=("asymmetric_gain", "constant_torque"),
    separated_by="the same speed forwards and backwards through the same angle",
)  # fmt: skip


# With dry friction f the difference makes it f + difference / 2 forwards and f - difference / 2
# backwards; a torque that is always there would also pull at standstill. Without any it would push
# one way: it is offered beside dry friction, the author's or what was found.
direction_dependent_friction = Law(
    "direction_dependent_friction",
    "T = -(difference / 2) tanh(v / transition_speed)^2",
    each(*RESISTED, needs=("speed",), only=lambda at: at.dry and _reverses(at)),
    lambda at: (
        size_at(at, "difference", 0.05, 1.0, "dry friction forwards less that backwards",
                signed=True),
        transition(at),
    ),
    lambda at: at.value - 0.5 * at.p.difference * sliding(at) ** 2,
    dry=True,
    source="seals and gears loaded on one flank; Armstrong-Helouvry et al., Automatica 30 (1994)",
    look_alikes=("constant_torque", "direction_dependent_viscous", "offset"),
    separated_by="slow steady speeds both ways, and holding still between them",
)  # fmt: skip


def _fading(at: PortView) -> Expression:
    fading = ca.exp(-((at.signals.speed / at.p.stribeck_speed) ** 2))
    kept = fading + at.p.coulomb_share * (1.0 - fading)
    return at.value - at.p.break_away * kept * sliding(at)


# Where dry friction is attached already, the Coulomb level is in that.
stribeck_friction = Law(
    "stribeck_friction",
    "T = -break_away (k + (1 - k) exp(-(v / stribeck_speed)^2)) tanh(v / transition_speed),"
    " k = coulomb_share",
    each(*RESISTED, needs=("speed",)),
    lambda at: (
        size_at(at, "break_away", 0.1, 0.5, "friction at standstill, above what is attached",
                source="estimate", resists=True),
        shape("stribeck_speed", at.speed.unit, 0.1 * at.speed.scale,
              "speed over which the break-away fades", around=(0.05, 10.0)),
        shape("coulomb_share", "1", 0.0, "what is left of it at high speed, relative to it",
              between=(0.0, 1.0), fitted=not at.dry_declared),
        transition(at),
    ),
    _fading,
    shapes=lambda at: [
        {"stribeck_speed": k * at.speed.scale} | reversal
        for reversal in _reversals(at)
        for k in (0.1, 0.03, 0.3)
    ],
    dry=True,
    usual=True,
    source="R. Stribeck 1902; Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994)",
    look_alikes=("coulomb_friction", "lugre_friction", "local_friction"),
    separated_by="runs at several slow steady speeds: only this friction falls with speed",
)  # fmt: skip


def _bristle_rate(v: Expression, bend: Expression, p: Names, form: Form) -> Expression:
    speed = form.absolute(v, 1e-3 * p.stribeck_speed)
    steady = 1.0 + p.stribeck_share * ca.exp(-((v / p.stribeck_speed) ** 2))
    # The presliding distance is stretched at high speed, where the bristle is saturated anyway, so
    # that no rate is faster than samples show.
    return (v - speed * bend / steady) / (p.presliding + speed * p.floor)


def _of_bristles(at: PortView) -> Expression:
    rate = _bristle_rate(at.signals.speed, at.x.bend, at.p, at.form)
    return at.value - at.p.level * (at.x.bend + at.p.damping_time * rate)


# With the bristle's bend z relative to the presliding distance, sigma_0 = level / presliding and
# sigma_1 = level damping_time / presliding in the usual notation; in steady motion the friction is
# level s(v) with s(v) = 1 + stribeck_share exp(-(v / stribeck_speed)^2).
lugre_friction = Law(
    "lugre_friction",
    "T = -level (z + damping_time dz/dt), dz/dt = (v - |v| z / s(v)) / presliding",
    each(*RESISTED, needs=("speed",)),
    lambda at: (
        size_at(at, "level", 0.05, 0.5, "friction at high speed", resists=True),
        shape("presliding", at.coordinate.unit, 2e-3 * at.coordinate.scale,
              "displacement over which the bristles bend", around=(0.02, 50.0)),
        shape("stribeck_share", "1", 0.5, "break-away above the level, relative to it",
              between=(0.0, 20.0)),
        shape("stribeck_speed", at.speed.unit, 0.1 * at.speed.scale,
              "speed over which the break-away fades", around=(0.05, 10.0), refined=True),
        shape("damping_time", "s", 0.0, "damping of the bristle over its stiffness",
              between=(0.0, 50.0 * at.interval), scale=0.5 * at.interval, fitted=False),
        floor(at, 0.5),
    ),
    _of_bristles,
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


# For a bearing the coefficient is friction coefficient times journal radius; for a muscle the gauge
# pressure loads the contact of braid and tube. Negative sums of loads count as none.
def _of_bearing(at: PortView) -> Expression:
    load = sum(value for name, value in at.signals.items() if name.startswith("bearing_load_"))
    return at.value - at.p.coefficient * EXACT.ramp(load, 0.0) * sliding(at)


def _typical(at: Place) -> float:
    unit = at.other("bearing_load_1").unit
    return {"N": 5e-5 * at.scale, "Pa": 1e-7 * at.scale}.get(unit, 0.05)


load_dependent_friction = Law(
    "load_dependent_friction",
    "T = -coefficient (sum of loads) tanh(v / transition_speed)",
    each(*RESISTED, needs=("speed", "bearing_load_1")),
    lambda at: (
        size("coefficient", per(at.unit, at.other("bearing_load_1").unit), _typical(at),
             20.0 * _typical(at), "friction over load", resists=True),
        transition(at),
    ),
    _of_bearing,
    dry=True,
    usual=True,
    source="G. Amontons 1699; journal bearing under radial load",
    look_alikes=("coulomb_friction", "stribeck_friction", "muscle_hysteresis"),
    separated_by="the same motion under a light and under a heavy load",
)  # fmt: skip


def _pulls(at: Place) -> bool:
    """Tell whether a command is a force or torque, or the current that makes one."""
    return "speed" in at.signals and same_dimension(at.unit, "N", "N m", "A")


# What passes a rope around a post, a gear or a screw is less by a factor on its way out, and more
# by it on its way back.
transmission_friction = at_inputs_too(
    Law(
        "transmission_friction",
        "T = drive exp(-share tanh(v / transition_speed) sign drive)",
        each("command", label=by_port, only=_pulls),
        lambda at: (
            size("share", "1", 0.1, 2.0, "logarithm of what goes in over what comes out",
                 resists=True),
            transition(at),
        ),
        lambda at: at.value * ca.exp(-at.p.share * sliding(at) * ca.sign(at.value)),
        dry=True,
        source="L. Euler 1769, J. A. Eytelwein 1808: a rope around a post; efficiency of a gear",
        look_alikes=("coulomb_friction", "load_dependent_friction", "asymmetric_gain"),
        separated_by="the same motion under a small and under a large drive",
    ),
    _pulls,
)  # fmt: skip


def _of_muscle(at: PortView) -> Expression:
    load = at.form.ramp(at.signals.gauge_pressure, 1.0)
    rubs = ca.tanh(at.signals.contraction_speed / at.p.transition_speed)
    return at.value - at.p.coefficient * load * rubs


pressure_friction = Law(
    "pressure_friction",
    "F = -coefficient p tanh(v / transition_speed)",
    twins("muscle_force", needs=("contraction_speed", "gauge_pressure")),
    lambda at: (
        size("coefficient", "N/Pa", 7e-5, 5e-4, "friction over pressure"),
        shape("transition_speed", "m/s", 1e-3, "speed scale of the reversal",
              around=(1e-3, 1e3), fitted=False),
    ),
    _of_muscle,
    dry=True,
    source="G. Amontons 1699; contact of braid and tube under pressure",
    look_alikes=("coulomb_friction", "stribeck_friction", "muscle_hysteresis"),
    separated_by="the same motion at a low and at a high mean pressure",
)  # fmt: skip


def _damped(at: PortView) -> Expression:
    pressure = at.form.ramp(at.signals.gauge_pressure, 1e3)
    damping = at.p.coefficient * (1.0 + at.p.growth * pressure)
    return at.value - damping * at.signals.contraction_speed


muscle_viscosity = Law(
    "muscle_viscosity",
    "F = F0 - coefficient (1 + growth p) v",
    twins("muscle_force", needs=("contraction_speed", "gauge_pressure")),
    lambda at: (
        size("coefficient", "N s/m", 300.0, 5000.0, "damping without pressure",
             source="100 to 800 in the literature"),
        shape("growth", "Pa^-1", 0.0, "relative growth of the damping with pressure",
              between=(0.0, 2e-4), scale=1e-5, source="", refined=True),
    ),
    _damped,
    source="Reynolds, Repperger, Phillips and Bandry, Ann. Biomed. Eng. 31 (2003)",
    look_alikes=("viscous_friction", "quadratic_drag", "series_elasticity"),
    separated_by="swings at low and high mean pressure; a load cell behind one muscle",
)  # fmt: skip


def _joints(survey: Survey) -> Iterator[Fit]:
    for q, places, speed in joint_dampings(survey):
        yield (
            f"_{q.name}",
            tuple((replace(at, parameters=(q,)).with_signal("turning", speed),) for at in places),
        )


def _friction(at: Place) -> tuple[Own, ...]:
    damping, speed = at.changed, at.other("turning")
    typical = damping.scale * speed.scale
    return (
        size("level", per(damping.unit, speed.unit, -1), typical, 50.0 * typical,
             "dry friction level"),
        shape("transition_speed", speed.unit, _SMOOTH * speed.scale, "speed scale of the reversal",
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
    damping, speed = at.changed, at.other("turning")
    typical = damping.scale / speed.scale
    return (
        size("coefficient", per(damping.unit, speed.unit), typical, 50.0 * typical,
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
