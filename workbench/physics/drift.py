"""What changes with time: sensors that warm up, gains that fade, jumps, also of a parameter."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import casadi as ca

from workbench.errors import TIMES_S
from workbench.model import PortView, State
from workbench.model.regularisation import Expression
from workbench.model.scope import EffectView
from workbench.model.units import per
from workbench.physics.law import (
    Fit,
    Law,
    Own,
    by_port,
    drives,
    each,
    floor,
    known,
    sensors,
    shape,
    size,
    size_at,
    together,
    with_subject,
)
from workbench.physics.offset_gain import sensor_error
from workbench.physics.parameter_arguments import entering
from workbench.physics.place import EFFORTS, FLOWS, Place
from workbench.physics.survey import Survey

_WIDTH = 0.03
"""Half-width of a jump whose time is still to be found, as a fraction of the recording."""

_FRACTIONS = (0.5, 0.3, 0.7, 0.15, 0.85)
"""Times of a jump that are worth trying, as fractions of the recording."""


def warming(at: Place, typical: float) -> tuple[Own, ...]:
    """State by how much, over the scale of a place, something usually drifts, and how fast.

    Args:
        typical: The usual drift over that scale, dimensionless.
    """
    s = typical * at.scale
    return (
        size("amount", at.unit, s, 5.0 * s, "drift by the end of the recordings", signed=True),
        *_warmed(at),
    )


def _warmed(at: Place) -> tuple[Own, Own]:
    """Return the pace of what warms up, and when all of its amount is reached.

    The amount is that at the end of the recordings: of a ramp, which has no other end, it is known
    as well as of what has come to rest.
    """
    one = 1.0 / at.lasting
    return (
        shape("rate_constant", "1/s", one, "1 / time constant; 0 of a ramp, below if it gains pace",
              between=(-3.0 * one, 20.0 * one), scale=one, read="1/s"),
        known("lasting", "s", at.lasting, "length of the recordings"),
    )  # fmt: skip


_WARM = State("warm", "1", 1.0, "share of the amount reached", start_rms=1e-3)

_RAMP = 1e-3
"""Rate constant over that of the recordings' length within which a series has all digits."""


def _warming_up(e: EffectView) -> dict[str, Expression]:
    along = e.p.rate_constant * e.p.lasting
    ramp, wide = ca.fabs(along) < _RAMP, ca.if_else(ca.fabs(along) < _RAMP, 1.0, along)
    reached = ca.if_else(ramp, 1.0 - along / 2.0 + along**2 / 6.0, (1.0 - ca.exp(-wide)) / wide)
    return {"warm": (1.0 / reached - along * e.x.warm) / e.p.lasting}


sensor_drift = Law(
    "sensor_drift",
    "y = u + amount w, w = (1 - exp(-k t)) / (1 - exp(-k lasting)), k = rate_constant",
    sensors(together=False),
    lambda at: warming(at, sensor_error(at)),
    lambda at: at.value + at.p.amount * at.x.warm,
    states=lambda at: (_WARM,),
    rates=_warming_up,
    tells="lasting",
    group="sensor",
    source="thermal zero drift of a bridge",
    look_alikes=("sensor_offset", "creep", "chamber_leakage"),
    separated_by="the same holding position at the start and at the end of a recording",
)


def from_first(
    begins: Mapping[str, float], first: str, reached: float
) -> tuple[float, dict[str, float]]:
    """Count the share that was reached in each recording from that at the start of the first one.

    Args:
        begins: Share of the amount reached at the start of each recording, dimensionless.
        reached: ``1 - exp(-k lasting)``, dimensionless.

    Returns:
        The factor of the amount that goes with it, and the shares; dimensionless.
    """
    rest = 1.0 - begins[first] * reached
    return rest, {name: (share - begins[first]) / rest for name, share in begins.items()}


# What an input of the model reaches at once.
_driven = drives("force", "acceleration", "flow", "heat", only=lambda at: at.driven)

gain_fade = Law(
    "gain_fade",
    "y = u (1 + amount w), w = (1 - exp(-k t)) / (1 - exp(-k lasting)), k = rate_constant",
    _driven,
    lambda at: (
        size("amount", "1", 0.1, 1.0, "change of the gain by the end of the recordings",
             signed=True),
        *_warmed(at),
    ),
    lambda at: at.value * (1.0 + at.p.amount * at.x.warm),
    states=lambda at: (_WARM,),
    rates=_warming_up,
    tells="lasting",
    source="warming of a drive, a battery that runs down, a filter that clogs",
    look_alikes=("gain", "gain_jump", "creep"),
    separated_by="the same motion at the start and at the end of a recording",
)  # fmt: skip

sensor_fade = replace(
    gain_fade,
    name="sensor_fade",
    where=sensors(together=False),
    group="sensor",
    source="fouling of a probe, ageing of a light source",
    look_alikes=("sensor_gain", "sensor_drift", "gain_fade"),
)


def passed(at: PortView) -> Expression:
    """Return the fraction of a jump that is there: 0 before its time, 1 after, 0 once it ended."""
    # What is sharper than samples show has no slope by its time.
    width = ca.sqrt(at.p.width**2 + at.p.floor**2)

    def over(clock: Expression, time: Expression) -> Expression:
        return 0.5 + 0.5 * ca.tanh((clock - time) / width)

    ended = over(at.x.clock_of_end, at.p.time + at.p.duration) if "duration" in at.p else 0.0
    return over(at.x.clock, at.p.time) - ended


def when(at: Place) -> tuple[Own, ...]:
    """Return the parameters of a jump: its time, and a width that begins so wide as to be seen.

    Of a sharp jump at the wrong time nothing says in which direction the right time lies. What
    ends on the lower bound of the time was there from the start: it is no jump.
    """
    known = at.recorded.duration
    return (
        shape("time", "s", _FRACTIONS[0] * at.lasting, "time of the jump",
              between=(_WIDTH * known, known or TIMES_S[1]), scale=0.1 * at.lasting),
        shape("width", "s", _WIDTH * at.lasting, "half-width of the jump",
              around=(2e-3, 5.0), source="", fitted=False),
        floor(at, 0.5),
    )  # fmt: skip


_pushed = together(
    _driven,
    each(*EFFORTS, needs=("speed",), label=by_port),
    each(*FLOWS, label=by_port, only=lambda at: bool(at.store) and not at.empty),
    each("valve_command", label=by_port),
)

offset_jump = Law(
    "offset_jump",
    "y = u + amount step(t - time)",
    _pushed,
    lambda at: (
        size_at(at, "amount", 0.05, 1.0, "height of the jump", signed=True),
        *when(at),
    ),
    lambda at: at.value + at.p.amount * passed(at),
    states=lambda at: (
        State("clock", "s", at.recorded.duration or 6.0 * at.lasting, "time since the start",
              start_rms=1e-8 * at.lasting),
    ),
    rates=lambda e: {name: 1.0 + 0.0 * clock for name, clock in e.x.items()},
    shapes=lambda at: [{"time": k * at.lasting} for k in _FRACTIONS],
    moment="time",
    source="an event: something slipped, came loose or was switched",
    look_alikes=("offset", "gain_jump", "constant_torque", "constant_force", "valve_offset"),
    separated_by="the event again at two levels of the drive: an offset is the same at both",
)  # fmt: skip


def for_a_while(jump: Law) -> Law:
    """Return the law of what jumps and jumps back, where most of what is missing acts once."""

    def parameters(at: Place) -> tuple[Own, ...]:
        begin, end = at.recorded.episode or (0.0, at.horizon)
        own = {q.name: q for q in jump.parameters(at)}
        first = max(begin, own["time"].lower)
        own["time"] = replace(own["time"], value=first, scale=0.1 * (end - begin))
        own["duration"] = shape("duration", "s", end - begin, "how long it lasts",
                                around=(0.05, 5.0), scale=0.1 * (end - begin))  # fmt: skip
        own["width"] = replace(own["width"], value=_WIDTH * (end - begin))
        return tuple(own.values())

    return replace(
        jump,
        name=jump.name.replace("jump", "pulse"),
        equation=jump.equation.replace("step(t - time)", "(0 < t - time < duration)"),
        where=lambda survey: jump.where(survey) if survey.recorded.episode else (),
        parameters=parameters,
        # It may end earlier or later in one recording than in another.
        states=lambda at: tuple(
            replace(q, name=name) for q in jump.states(at) for name in (q.name, f"{q.name}_of_end")
        ),
        shapes=lambda at: ({},),
        source="a door that stood open, a gust, a load that was put on and taken off",
        look_alikes=(jump.name,),
    )


offset_pulse = for_a_while(offset_jump)


def _wave(
    at: Place, usual: float, when: str = "when it first rises through zero"
) -> tuple[Own, ...]:
    period = at.recorded.period or at.horizon
    apart = min(0.5, period / at.lasting)
    return (
        size_at(at, "amplitude", usual, 200.0 * usual, "amplitude", signed=True),
        shape("period", "s", period, "period", around=(1.0 - apart, 1.0 + apart),
              scale=0.1 * apart * period, source=""),
        shape("time", "s", 0.0, when, between=(-2.0 * period, 2.0 * period), scale=0.1 * period,
              source=""),
        shape("flatness", "1", 0.0, "0 for a sine, large for a square wave", between=(0.0, 1e3),
              scale=1.0, source=""),
        floor(at, 0.5),
    )  # fmt: skip


def _sine(at: PortView, late: float = 0.0) -> Expression:
    return ca.sin(2.0 * math.pi * ((at.x.clock - at.p.time) / at.p.period - late))


def _waved(at: PortView, wave: Expression | None = None) -> Expression:
    wave = _sine(at) if wave is None else wave
    # No edge is steeper than samples show.
    flatness = at.p.flatness / (1.0 + at.p.flatness * (math.pi * at.p.floor / at.p.period) ** 2)
    flattened = ca.sqrt((1.0 + flatness * wave * wave) / (1.0 + flatness))
    return at.value + at.p.amplitude * wave / flattened


def _shone(at: PortView) -> Expression:
    # Its middle is a quarter of a period after a sine of that time rises through zero.
    night = ca.cos(math.pi * at.p.part)
    return _waved(at, at.form.ramp(_sine(at, -0.25) - night, 0.05) / (1.0 - night))


# Its period is that of what the model has left of the recordings.
periodic_push = replace(
    offset_jump,
    name="periodic_push",
    equation="y = u + amplitude s sqrt((1 + flatness) / (1 + flatness s^2)),"
    " s = sin(2 pi (t - time) / period)",
    where=each(
        *EFFORTS, "flow", "heat", "current",
        only=lambda at: at.recorded.period > 0.0 and not at.commanded, label=by_port,
    ),
    parameters=lambda at: _wave(at, 0.1),
    transform=_waved,
    shapes=lambda at: [
        {"time": part * (at.recorded.period or at.horizon), "flatness": flatness}
        for flatness in (0.0, 10.0)
        for part in (0.0, 0.25)
    ],
    period="period",
    source="a machine beside it, mains, day and night",
    look_alikes=("sensor_hum", "periodic_pulse", "ripple"),
    separated_by="a recording at rest: it goes on there",
)  # fmt: skip

# The sun, a shift at work, a pump that runs for a while: the rest of the period it is not there.
periodic_pulse = replace(
    periodic_push,
    name="periodic_pulse",
    equation="y = u + amplitude r sqrt((1 + flatness) / (1 + flatness r^2)), r = max(0,"
    " (cos(2 pi (t - time) / period) - c) / (1 - c)), c = cos(pi part)",
    parameters=lambda at: (
        *_wave(at, 0.1, "when it is strongest"),
        shape("part", "1", 0.3, "part of the period in which it acts", between=(0.02, 0.98),
              scale=0.1),
    ),
    transform=_shone,
    shapes=lambda at: [
        {"time": late / 8.0 * (at.recorded.period or at.horizon), "part": part, "flatness": 10.0}
        for part in (0.12, 0.25, 0.45)
        for late in range(8)
    ],
    part="part",
    source="the sun on a day, a shift at work, what is switched on and off by a clock",
    look_alikes=("periodic_push",),
)  # fmt: skip

sensor_hum = replace(
    periodic_push,
    name="sensor_hum",
    where=sensors(together=False, only=lambda at: at.recorded.period > 0.0),
    parameters=lambda at: _wave(at, sensor_error(at)),
    group="sensor",
    source="pick-up of mains, light or vibration",
    look_alikes=("periodic_push",),
)


def _turned(at: Place) -> tuple[Own, ...]:
    stride = at.stride or at.scale * at.horizon
    most = max(map(abs, at.seen)) if at.seen else at.scale
    apart = min(0.5, stride / (most * at.lasting))
    return (
        size("amount", "1", 0.02, 1.0, "amplitude, relative to the signal", signed=True),
        shape("stride", per(at.unit, "1/s"), stride, "what passes in one turn",
              around=(1.0 - apart, 1.0 + apart), scale=0.1 * apart * stride, source=""),
    )  # fmt: skip


# A roll or wheel that is not round, the teeth of a pump: what repeats with each turn repeats the
# faster the faster it turns, and where it begins in a recording nobody knows.
uneven_turn = Law(
    "uneven_turn",
    "y = u (1 + amount sin(a)), da/dt = 2 pi u / stride, a begins otherwise in each recording",
    drives("flow", only=lambda at: at.stride > 0.0),
    _turned,
    lambda at: at.value * (1.0 + at.p.amount * ca.sin(at.x.turn)),
    states=lambda at: (State("turn", "1", 1.0, "how far it has turned", start_rms=2.0),),
    rates=lambda e: {"turn": 2.0 * math.pi * e.here.value / e.p.stride},
    begins="turn",
    far=True,
    source="eccentric rolls and wheels, pulsation of pumps, meshing of gears",
    look_alikes=("periodic_push", "ripple"),
    separated_by="runs at two constant speeds: it repeats with what has passed, not with time",
)


gain_jump = replace(
    offset_jump,
    name="gain_jump",
    where=_driven,
    equation="y = u (1 + amount step(t - time))",
    parameters=lambda at: (
        size("amount", "1", 0.1, 1.0, "relative height of the jump", signed=True),
        *when(at),
    ),
    transform=lambda at: at.value * (1.0 + at.p.amount * passed(at)),
    look_alikes=("gain", "offset_jump", "gain_fade"),
    separated_by="the event again at two levels of the drive: a gain grows with it",
)

gain_pulse = for_a_while(gain_jump)

sensor_jump = replace(
    offset_jump,
    name="sensor_jump",
    where=sensors(together=False),
    parameters=lambda at: (
        size_at(at, "amount", sensor_error(at), 5.0 * sensor_error(at), "height of the jump",
                signed=True),
        *when(at),
    ),
    group="sensor",
    look_alikes=("sensor_offset", "sensor_drift"),
    separated_by="the event again beside a reference: the machine itself does not jump",
)  # fmt: skip


sensor_pulse = for_a_while(sensor_jump)


def _each_parameter(survey: Survey) -> Iterator[Fit]:
    for q, places in entering(survey):
        yield (
            f"_{q.name.replace('.', '_')}",
            (tuple(replace(at, parameters=(q,)) for at in places),),
        )


def parameter_amount(at: Place) -> Own:
    """State by how much the parameter that changes at a place usually does."""
    if not at.parameters:
        return size("amount", "1", 1.0, 10.0, "change of the parameter", signed=True)
    q = at.parameters[0]
    return size_at(q, "amount", 0.3, 10.0, f"change of {q.name}", signed=True)


def _changed(at: PortView, part: Expression) -> Expression:
    return with_subject(at, at.subject + at.p.amount * part)


# Offered for every refitted parameter, of the plant or of an effect of it, that enters the
# equations through one port alone, or through several in all of them.
parameter_jump = replace(
    offset_jump,
    name="parameter_jump",
    equation="parameter + amount step(t - time)",
    where=_each_parameter,
    parameters=lambda at: (parameter_amount(at), *when(at)),
    transform=lambda at: _changed(at, passed(at)),
    of_parameter=True,
    source="an event: a part that slipped, seized, or was switched",
    look_alikes=("parameter_fade", "gain_jump", "offset_jump"),
    separated_by="the event again at two levels of the drive: it grows with what it multiplies",
)

parameter_pulse = for_a_while(parameter_jump)

# What ages goes on from one recording to the next: where it begins there is not known.
parameter_fade = replace(
    gain_fade,
    name="parameter_fade",
    equation="parameter + amount w, w' = k (1 / (1 - exp(-k lasting)) - w), k = rate_constant",
    where=_each_parameter,
    parameters=lambda at: (parameter_amount(at), *_warmed(at)),
    transform=lambda at: _changed(at, at.x.warm),
    states=lambda at: (replace(_WARM, start_rms=1.0),),
    begins="warm",
    of_parameter=True,
    source="warming, wear, ageing",
    look_alikes=("parameter_jump", "gain_fade", "parameter_by_recording"),
)


# A load that was changed, a room that was warmer, a zero that is set when the power comes on.
offset_by_recording = Law(
    "offset_by_recording",
    "y = u + amount level, one level in each recording",
    _pushed,
    lambda at: (size_at(at, "amount", 0.05, 1.0, "offset at a level of one"),),
    lambda at: at.value + at.p.amount * at.x.level,
    states=lambda at: (State("level", "1", 1.0, "level of a recording", 1.0, start_rms=2.0),),
    rates=lambda e: {"level": 0.0 * e.x.level},
    begins="level",
    level=True,
    source="what was changed between recordings",
    look_alikes=("offset", "valve_offset", "offset_jump", "constant_force", "constant_torque"),
    separated_by="two recordings that follow one another without a break",
)

sensor_offset_by_recording = replace(
    offset_by_recording,
    name="sensor_offset_by_recording",
    where=sensors(together=False),
    parameters=lambda at: (
        size_at(at, "amount", sensor_error(at), 5.0 * sensor_error(at), "offset at a level of one"),
    ),
    group="sensor",
    source="a zero that is set at power-on",
    look_alikes=("sensor_offset", "sensor_drift"),
)

# At a force that is all that moves a body: of another load it moves more, or less.
gain_by_recording = replace(
    offset_by_recording,
    name="gain_by_recording",
    equation="y = u (1 + amount level), one level in each recording",
    where=together(
        _driven, each(*EFFORTS, needs=("speed",), label=by_port, only=lambda at: at.whole)
    ),
    parameters=lambda at: (size("amount", "1", 0.1, 1.0, "relative change at a level of one"),),
    transform=lambda at: at.value * (1.0 + at.p.amount * at.x.level),
    look_alikes=("gain", "gain_fade", "parameter_by_recording"),
)

parameter_by_recording = replace(
    offset_by_recording,
    name="parameter_by_recording",
    equation="parameter + amount level, one level in each recording",
    where=_each_parameter,
    parameters=lambda at: (replace(parameter_amount(at), lower=0.0),),
    transform=lambda at: _changed(at, at.x.level),
    of_parameter=True,
    look_alikes=("parameter_fade", "parameter_jump", "gain_by_recording"),
)
