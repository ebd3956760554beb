"""Laws of the arm: its load, the static force, the gas volume and the wall heat of its muscles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import casadi as ca

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.force_laws import PaperLaw, Sarosi
from workbench.physics.gas import chambers, wall_heat
from workbench.physics.law import Fit, Law, each, flag, shape, share, size, twins
from workbench.physics.muscle_volume import BraidedCylinder
from workbench.physics.survey import Survey
from workbench.plants.arm.joint import ArmBody, lever

_BODY = ArmBody()


def _tilted(at: PortView) -> Expression:
    weight = _BODY.gravity_torque(at.signals.angle - at.p.direction, at.signals.load)
    return at.value - ca.sin(at.p.tilt) * weight


tilt_gravity = Law(
    "tilt_gravity",
    "T = -g sin(tilt) sum(m r cos(theta - direction))",
    each("force", needs=("speed", "angle", "load")),
    lambda at: (
        size("tilt", "rad", 0.05, 0.5, "angle of the plane to the level", signed=True),
        shape("direction", "rad", 0.0, "angle of the arm at which its weight pulls most",
              between=(-3.2, 3.2), scale=1.0, source=""),
    ),
    _tilted,
    shapes=lambda at: [{"direction": direction} for direction in (0.0, 0.5 * math.pi)],
    source="statics of a heavy arm in an inclined plane",
    look_alikes=("unbalanced_mass", "ripple", "constant_torque", "force_gain", "linear_spring"),
    separated_by="the same holding positions with another load: only a weight scales",
)  # fmt: skip


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
    return at.value - weight * lever(at.signals.angle, _BODY.plate_centre)


load_error = Law(
    "load_error",
    "J = J + mass r^2, T = T - share g mass x cos(theta)",
    _inertia_and_weight,
    lambda at: (
        size("mass", "kg", 0.5, 8.0, "mass in excess of the notes", signed=True),
        flag("gravity_share", 1.0 if at.others else 0.0, "share of gravity in the plane of motion",
             lower=-1.0),
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
        shape("frequency", "rad/s", 40.0, "natural frequency with the arm held",
              between=(5.0, 300.0)),
        shape("damping", "1", 0.1, "damping ratio", between=(0.0, 2.0)),
    ),
    _loose,
    states=lambda at: (
        State("angle", "rad", 1.0, "angle of the loose load", 0.5),
        State("speed", "rad/s", 1.0, "speed of the loose load"),
    ),
    rates=lambda e: {"angle": e.x.speed, "speed": _coupling(_torque(e))},
    start=lambda e: {name: _torque(e).signals[name] for name in ("angle", "speed")},
    shapes=lambda at: [{"frequency": f} for f in (40.0, 20.0, 10.0, 100.0, 28.0, 14.0)],
    whole=True,
    usual=True,
    far=True,
    source="two-mass oscillator",
    look_alikes=("load_error", "viscous_friction"),
    separated_by="a sweep through the loose load's frequency, or an accelerometer on it",
)  # fmt: skip


REFERENCE_CONTRACTION = 0.03
"""Contraction at which the correction has its full size, m."""

REFERENCE_PRESSURE = 3e5
"""Gauge pressure in the middle of the range, Pa."""

_SAROSI, _PAPER = Sarosi(), PaperLaw()


def _other(at: PortView) -> Expression:
    s = at.signals
    tension = _SAROSI.tension(s.contraction, s.gauge_pressure, form=at.form)
    return at.value + at.p.share * (tension - at.value)


force_shape = Law(
    "force_shape",
    "T = T + share (T_law(q, p) - T)",
    twins("muscle_tension", needs=("contraction", "gauge_pressure")),
    lambda at: (size("share", "1", 0.5, 1.5, "share of the other law", lower=-0.5),),
    _other,
    source="J. Sarosi, Tehnicki vjesnik 22 (2015), for the DMSP-20-200N",
    look_alikes=("contraction_force_correction", "linear_spring", "series_elasticity"),
    separated_by="isometric pressure ramps at several contractions with a load cell",
)

# Unchanged in the middle of the travel, by the gain more at its end and less at its start.
contraction_force_correction = replace(
    force_shape,
    name="contraction_force_correction",
    equation="T = T [1 + gain (2 q / q_end - 1)]",
    parameters=lambda at: (size("gain", "1", 0.1, 0.6, "relative change at 30 mm", signed=True),),
    transform=lambda at: (
        at.value * (1.0 + at.p.gain * (2.0 * at.signals.contraction / REFERENCE_CONTRACTION - 1.0))
    ),
    source="first-order correction of the force over contraction; scatter between muscles",
    look_alikes=("force_shape", "linear_spring", "series_elasticity"),
)

pressure_force_correction = replace(
    force_shape,
    name="pressure_force_correction",
    equation="T = T [1 + gain (p / p_mid - 1)]",
    parameters=lambda at: (size("gain", "1", 0.05, 0.4, "relative change at 6 bar", signed=True),),
    transform=lambda at: (
        at.value * (1.0 + at.p.gain * (at.signals.gauge_pressure / REFERENCE_PRESSURE - 1.0))
    ),
    source="first-order correction of the force over pressure; dead pressure of the tube",
    look_alikes=("force_shape", "sensor_gain", "force_gain"),
    separated_by="the same angle held at low and at high mean pressure",
)

phi_term = replace(
    force_shape,
    name="phi_term",
    equation="T + phi(q)",
    parameters=lambda at: (size("share", "1", 1.0, 2.0, "share of phi(q)", scale=0.5),),
    transform=lambda at: at.value + at.p.share * _PAPER.phi(at.signals.contraction, form=at.form),
    source="equation (4) and line [1] of the paper's Figure 3",
    look_alikes=("linear_spring", "contraction_force_correction"),
    separated_by="the same angle held at low and at high mean pressure",
)


VOLUME_PORTS = ("muscle_1.volume", "muscle_2.volume")
"""Ports of the braid volumes of both muscles."""


def constant_volume() -> Effect:
    """Build muscles whose gas volume does not change with their length.

    ``V = volume``: the simplification of many muscle models, which loses the ripple of the
    open-loop experiment. The volume is that of the DMSP-20-200N in the middle of the arm's travel,
    at 15 mm of contraction.
    """
    middle = float(BraidedCylinder().volume(0.185))
    source = "volume of the braid at 15 mm of contraction"
    text = "constant volume inside the braid"
    return Effect(
        "constant_volume",
        VOLUME_PORTS,
        lambda at: at.p.volume,
        parameters=(Parameter("volume", "m3", 0.0, text, middle, 1e-6, 1e-3, source),),
        about=About("V = constant", "simplification; the paper's lines [6] to [10] left out"),
    )


def printed_volume() -> Effect:
    """Build the gas volume as it is printed in the paper, with its four defects.

    ``V = V_cyl(s) + 2 V_zone`` with n in the unit of a length and without the square root in d.
    """
    braid = BraidedCylinder(printing="as_printed")
    return Effect(
        "printed_volume",
        VOLUME_PORTS,
        lambda at: braid.volume(at.signals.fibre_length, form=at.form),
        about=About("V = V_cyl(s) + 2 V_zone", "lines [6] to [10] of the paper's Figure 3"),
    )


AREA = 0.0126
"""Wetted area of one chamber, m^2."""

_EXCHANGE = "Q = h S (T_wall - T)"


def _wall(at: PortView, area: Expression) -> Expression:
    s = at.signals
    return wall_heat(s.temperature, s.wall_temperature, coefficient=at.p.coefficient, area=area)


heat_exchange = Law(
    "heat_exchange",
    _EXCHANGE,
    chambers(),
    lambda at: (
        size("coefficient", "W/(m2 K)", 150.0, 1e5, "heat transfer coefficient", scale=100.0,
             source="estimate; the paper's model has 200"),
        shape("area", "m2", AREA, "wetted area of one chamber", between=(1e-5, 1.0),
              source="paper, Figure 2", fitted=False),
    ),
    lambda at: at.value + _wall(at, at.p.area),
    source="line [15] of the paper's Figure 3",
    look_alikes=("polytropic_exchange",),
    separated_by="steps of pressure: how fast the pressure relaxes after the valve shuts",
)  # fmt: skip


def _beside_exchange(survey: Survey) -> Iterator[Fit]:
    if survey.attached(_EXCHANGE):
        yield from heat_exchange.where(survey)


# Large, it is isothermal; the negative of the plant's own, adiabatic.
extra_heat_exchange = replace(
    heat_exchange,
    name="extra_heat_exchange",
    equation="Q + h S (T_wall - T)",
    where=_beside_exchange,
    parameters=lambda at: (
        size("coefficient", "W/(m2 K)", 200.0, 1e4, "heat transfer coefficient in excess",
             lower=-150.0),
    ),
    transform=lambda at: at.value + _wall(at, AREA),
    source="convection at the wall; beyond the range of the plant's own coefficient",
    look_alikes=("heat_exchange", "polytropic_exchange"),
)  # fmt: skip


gas_energy_balance = Law(
    "gas_energy_balance",
    "Q + share (h S (T_wall - T) - Q)",
    chambers(isothermal=True),
    lambda at: (
        share("share of the exchange with the wall"),
        shape("coefficient", "W/(m2 K)", 150.0, "heat transfer coefficient", between=(0.0, 1000.0),
              scale=100.0, source=""),
    ),
    lambda at: at.value + at.p.share * (_wall(at, AREA) - at.value),
    source="line [15] of the paper's Figure 3",
    look_alikes=("chamber_leakage",),
    separated_by="steps of pressure: how fast the pressure relaxes after the valve shuts",
)  # fmt: skip
