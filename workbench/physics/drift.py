"""What changes with time: sensors that warm up, gains that fade, jumps, also of a parameter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import casadi as ca

from workbench.errors import TIMES_S
from workbench.model import Effect, Model, Parameter, PortView, State
from workbench.model.regularisation import Expression
from workbench.model.scope import EffectView, Names
from workbench.model.units import per, same_dimension
from workbench.physics.law import (
    Fit,
    Law,
    Own,
    Site,
    by_port,
    drives,
    each,
    floor,
    known,
    sensors,
    shape,
    share,
    size,
    together,
    with_subject,
)
from workbench.physics.offset_gain import sensor_error
from workbench.physics.parameter_arguments import (
    argument,
    dissipating,
    driving,
    may_bend_over,
    own_states,
    own_vector,
)
from workbench.physics.place import EFFORTS, FLOWS, Local, Place
from workbench.physics.survey import Survey

_WIDTH = 0.03
"""Half-width of a jump whose time is still to be found, as a fraction of the recording."""

_FRACTIONS = (0.5, 0.3, 0.7, 0.15, 0.85)
"""Times of a jump that are worth trying, as fractions of the recording."""


def warming(typical: Callable[[Place], float]) -> Callable[[Place], tuple[Own, ...]]:
    """State by how much, over the scale of a place, something usually drifts, and how fast."""

    def parameters(at: Place) -> tuple[Own, ...]:
        s = typical(at) * at.scale
        return (
            size("amount", at.unit, s, 5.0 * s, "drift by the end of the recordings", signed=True),
            *_warmed(at),
        )

    return parameters


def _warmed(at: Place) -> tuple[Own, Own]:
    """Return the pace of what warms up, and when all of its amount is reached.

    The amount is that at the end of the recordings: of a ramp, which has no other end, it is known
    as well as of what has come to rest.
    """
    one = 1.0 / at.lasting
    return (
        shape("rate_constant", "1/s", one, "1 / time constant; 0 of a ramp, below if it gains pace",
              around=None, between=(-3.0 * one, 20.0 * one), scale=one, read="1/s"),
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
    warming(sensor_error),
    lambda at: at.value + at.p.amount * at.x.warm,
    states=lambda at: (_WARM,),
    rates=_warming_up,
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
_driven = drives("force", "acceleration", "flow", only=lambda at: at.driven)

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
        shape("time", "s", _FRACTIONS[0] * at.lasting, "time of the jump", around=None,
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
        size("amount", at.unit, 0.05 * at.scale, at.scale, "height of the jump", signed=True),
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
    separated_by="a repetition of the recording: an event does not repeat",
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
    usual: Callable[[Place], float], when: str = "when it first rises through zero"
) -> Callable[[Place], tuple[Own, ...]]:
    def parameters(at: Place) -> tuple[Own, ...]:
        period = at.recorded.period or at.horizon
        apart = min(0.5, period / at.lasting)
        return (
            size("amplitude", at.unit, usual(at) * at.scale, 200.0 * usual(at) * at.scale,
                 "amplitude", signed=True),
            shape("period", "s", period, "period", around=(1.0 - apart, 1.0 + apart),
                  scale=0.1 * apart * period, source=""),
            shape("time", "s", 0.0, when, around=None,
                  between=(-2.0 * period, 2.0 * period), scale=0.1 * period, source=""),
            shape("flatness", "1", 0.0, "0 for a sine, large for a square wave", around=None,
                  between=(0.0, 1e3), scale=1.0, source=""),
            floor(at, 0.5),
        )  # fmt: skip

    return parameters


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
    parameters=_wave(lambda at: 0.1),
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
        *_wave(lambda at: 0.1, "when it is strongest")(at),
        shape("part", "1", 0.3, "part of the period in which it acts", around=None,
              between=(0.02, 0.98), scale=0.1),
    ),
    transform=_shone,
    shapes=lambda at: [
        {"time": late * (at.recorded.period or at.horizon), "part": part}
        for part in (0.15, 0.4)
        for late in (0.0, 0.25, 0.5, 0.75)
    ],
    part="part",
    source="the sun on a day, a shift at work, what is switched on and off by a clock",
    look_alikes=("periodic_push",),
)  # fmt: skip

sensor_hum = replace(
    periodic_push,
    name="sensor_hum",
    where=sensors(together=False, only=lambda at: at.recorded.period > 0.0),
    parameters=_wave(sensor_error),
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
)

gain_pulse = for_a_while(gain_jump)

sensor_jump = replace(
    offset_jump,
    name="sensor_jump",
    where=sensors(together=False),
    parameters=lambda at: (
        size("amount", at.unit, sensor_error(at) * at.scale,
             5.0 * sensor_error(at) * at.scale, "height of the jump", signed=True),
        *when(at),
    ),
    group="sensor",
    look_alikes=("sensor_offset", "sensor_drift"),
)  # fmt: skip


sensor_pulse = for_a_while(sensor_jump)


def _entering(survey: Survey) -> Iterator[tuple[Parameter, tuple[Place, ...]]]:
    """Yield refitted parameters, each with the ports that bring it into the equations."""
    yield from ((q, (at,)) for at in survey.places for q in at.parameters)
    yield from survey.spread


def _each_parameter(survey: Survey) -> Iterator[Fit]:
    for q, places in _entering(survey):
        yield (
            f"_{q.name.replace('.', '_')}",
            (tuple(replace(at, parameters=(q,)) for at in places),),
        )


def gained(survey: Survey) -> Iterator[tuple[Parameter, tuple[Place, ...]]]:
    """Yield refitted parameters of the plant, gains of what is driven too, with their ports."""
    entering = [*_entering(survey), *((q, (at,)) for at in survey.places for q in at.gains)]
    yield from ((q, places) for q, places in entering if "." not in q.name)


def _changing(q: Parameter, places: Sequence[Place], *over: Local) -> tuple[Site, ...]:
    """Return the ports of a parameter that changes there with a signal: one, or one of each."""
    each_over = over if len(over) > 1 else over * len(places)
    return tuple(
        (replace(at, parameters=(q,)).with_signal("over", own),)
        for at, own in zip(places, each_over, strict=True)
    )


def _each_parameter_over(survey: Survey) -> Iterator[Fit]:
    for q, places in (*gained(survey), *survey.fixed):
        for over in may_bend_over(survey, q, places):
            ends = "_".join(filter(None, (over.source, over.minus)))
            yield f"_{q.name}_over_{ends}", _changing(q, places, over)
        through = survey.passing(q) or places
        if q.fitted and (own := own_states(survey, through)):
            yield f"_{q.name}_over_each_{own[0].source}", _changing(q, through, *own)
            if vector := own_vector(own):
                yield f"_{q.name}_over_all_{own[0].source}", _changing(q, through, vector)


def _amount(at: Place) -> Own:
    if not at.parameters:
        return size("amount", "1", 1.0, 10.0, "change of the parameter", signed=True)
    q = at.parameters[0]
    return size("amount", q.unit, 0.3 * q.scale, 10.0 * q.scale,
                f"change of {q.name}", signed=True)  # fmt: skip


def _changed(at: PortView, part: Expression) -> Expression:
    return with_subject(at, at.subject + at.p.amount * part)


# Offered for every refitted parameter, of the plant or of an effect of it, that enters the
# equations through one port alone, or through several in all of them.
parameter_jump = replace(
    offset_jump,
    name="parameter_jump",
    equation="parameter + amount step(t - time)",
    where=_each_parameter,
    parameters=lambda at: (_amount(at), *when(at)),
    transform=lambda at: _changed(at, passed(at)),
    of_parameter=True,
    source="an event: a part that slipped, seized, or was switched",
    look_alikes=("parameter_fade", "gain_jump", "offset_jump"),
)

parameter_pulse = for_a_while(parameter_jump)

# What ages goes on from one recording to the next: where it begins there is not known.
parameter_fade = replace(
    gain_fade,
    name="parameter_fade",
    equation="parameter + amount w, w' = k (1 / (1 - exp(-k lasting)) - w), k = rate_constant",
    where=_each_parameter,
    parameters=lambda at: (_amount(at), *_warmed(at)),
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
    lambda at: (size("amount", at.unit, 0.05 * at.scale, at.scale, "offset at a level of one"),),
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
        size("amount", at.unit, sensor_error(at) * at.scale, 5.0 * sensor_error(at) * at.scale,
             "offset at a level of one"),
    ),
    group="sensor",
    source="a zero that is set at power-on",
    look_alikes=("sensor_offset", "sensor_drift"),
)  # fmt: skip

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
)  # fmt: skip

parameter_by_recording = replace(
    offset_by_recording,
    name="parameter_by_recording",
    equation="parameter + amount level, one level in each recording",
    where=_each_parameter,
    parameters=lambda at: (replace(_amount(at), lower=0.0),),
    transform=lambda at: _changed(at, at.x.level),
    of_parameter=True,
    look_alikes=("parameter_fade", "parameter_jump", "gain_by_recording"),
)


def _range(at: Place) -> tuple[Own, Own]:
    """Return middle and half of the range of what a parameter changes with."""
    over = at.other("over")
    low, high = over.seen or (over.start - over.scale, over.start + over.scale)
    return (
        shape("middle", over.unit, 0.5 * (low + high), "middle of the range seen",
              around=None, source="", fitted=False),
        known("reach", over.unit, 0.5 * (high - low) or 1.0, "half of the range seen"),
    )  # fmt: skip


def _shift(at: Place) -> Own:
    """Return by how much a parameter that no refit changes is off in the middle of its curve."""
    q = at.parameters[0] if at.parameters else None
    unit, scale = (q.unit, q.scale) if q else ("1", 1.0)
    return shape("shift", unit, 0.0, "change in the middle of a parameter that is not refitted",
                 around=None, between=(-10.0 * scale, 10.0 * scale), scale=0.3 * scale, source="",
                 fitted=q is not None and not q.fitted)  # fmt: skip


def _never_negative(at: Place) -> float:
    """Return 1 for a parameter that is never negative, 0 for another."""
    return 1.0 if at.parameters and at.parameters[0].lower >= 0.0 else 0.0


def _added_up(at: Place) -> tuple[Own, Own]:
    """Return whether a parameter falls towards zero only, and whether it does so by a sum."""
    text = "1 for a parameter that falls towards zero only"
    return (
        shape("one_sided", "1", _never_negative(at), text, around=None, between=(0.0, 1.0),
              source="", fitted=False),
        shape("added", "1", 0.0, "1 where it does so by a sum, 0 by factors", around=None,
              between=(0.0, 1.0), source="", fitted=False),
    )  # fmt: skip


_STEEP = 20.0
"""Steepness of what is a step."""


def _curves(at: Place) -> tuple[dict[str, float], ...]:
    """Return a line, a parabola, a step where the signal changes its sign, and what falls by a sum.

    What is charged resists otherwise than what is discharged.
    """
    straight, parabola = {"bend": 0.0, "added": 0.0}, {"bend": 0.5 * math.pi}
    curves = (straight, parabola, *[{"added": 1.0}] * int(_never_negative(at)))
    low, high = at.other("over").seen or (0.0, 0.0)
    if not low < 0.0 < high:
        return curves
    return (*curves, {"place": -(low + high) / (high - low), "steepness": _STEEP})


_MOST_GROWN, _LEAST_LEFT = 10.0, 1e-3
"""Logarithm of how much larger than in the middle a parameter may be at an end of its curve, and
what of it there is left at least where it falls by a sum; dimensionless."""


def _bent(at: PortView) -> Expression:
    return with_subject(at, _curve(at.p, ca.SX(at.subject), at.signals.over))


def _curve(p: Names, own: Expression, over: Expression) -> Expression:
    steep = p.steepness + 1e-6
    along = ca.tanh(steep * ((over - p.middle) / p.reach - p.place)) / ca.tanh(steep)
    change = p.shift + p.amount * (ca.cos(p.bend) * along + ca.sin(p.bend) * (along**2 - 1.0))
    # What is never negative falls and grows by factors, or by a sum as far as that goes.
    grown = own * ca.exp(ca.fmin(change / (own + 1e-300), _MOST_GROWN))
    kept = ca.if_else(p.added > 0.5, ca.fmax(own + change, _LEAST_LEFT * own), grown)
    return ca.if_else(p.one_sided > 0.5, kept, own + change)


def along_curve(model: Model, effect: Effect) -> dict[float, float]:
    """Return a parameter that is a curve, in SI, by the signal that it changes with, in SI.

    At both ends of what was seen of that and in the middle; empty of any other effect.
    """
    curve = _CURVES.get(effect.about.equation)
    if curve is None:
        return {}
    own = {q.name: model.parameter(f"{effect.name}.{q.name}").value for q in effect.parameters}
    p, value = Names("parameter", own), model.parameter(effect.about.subject).value
    places = [p.middle + side * p.reach for side in (-1.0, 0.0, 1.0)]
    return {float(at): float(curve(p, value, ca.DM(at))) for at in places}


def _resisting(survey: Survey) -> Iterator[Fit]:
    """Yield parameters that divide or multiply what drives a flow: a resistance, a conductance."""
    for q, places in gained(survey):
        fills = q.lower >= 0.0 and any(at.role in FLOWS for at in places)
        if fills and (over := driving(survey, q, places)):
            yield f"_{q.name}", _changing(q, places, over)


def _hindered(at: PortView) -> Expression:
    root = ca.sqrt(1.0 + 4.0 * at.p.part * ca.fabs(at.signals.over) / at.p.largest + 1e-12)
    own, times = ca.SX(at.subject), 0.5 * (1.0 + root)
    conducts = ca.jacobian(ca.jacobian(ca.SX(at.value), own), own).is_zero()
    return with_subject(at, own / times if conducts else own * times)


# The smaller the flow the more it is laminar: r q + part r^2 / d q |q| = d at the largest drive d.
turbulent_flow = Law(
    "turbulent_flow",
    "q (1 + sqrt(1 + 4 part |d| / d_largest)) / 2 = d / resistance",
    _resisting,
    lambda at: (
        size("part", "1", 0.3, 100.0, "turbulent part of the resistance, over the laminar one"),
        shape(
            "largest", "1", at.other("over").largest, "largest drive seen", source="", fitted=False
        ),
    ),
    _hindered,
    of_parameter=True,
    source="J. Weisbach 1845: losses of bends, valves and orifices",
    look_alikes=("parameter_curve", "outflow_exponent"),
    separated_by="small flows against large ones, in both directions",
)


def _polarised(survey: Survey) -> Iterator[Fit]:
    """Yield resistances of what a current passes through: electrodes resist more a small one."""
    for q, places in gained(survey):
        passed = dissipating(survey, q, places)
        if passed and same_dimension(q.unit, "ohm") and same_dimension(passed.unit, "A"):
            yield f"_{q.name}", _changing(q, places, passed)


def _activation(at: Place) -> tuple[Own, ...]:
    most = at.other("over").largest
    volts = most * (at.parameters[0].scale if at.parameters else 1.0)
    return (
        size("slope", "V", 0.1 * volts, 100.0 * volts, "voltage for e times the current"),
        shape("exchange_current", "A", 0.02 * most, "current of the electrode in both directions"
              " at rest", around=(1e-4, 50.0)),
    )  # fmt: skip


def _activated(at: PortView) -> Expression:
    doubled = 2.0 * at.p.exchange_current
    current = ca.sqrt(at.signals.over**2 + (1e-6 * doubled) ** 2)
    return with_subject(at, at.subject + at.p.slope * ca.asinh(current / doubled) / current)


# Batteries, fuel cells, electrolysers, baths of a plater.
activation_overvoltage = Law(
    "activation_overvoltage",
    "resistance i + slope asinh(i / (2 exchange_current))",
    _polarised,
    _activation,
    _activated,
    of_parameter=True,
    source="J. Tafel 1905; Bard and Faulkner, Electrochemical Methods, 2001, 3.4 (Butler-Volmer)",
    look_alikes=("parameter_curve", "offset"),
    separated_by="small currents against large ones, in both directions",
)


# A parameter that is none: it changes with what is measured. Bl of a loudspeaker with the excursion
# of the coil, the force of a magnet with the current that saturates its iron, a resistance with a
# temperature.
parameter_curve = Law(
    "parameter_curve",
    "parameter + c, or parameter exp(c / parameter) as well where it is never negative,"
    " c = shift + amount (cos(bend) z + sin(bend) (z^2 - 1)), z = tanh(s (x - place)) / tanh(s),"
    " s = steepness, x = (signal - middle) / reach",
    _each_parameter_over,
    lambda at: (
        _amount(at),
        shape("bend", "rad", 0.0, "from a straight line, 0, to a parabola, pi/2",
              around=None, between=(-math.pi, math.pi), scale=1.0),
        shape("place", "1", 0.0, "where it is steepest, over half of the range seen",
              around=None, between=(-1.5, 1.5), scale=0.3, refined=True),
        shape("steepness", "1", 0.0, "how much it is a step there, from a straight line, 0",
              around=None, between=(0.0, 30.0), scale=1.0, refined=True),
        _shift(at),
        *_added_up(at),
        *_range(at),
    ),
    _bent,
    shapes=_curves,
    # A straight line is as steep everywhere.
    details={"steepness": 4.0},
    of_parameter=True,
    source="saturating iron, warm windings, fields that fade at the ends of a travel",
    look_alikes=("parameter_fade", "parameter_jump", "cubic_stiffness"),
    separated_by="the same motion about several positions",
)  # fmt: skip


def _raised(survey: Survey) -> Iterator[Fit]:
    """Yield parameters that are never negative, each with a signal that is not either."""
    for suffix, sites in _each_parameter_over(survey):
        at = sites[0][0]
        low, high = at.other("over").seen or (0.0, 0.0)
        if at.parameters[0].fitted and _never_negative(at) and 0.0 <= low < 0.7 * high:
            yield suffix, sites


def _power(p: Names, own: Expression, over: Expression) -> Expression:
    share = over / p.middle
    return own * ca.fmax(share, _LEAST_LEFT) ** p.exponent


# The coefficient of a film with a flow, a resistance of a wire with an absolute temperature.
parameter_power = replace(
    parameter_curve,
    name="parameter_power",
    equation="parameter (signal / middle)^exponent",
    where=_raised,
    parameters=lambda at: (
        size("exponent", "1", 0.5, 5.0, "exponent of the signal", signed=True),
        *_range(at),
    ),
    transform=lambda at: with_subject(at, _power(at.p, ca.SX(at.subject), at.signals.over)),
    shapes=lambda at: ({},),
    details={},
    source="F. Dittus and L. Boelter 1930: films of heat, by flow^0.8; similarity laws",
    look_alikes=("parameter_curve", "parameter_fade"),
    separated_by="the same motion at a small and at a large value of the signal",
)


def _halved(p: Names, own: Expression, over: Expression) -> Expression:
    share = ca.fmax(over / p.middle, _LEAST_LEFT)
    return own / (1.0 + p.part * share**-p.exponent)


# Oil with air in it, by the square of its pressure; an uptake by what is taken up, or by what
# poisons it; a film over which something else stands in the way.
parameter_hill = replace(
    parameter_power,
    name="parameter_hill",
    equation="parameter / (1 + part (middle / signal)^exponent)",
    parameters=lambda at: (
        size("part", "1", 0.3, 100.0, "what stands in its way in the middle, over the parameter"),
        shape("exponent", "1", 1.0, "exponent of the signal", around=None, between=(-6.0, 6.0)),
        *_range(at),
    ),
    transform=lambda at: with_subject(at, _halved(at.p, ca.SX(at.subject), at.signals.over)),
    shapes=lambda at: [{"exponent": k} for k in (1.0, 2.0, -1.0, -2.0)],
    source="A. V. Hill 1910; J. Monod 1949; H. E. Merritt 1967, 2.3: air in oil; resistances in a"
    " row",
    look_alikes=("parameter_curve", "parameter_power"),
)

_CURVES = {
    parameter_curve.equation: _curve,
    parameter_power.equation: _power,
    parameter_hill.equation: _halved,
}
"""What laws of parameters that are curves of a signal make of one, by their equation."""


def _terms(survey: Survey) -> Iterator[Fit]:
    for q, places in gained(survey):
        if over := argument(survey, q, places):
            yield f"_{q.name}", _changing(q, places, over)


def _drive(at: Place) -> Local:
    return at.other("over")


def _clipped(at: PortView) -> Expression:
    over, knee = ca.fabs(at.signals.over) / at.p.limit + 1e-12, at.p.knee
    left = (1.0 + over ** (1.0 / knee)) ** -knee
    return with_subject(at, ca.SX(at.subject) * (1.0 - at.p.share * (1.0 - left)))


_HARD = 0.02
"""Knee of what is clipped."""


# The speed that a position loop asks for, the torque that a coupling or a belt holds, the current
# that a converter gives: what the equations ask of it in proportion ends somewhere.
term_saturation = Law(
    "term_saturation",
    "parameter x / (1 + |x / limit|^(1/knee))^knee, x what it multiplies",
    _terms,
    lambda at: (
        share("share of the excess that is cut"),
        shape("limit", _drive(at).unit, 0.5 * _drive(at).scale, "the limit of what it multiplies",
              around=(0.01, 20.0)),
        shape("knee", "1", _HARD, "how gently it sets in: a clip, 0, to a hyperbola, 1",
              around=None, between=(_HARD, 1.5), scale=0.2, refined=True),
    ),
    _clipped,
    shapes=lambda at: [
        {"limit": k * _drive(at).scale, "knee": knee}
        for k, knee in ((0.5, _HARD), (0.8, _HARD), (0.25, _HARD), (0.1, _HARD), (0.5, 0.5))
    ],
    of_parameter=True,
    source="limits of speed, torque and current within cascaded loops; C. Rapp 1991; belts, tyres",
    look_alikes=("slew_limit", "saturation", "parameter_curve"),
    separated_by="steps from small to large: the answer to the large ones takes longer",
)  # fmt: skip
