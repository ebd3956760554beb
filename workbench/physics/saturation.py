"""Limits of a signal: its range, a dead band, its speed, the steps of a converter.

A share between 0 and 1 is a smaller slope beyond the limit. Starting from share 0 rather than from
a limit out of reach makes the law visible to derivatives.
"""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.model.units import per
from workbench.physics.law import (
    Law,
    Own,
    at_inputs_too,
    by_port,
    drives,
    each,
    first_of,
    sensors,
    shape,
    share,
    size,
    together,
)
from workbench.physics.place import EFFORTS, Place


def _beyond(at: PortView) -> Expression:
    ramp, limit, width = at.form.ramp, at.p.limit, 0.01 * at.scale
    return at.value - at.p.share * (ramp(at.value - limit, width) - ramp(-at.value - limit, width))


def _limit(at: Place, usual: float) -> tuple[Own, ...]:
    far = 20.0 * at.scale
    return (
        share("share of the excess that is cut"),
        shape("limit", at.unit, usual, "the limit", around=(0.05, 20.0),
              between=None if usual > 0.0 else (usual - far, usual + far), scale=at.scale,
              read=at.read),
    )  # fmt: skip


def _limits(at: Place) -> list[dict[str, float]]:
    if at.seen is None:
        return [{"limit": k * at.scale} for k in (1.0, 0.5, 2.0)]
    # Without the limit the signal seems to pass it.
    return [{"limit": k * max(map(abs, at.seen))} for k in (0.8, 0.6, 0.95)]


saturation = at_inputs_too(
    Law(
        "saturation",
        "y = u - share (excess of u beyond the limit, above and below)",
        drives("flow"),
        lambda at: _limit(at, _limits(at)[0]["limit"]),
        _beyond,
        shapes=_limits,
        source="end of the range of a sensor or drive",
        look_alikes=("gain",),
        separated_by="levels on both sides of the limit: below it nothing is changed",
    )
)

_NAMED = (".inflow", ".outflow")
"""Endings of flows whose name has their direction: cutting the negative part does nothing."""


def _lower_limits(at: Place) -> list[dict[str, float]]:
    if at.seen is not None:
        low, high = at.seen
        return [{"limit": low + k * (high - low)} for k in (0.2, 0.05, 0.4)]
    fractions = (0.5, 0.25) if at.name.endswith(_NAMED) else (-1.0, -0.5, 0.5)
    return [{"limit": k * at.scale} for k in fractions]


def _limit_within(at: Place) -> tuple[Own, ...]:
    # Where it is known what was seen, a refit may move it.
    (low, high), far = at.seen or (-math.inf, math.inf), 20.0 * at.scale
    return (
        share("share of the excess that is cut"),
        shape("limit", at.unit, _lower_limits(at)[0]["limit"], "the limit",
              between=(low - far, high + far), scale=at.scale, read=at.read),
    )  # fmt: skip


def _cut_above(at: PortView) -> Expression:
    return at.value - at.p.share * at.form.ramp(at.value - at.p.limit, 0.01 * at.scale)


lower_saturation = replace(
    saturation,
    name="lower_saturation",
    equation="y = u + share (excess of u below the limit)",
    where=drives(),
    parameters=_limit_within,
    transform=lambda at: (
        at.value + at.p.share * at.form.ramp(at.p.limit - at.value, 0.01 * at.scale)
    ),
    shapes=_lower_limits,
)


# `saturation` has the same limit on both sides.
upper_saturation = replace(
    lower_saturation,
    name="upper_saturation",
    equation="y = u - share (excess of u above the limit)",
    where=drives(only=lambda at: at.seen is not None and at.seen[0] < 0.0 < at.seen[1]),
    transform=_cut_above,
    shapes=lambda at: [
        {"limit": sum(at.seen or ()) - shape["limit"]} for shape in _lower_limits(at)
    ],
)


def _stands_high(at: Place) -> bool:
    return at.stands is not None and at.seen is not None and at.stands > sum(at.seen) / 2


def _stands_low(at: Place) -> bool:
    return at.stands is not None and not _stands_high(at)


def _ends(at: Place) -> tuple[float, ...]:
    """Limits worth trying for a sensor: at the end of what it reads, or within its range."""
    if at.seen is not None:
        low, high = at.seen
        if at.stands is not None and _stands_high(at):
            return (at.stands,)
        return high, high - 0.1 * (high - low), high - 0.3 * (high - low)
    if at.unit == "Pa":
        return tuple(k * at.scale for k in (4.0, 3.0, 5.0))
    top = at.signals["measured"].upper if "measured" in at.signals else math.inf
    top = top if math.isfinite(top) else 2.0 * at.scale
    if at.output and math.isfinite(at.output.upper):
        top = min(top, at.output.upper)
    return tuple(k * top for k in (0.75, 0.5, 0.9))


sensor_clipping = replace(
    saturation,
    name="sensor_clipping",
    where=sensors(together=False),
    equation="y = u - share (excess of u above the limit)",
    parameters=lambda at: _limit(at, _ends(at)[0]),
    transform=_cut_above,
    shapes=lambda at: [{"limit": limit} for limit in _ends(at)],
    group="sensor",
    evident=_stands_high,
    look_alikes=("sensor_gain",),
)

# A sensor that reads nothing below its end: only recordings tell of it, by standing there.
lower_sensor_clipping = replace(
    lower_saturation,
    name="lower_sensor_clipping",
    where=sensors(together=False, only=lambda at: at.seen is None or _stands_low(at)),
    parameters=lambda at: _limit(at, _ends(at)[1] if at.stands is None else at.stands),
    shapes=lambda at: ({},),
    group="sensor",
    evident=_stands_low,
    look_alikes=("sensor_gain",),
)


def share_of_sign() -> Own:
    """State how much goes through what passes one sign only; the sign of it is the one."""
    return size("share", "1", 1.0, 1.0, "share of the other sign cut; its own sign passes",
                signed=True)  # fmt: skip


def passing(share: Expression) -> Expression:
    """Return the sign that passes, 1 or -1 (dimensionless), of a signed share (dimensionless)."""
    return ca.if_else(share < 0.0, -1.0, 1.0)


def cut_off(at: PortView, value: Expression) -> Expression:
    """Return what a value loses, in the unit of a port, where its sign does not pass."""
    return at.p.share * at.form.ramp(-passing(at.p.share) * value, 0.01 * at.scale)


# Between two bodies it is a freewheel, between two stores a check valve.
rectification = Law(
    "rectification",
    "y = u + share max(0, -sign(share) u)",
    together(
        drives("flow", only=lambda at: at.role != "heat" and not at.name.endswith(_NAMED)),
        each(*EFFORTS, only=lambda at: at.between and not at.elastic, label=by_port),
    ),
    lambda at: (share_of_sign(),),
    lambda at: at.value + cut_off(at, at.value),
    source="check valve, diode, pump that does not suck, one-way clutch",
    look_alikes=("saturation", "asymmetric_gain", "direction_dependent_viscous"),
    separated_by="commands of both signs",
)


sensor_rectification = Law(
    "sensor_rectification",
    "y = u + share (|u| - u)",
    sensors(
        together=False,
        only=lambda at: "measured" in at.signals and at.signals["measured"].lower < 0.0,
    ),
    lambda at: (size("share", "1", 1.0, 1.0, "share of the magnitude in the reading"),),
    lambda at: at.value + at.p.share * (at.form.absolute(at.value, 0.01 * at.scale) - at.value),
    far=True,
    group="sensor",
    source="magnitude sensors: tachometers, flow meters, rectifiers",
    look_alikes=("sensor_gain", "sensor_clipping"),
    separated_by="the same motion to both sides of zero",
)


def _shifted(at: PortView) -> Expression:
    e, corner = at.value - at.p.centre, 0.02 * at.scale
    above = at.form.ramp(e - at.p.half_width, corner)
    below = at.form.ramp(-e - at.p.half_width, corner)
    return at.p.centre + above - below


def _band(at: Place) -> tuple[Own, ...]:
    usual = (0.1 if at.role == "spool" else 0.05) * at.scale
    return (
        size("half_width", at.unit, usual, at.scale, "half of the band"),
        shape("centre", at.unit, 0.0, "middle of the band", around=None, scale=1.0, source="",
              fitted=False),
    )  # fmt: skip


# At zero width it is the identity on both forms, and the derivative by the width is minus the sign
# of the distance from the centre.
dead_band = at_inputs_too(
    Law(
        "dead_band",
        "y = max(0, u - w) - max(0, -u - w)",
        together(each("spool"), drives()),
        _band,
        _shifted,
        dry=True,
        far=True,
        usual=True,
        source="overlap of a spool, threshold of a drive",
        look_alikes=("play", "spool_hysteresis", "centre_leakage", "backlash"),
        separated_by="a slow triangle about the centre: a dead band has no loop",
    )
)


def _follow(e: EffectView) -> dict[str, Expression]:
    r, tau = e.p.largest_rate, e.p.time_constant
    return {"follower": r * ca.tanh((e.here.value - e.x.follower) / (r * tau))}


# A lag for small differences that follows large ones at its largest rate.
slew_limit = at_inputs_too(Law(
    "slew_limit",
    "dy/dt = r tanh((u - y) / (r tau))",
    first_of(
        each("spool"),
        each("valve_command"),
        each("command", "voltage", "circuit", label=by_port),
    ),
    lambda at: (
        share("share of the limited signal"),
        shape("largest_rate", per(at.unit, "s"), 2.0 * at.scale / at.interval, "largest speed",
              around=(0.01, 10.0)),
        shape("time_constant", "s", 0.5 * at.interval, "time constant of small motions",
              around=(0.1, 100.0), source="", fitted=False),
    ),
    lambda at: at.value + at.p.share * (at.x.follower - at.value),
    states=lambda at: (
        # On its way from anywhere when a recording begins.
        State("follower", at.unit, at.scale, "signal with limited speed",
              start_rms=0.5 * at.scale),
    ),
    rates=_follow,
    start=lambda e: {"follower": e.here.value},
    shapes=lambda at: [{"largest_rate": k * at.scale / at.interval} for k in (2.0, 0.6, 0.2)],
    source="saturated first-order follower; manufacturer: 4 to 5 ms for the full stroke",
    look_alikes=("valve_delay", "spool_bandwidth"),
    separated_by="steps of the command of several sizes: only large ones are slowed",
))  # fmt: skip


def _saw_tooth(at: PortView) -> Expression:
    # The regularised equations keep its first waves.
    turns = at.value / at.p.step
    if not at.form.regularised:
        return turns - ca.floor(turns + 0.5)
    return sum(
        (-1) ** (k + 1) / (math.pi * k) * ca.sin(2.0 * math.pi * k * turns) for k in (1, 2, 3)
    )


sensor_quantisation = Law(
    "sensor_quantisation",
    "y = step round(u / step)",
    sensors(together=False),
    lambda at: (
        share("share of the rounding"),
        shape("step", at.unit, 0.01 * at.scale, "step of the converter", around=(0.01, 100.0)),
    ),
    lambda at: at.value - at.p.share * at.p.step * _saw_tooth(at),
    shapes=lambda at: [{"step": k * at.scale} for k in (0.01, 0.03, 0.1)],
    group="sensor",
    source="W. R. Bennett 1948",
    look_alikes=("sensor_offset", "sensor_gain"),
    separated_by="a slow ramp: the measurement climbs in stairs",
)
