"""Play: a follower that stays until its slack is taken up."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from workbench.model import EffectView, Names, PortView, State
from workbench.model.regularisation import Expression, maximum
from workbench.model.units import SPEEDS, same_dimension
from workbench.physics.hysteresis import stretch_rate, stretched
from workbench.physics.law import (
    Law,
    by_port,
    each,
    flag,
    floor,
    known,
    sensors,
    shape,
    size,
    size_at,
    together,
)
from workbench.physics.offset_gain import sensor_error
from workbench.physics.place import COORDINATES, EFFORTS
from workbench.physics.saturation import cut_off, passing, share_of_sign

play = Law(
    "play",
    "y = u - w clip(z, -1, 1), z the stretch of a spring behind a dry contact that slips at w",
    each("spool", needs=("speed",)),
    lambda at: (
        size_at(at, "half_width", 0.03, 0.5, "half of the slack"),
        shape("floor", at.unit, 0.005 * at.scale, "motion added to the reach", fitted=False),
    ),
    lambda at: at.value - at.p.half_width * stretched(at.x.slack, at.form),
    states=lambda at: (State("slack", "1", 1.0, "slack taken up, -1 to 1", start_rms=0.5),),
    rates=lambda e: {
        "slack": stretch_rate(
            e.here.signals.speed, e.x.slack, e.p.half_width + e.p.floor, form=e.form
        )
    },
    dry=True,
    usual=True,
    source="Krasnosel'skii and Pokrovskii 1989, play operator",
    look_alikes=("command_play", "spool_hysteresis", "dead_band"),
    separated_by="slow triangles of several amplitudes about the centre",
)

spool_hysteresis = replace(
    play,
    name="spool_hysteresis",
    equation="y = u - w clip(z, -1, 1), z the stretch of a spring behind a dry contact",
    parameters=lambda at: (
        size_at(at, "half_width", 0.02, 0.5, "half of the loop"),
        shape("reach", at.unit, 0.05 * at.scale, "motion over which the loop turns",
              around=(0.1, 20.0)),
    ),
    rates=lambda e: {
        "slack": stretch_rate(e.here.signals.speed, e.x.slack, e.p.reach, form=e.form)
    },
    usual=False,
    source="manufacturer: hysteresis at most 0.4 % of stroke",
    look_alikes=("play", "dead_band"),
)  # fmt: skip


def _magnitude(value: Expression) -> Expression:
    return maximum(value, -value)


def _clipped(e: Expression, w: Expression) -> Expression:
    """Return clip(e, -w, w), written so that its derivative by w at w = 0 is the sign of e."""
    return 0.5 * (_magnitude(e + w) - _magnitude(e - w))


def _beyond(e: Expression, w: Expression) -> Expression:
    return maximum(e - w, 0.0) - maximum(-e - w, 0.0)


def _follow(view: EffectView) -> dict[str, Expression]:
    w, floor = view.p.half_width, view.p.floor
    e, w = view.here.value - view.x.follower, w + floor * floor / (floor + w)
    return {"follower": _beyond(e, w) / view.p.time}


_SLACK = 0.03
"""Usual half of a slack, over the scale of what has it; a follower begins as near."""

command_play = Law(
    "command_play",
    "y = u - clip(u - s, -w, w), s within w of u",
    each("valve_command"),
    lambda at: (
        size_at(at, "half_width", _SLACK, 0.5, "half of the slack"),
        shape("floor", at.unit, 0.001 * at.scale, "slack added to the follower's", fitted=False),
        known("time", "s", 0.4 * at.interval, "time in which the follower comes near"),
    ),
    lambda at: at.value - _clipped(at.value - at.x.follower, at.p.half_width),
    # A wider guess leaves the slack, beyond which a filter does not learn where it is.
    states=lambda at: (
        State("follower", at.unit, at.scale, "position of the follower",
              start_rms=_SLACK * at.scale),
    ),
    rates=_follow,
    # Somewhere within its slack: a start in the middle would have no derivative at size zero.
    start=lambda e: {"follower": e.here.value - e.p.floor},
    dry=True,
    family="play",
    usual=True,
    source="Krasnosel'skii and Pokrovskii 1989, play operator",
    look_alikes=("play", "spool_hysteresis", "dead_band"),
    separated_by="slow triangles of several amplitudes about the centre",
)  # fmt: skip

backlash = replace(
    command_play,
    name="backlash",
    where=each("command", "voltage", "circuit", label=by_port),
    family="",
    look_alikes=("dead_band", "delay"),
    separated_by="slow triangles of several amplitudes: play has a loop, a dead band none",
)

_BANDS = (0.02, 0.05, 0.01, 0.1, 0.005, 0.2, 0.002)
"""Bands in which something may stick, over the scale of what is told to it."""

_AT_ONCE, _ARRIVED, _BEGUN = 0.05, 0.001, 0.02
"""Time of a jump over the sampling interval, how near to its end it is over, over the band, and
from which part of its speed on it goes on by itself."""


def _goes(at: PortView) -> Expression:
    """Return 1 from where something that sticks lets go until it has arrived, 0 otherwise."""
    away = _magnitude(at.value - at.x.stuck) / at.p.band
    goes_on = ca.logic_and(at.x.moving > _BEGUN, away > _ARRIVED)
    return ca.if_else(ca.logic_or(away > 1.0, goes_on), 1.0, 0.0)


def _stuck(at: PortView) -> Expression:
    # What goes is there at once: the state that remembers where it is needs some of the interval.
    return at.value - at.p.share * (1.0 - _goes(at)) * (at.value - at.x.stuck)


def _jumps(view: EffectView) -> dict[str, Expression]:
    at, time = replace(view.here, x=view.x), _AT_ONCE * view.p.interval
    return {
        "stuck": at.x.moving * (at.value - at.x.stuck) / time,
        "moving": (_goes(at) - at.x.moving) / time,
    }


# The packing of a control valve, a slide that is seldom moved: it stays, and then goes all the way.
command_stiction = Law(
    "command_stiction",
    "y = u - share (u - s), s stays until |u - s| > band, and then jumps to u",
    together(each("valve_command"), each("command", "voltage", "circuit", label=by_port)),
    lambda at: (
        size("share", "1", 0.5, 1.0, "part of the command that goes through what sticks"),
        shape("band", at.unit, 0.02 * at.scale, "change of the command that moves it",
              around=(0.02, 25.0), fitted=False),
        known("interval", "s", at.interval, "sampling interval, in which it jumps"),
    ),
    _stuck,
    states=lambda at: (
        # A recording begins anywhere within the band, long before the first jump perhaps.
        State("stuck", at.unit, 0.02 * at.scale, "where it is", start_rms=0.01 * at.scale),
        State("moving", "1", 0.1, "1 while it moves", start_rms=1e-8),
    ),
    rates=_jumps,
    start=lambda e: {"stuck": e.here.value},
    shapes=lambda at: [{"band": part * at.scale} for part in _BANDS],
    tells="band",
    dry=True,
    stiff=True,
    source="A. Stenman, F. Gustafsson and K. Forsman 2003; M. A. A. S. Choudhury et al. 2005",
    look_alikes=("command_play", "backlash", "dead_band", "spool_hysteresis"),
    separated_by="a slow ramp: what sticks answers in steps",
)  # fmt: skip

_PLAYS = 4
"""Play operators of a loop."""


def _widths(p: Names) -> list[Expression]:
    return [p.reach * p.spread**i for i in range(_PLAYS)]


def _held_back(at: PortView) -> Expression:
    """Return what the loop keeps back of a signal, in its unit."""
    kept, whole = 0.0, 0.0
    for i, w in enumerate(_widths(at.p)):
        e, height = at.value - at.x[f"follower_{i + 1}"], at.p.spread ** (i * at.p.growth)
        kept += height * _clipped(e, w) / w
        whole += height
    return at.p.level * kept / whole


def _follow_all(view: EffectView) -> dict[str, Expression]:
    rates = {}
    for i, w in enumerate(_widths(view.p)):
        e = view.here.value - view.x[f"follower_{i + 1}"]
        rates[f"follower_{i + 1}"] = _beyond(e, w) / view.p.time
    return rates


# What follows its command along a loop: a stack of piezo ceramic, iron in a coil, a positioner.
command_hysteresis = replace(
    backlash,
    name="command_hysteresis",
    equation="y = u - level sum(h_i clip(u - s_i, -w_i, w_i) / w_i) / sum(h_i), s_i within w_i"
    " of u, w_i = reach spread^(i-1), h_i = w_i^growth",
    parameters=lambda at: (
        size_at(at, "level", 0.05, 0.5, "half width of the loop", signed=True),
        shape("reach", at.unit, 0.05 * at.scale, "half width of the first operator",
              around=(0.02, 20.0)),
        shape("spread", "1", 2.0, "ratio of the widths of neighbouring operators",
              between=(1.2, 6.0), scale=1.0),
        shape("growth", "1", 0.5, "how fast the height of an operator grows with its width",
              between=(-2.0, 4.0), scale=1.0),
        *command_play.parameters(at)[-1:],
    ),
    transform=lambda at: at.value - _held_back(at),
    states=lambda at: tuple(
        State(f"follower_{i + 1}", at.unit, at.scale, f"position of follower {i + 1}",
              start_rms=_SLACK * 2.0**i * at.scale)
        for i in range(_PLAYS)
    ),
    rates=_follow_all,
    start=lambda e: {f"follower_{i + 1}": e.here.value for i in range(_PLAYS)},
    shapes=lambda at: [{"reach": part * at.scale} for part in (0.05, 0.01, 0.2)],
    usual=False,
    source="L. Prandtl 1928, A. Yu. Ishlinskii 1944; piezo ceramics, magnets, valve positioners",
    look_alikes=("backlash", "drive_lag", "dead_band"),
    separated_by="slow triangles of several amplitudes: the loop of small ones is narrower",
)  # fmt: skip

sensor_play = replace(
    backlash,
    name="sensor_play",
    where=sensors(together=False, only=lambda at: at.unit in COORDINATES.values()),
    parameters=lambda at: (
        size_at(at, "half_width", sensor_error(at), 1.0, "half of the slack"),
        *command_play.parameters(at)[1:],
    ),
    group="sensor",
    source="slack in the coupling of an encoder",
    look_alikes=("sensor_delay", "sensor_lag", "sensor_quantisation"),
    separated_by="slow triangles: what lags behind at any speed is play",
)


_ENDS = 0.05
"""Last part of the slack, over half of it, in which what it joins begins to meet."""


def _slack_taken(at: PortView) -> Expression:
    x, w = ca.SX(at.signals.coordinate), at.p.half_width
    inside = _clipped(x, w)
    free = ca.fmin(ca.fmax((w - _magnitude(x)) / (_ENDS * w + at.p.floor), 0.0), 1.0)
    # What two bodies pass on for the speed of one over the other.
    damping = at.signals.speed * _slope(at, at.signals.speed)
    return at.value - _slope(at, x) * inside - at.p.parted * free * damping


def _slope(at: PortView, local: Expression) -> Expression:
    """Return the derivative of a port's signal by a place or speed that it sees."""
    x = ca.SX(local)
    symbol = ca.symvar(x)[0]
    return ca.jacobian(ca.SX(at.value), symbol) / ca.jacobian(x, symbol)


elastic_play = Law(
    "elastic_play",
    "T = T(x - clip(x, -w, w)), without its damping where |x| < w",
    each(*EFFORTS, needs=("coordinate", "speed"), only=lambda at: at.elastic),
    lambda at: (
        size_at(at.coordinate, "half_width", 0.05, 5.0, "half of the slack"),
        known("floor", at.coordinate.unit, 1e-3 * at.coordinate.scale, "motion in which they meet"),
        # Within the slack, bodies that meet there pass on nothing at all.
        flag(
            "parted", 1.0 if at.speed.minus else 0.0, "1 where what damps lies behind the slack too"
        ),
    ),
    _slack_taken,
    family="backlash",
    usual=True,
    source="M. Nordin and P.-O. Gutman 2002: slack in series with spring and damper",
    look_alikes=("cubic_stiffness", "polynomial_stiffness", "linear_spring"),
    separated_by="small deflections to both sides: within the slack there is no force",
)


def _let_go(e: EffectView) -> dict[str, Expression]:
    side = passing(e.p.share)
    beyond = e.form.ramp(side * (e.here.signals.coordinate - e.x.slip), e.p.floor)
    return {"slip": side * beyond / e.p.time}


def _overtaken(at: PortView) -> Expression:
    slack = _slope(at, at.signals.coordinate) * at.x.slip
    return at.value - _magnitude(at.p.share) * slack + cut_off(at, at.value - slack)


# A ratchet, a sprag clutch: what overtakes is let go, and taken along again at once.
freewheel = Law(
    "freewheel",
    "T = sign(share) max(0, sign(share) T(x - s)), s goes with x where that would turn",
    each(*EFFORTS, needs=("coordinate", "speed"), only=lambda at: at.between and at.elastic),
    lambda at: (
        share_of_sign(),
        known("floor", at.coordinate.unit, 1e-4 * at.coordinate.scale,
              "distance over which it takes hold in regularised equations"),
        known("time", "s", 0.05 * at.interval, "time in which what overtakes is let go"),
    ),
    _overtaken,
    states=lambda at: (
        State("slip", at.coordinate.unit, at.coordinate.scale, "how far it was overtaken",
              start_rms=1e-8 * at.coordinate.scale),
    ),
    rates=_let_go,
    far=True,
    stiff=True,
    source="one-way clutch behind a spring",
    look_alikes=("elastic_play", "direction_dependent_viscous"),
    separated_by="drive one body slower than the other, and faster again",
)  # fmt: skip


def _taken_up(at: PortView) -> Expression:
    """Return the rate, in 1/s, at which a drive moves within its slack, over half of that."""
    speed, z = ca.SX(at.value), ca.SX(at.x.slack)
    ahead = ca.fmin(ca.fmax((z - 1.0 + _ENDS) / _ENDS, 0.0), 1.0)
    behind = ca.fmin(ca.fmax((-z - 1.0 + _ENDS) / _ENDS, 0.0), 1.0)
    met = ca.if_else(speed > 0.0, ahead, behind)
    reach = at.p.half_width + at.p.floor * _magnitude(speed) + 1e-300
    return speed * (1.0 - met) / reach


# A feed by a screw, a syringe, the stem of a valve that a motor turns: what is told is a speed, and
# what the drive moves within its slack is lost at each reversal.
lost_motion = Law(
    "lost_motion",
    "v = u - w dz/dt, w z the place of the drive within its slack, -w to w",
    each("command", label=by_port, only=lambda at: same_dimension(at.unit, *SPEEDS)),
    lambda at: (
        size("half_width", at.unit.removesuffix("/s"), 0.01 * at.scale * at.lasting,
             at.scale * at.lasting, "half of the slack"),
        floor(at, 0.05),
    ),
    lambda at: at.value - at.p.half_width * _taken_up(at),
    states=lambda at: (
        State("slack", "1", 1.0, "slack taken up, -1 to 1", 0.0, -1.05, 1.05, 0.5),
    ),
    rates=lambda e: {"slack": _taken_up(replace(e.here, x=e.x, p=e.p))},
    dry=True,
    far=True,
    source="slack of a screw or coupling behind a drive that is told a speed",
    look_alikes=("backlash", "dead_band", "delay"),
    separated_by="reversals after long and after short strokes: the same stroke is lost at each",
)  # fmt: skip
