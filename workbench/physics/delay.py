"""What comes late: pure delays and first-order lags."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import casadi as ca

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.model.scope import Names
from workbench.physics.law import (
    Fit,
    Law,
    Own,
    at_inputs_too,
    by_port,
    drives,
    each,
    floor,
    sensors,
    shape,
    size,
)
from workbench.physics.place import FLOWS, Place, Survey


def _constant(p: Names) -> Expression:
    """Time constant with what keeps it regular, in s: f at zero time, nothing beside a long one."""
    return p.time + p.floor * p.floor / (p.time + p.floor)


def _lagging(at: PortView) -> Expression:
    return at.value - at.p.time / _constant(at.p) * (at.value - at.x.memory)


def _filtered(at: PortView) -> Expression:
    over = 2.0 * at.p.floor / _constant(at.p)
    kept = ca.exp(-over)
    late = (1.0 - kept) / over - kept
    past = at.p.sampled * late / (kept + late)
    return at.value - (1.0 - past) * at.p.time / _constant(at.p) * (at.value - at.x.memory)


sensor_lag = Law(
    "sensor_lag",
    "Y / U = (1 + g s) / (1 + (time + g) s)",
    sensors(),
    lambda at: (
        size("time", "s", 10 * at.interval, 250 * at.interval, "time constant"),
        shape("sampled", "1", 0.0, "whether it filters samples", around=None, between=(0.0, 1.0),
              fitted=False),
        floor(at, 0.5),
    ),
    _filtered,
    states=lambda at: (
        State("memory", at.unit, at.scale, f"lagging signal of {at.name}",
              start_rms=0.05 * at.scale),
    ),
    rates=lambda e: {"memory": (e.here.value - e.x.memory) / _constant(e.p)},
    start=lambda e: {"memory": e.here.value},
    shapes=lambda at: ({"sampled": 0.0}, {"sampled": 1.0}),
    usual=True,
    group="sensor",
    far=True,
    source="first-order lag",
    look_alikes=("sensor_delay", "clock_shift", "line"),
    separated_by="steps faster than the lag, beside a fast reference sensor",
)  # fmt: skip

drive_lag = at_inputs_too(
    replace(
        sensor_lag,
        name="drive_lag",
        where=drives(),
        parameters=lambda at: (
            size("time", "s", 25 * at.interval, 5e6 * at.interval, "time constant"),
            floor(at, 0.5),
        ),
        transform=_lagging,
        shapes=lambda at: ({},),
        group="process",
        look_alikes=("delay", "slew_limit"),
        separated_by="steps of the command: a lag answers at once, a delay waits",
    )
)


def _ahead(at: PortView) -> Expression:
    lead = 0.5 * at.p.interval / (at.p.interval + at.p.floor)
    return at.value + lead * (at.value - at.x.memory)


def _sampled_inputs(survey: Survey) -> Iterator[Fit]:
    """Yield what inputs reach at once, but no port whose inputs all have ports of their own."""
    own = {c.source for q in survey.places if q.commanded for c in survey.causes(q)}
    for end, ((at,),) in drives("force", "acceleration", "flow", only=lambda q: q.driven)(survey):
        if at.commanded or any(c.source not in own for c in survey.causes(at)):
            yield end, ((at,),)


# A simulation holds each sample. An input that ran in a straight line was ahead of that by half a
# sampling interval on average, which a lead that fades within the interval gives back.
input_interpolation = Law(
    "input_interpolation",
    "y = u + (u - m) / 2, dm/dt = (u - m) / interval",
    _sampled_inputs,
    lambda at: (
        size("interval", "s", 10 * at.interval, 5e4 * at.interval, "interval between samples"),
        floor(at, 0.5),
    ),
    _ahead,
    states=lambda at: (
        State("memory", at.unit, at.scale, "what was held", start_rms=0.05 * at.scale),
    ),
    rates=lambda e: {"memory": (e.here.value - e.x.memory) / (e.p.interval + e.p.floor)},
    start=lambda e: {"memory": e.here.value},
    far=True,
    source="zero-order and first-order hold of sampled signals",
    look_alikes=("clock_shift", "delay"),
    separated_by="record the input faster than it changes",
)


def _spare(p: Names, time: Expression) -> Expression:
    """Time g = f^2 / (D + f), in s: f at zero delay, nothing beside a long one."""
    return p.floor * p.floor / (time + p.floor)


def _times(usual: float, largest: float, lead: float = 0.0) -> Callable[[Place], tuple[Own, ...]]:
    """State a delay by sampling intervals: usual, largest plausible."""
    return lambda at: (
        size("time", "s", usual * at.interval, largest * at.interval, "delay",
             lower=-lead * at.interval if lead else None),
        floor(at, 1.0),
    )  # fmt: skip


_SECTIONS = ("", "_2")
"""Parts of a delay, one after the other, by what ends the names of their states."""


def _parts(
    at: PortView, parts: tuple[str, ...]
) -> Iterator[tuple[Expression, Expression, tuple[Expression, ...]]]:
    """Yield what comes out of each part of a delay, what its series leaves, and its states."""
    value, time = at.value, at.p.time / len(parts)
    spare = _spare(at.p, time)
    share = spare / (time + spare)
    for part in parts:
        late, slope, bend = (at.x[f"{name}{part}"] for name in ("late", "slope", "bend"))
        rest = value - late - slope - 0.5 * bend
        smooth = late + share * (slope + 0.5 * share * bend)
        value = smooth + share * share * share * rest
        yield value, rest, (slope, bend)


def _delayed(at: PortView, parts: tuple[str, ...]) -> Expression:
    *_, (value, _, _) = _parts(at, parts)
    return value


def _rates(e: EffectView, parts: tuple[str, ...]) -> dict[str, Expression]:
    # Derivatives times powers of the time constant, so that all have the signal's unit.
    time = e.p.time / len(parts)
    whole = time + _spare(e.p, time)
    rates: dict[str, Expression] = {}
    for part, (_, rest, (slope, bend)) in zip(
        parts, _parts(replace(e.here, x=e.x), parts), strict=True
    ):
        each = {"late": slope, "slope": bend, "bend": 6.0 * rest}
        rates |= {f"{name}{part}": rate / whole for name, rate in each.items()}
    return rates


def _states(at: Place) -> tuple[State, ...]:
    return tuple(
        State(kind, at.unit, at.scale, text, start_rms=0.05 * at.scale)
        for kind, text in (
            ("late", "filtered signal"),
            ("slope", "its rate times D + g"),
            ("bend", "the rate of that times D + g"),
        )
    )


def _states_of_parts(at: Place) -> tuple[State, ...]:
    return tuple(replace(q, name=f"{q.name}{k}") for k in _SECTIONS for q in _states(at))


def _from(value: Expression) -> dict[str, Expression]:
    """Return where a delay starts that has had a value for long."""
    return {f"late{section}": value for section in _SECTIONS}


def _commands(survey: Survey) -> tuple[Place, ...]:
    return tuple(q for q in survey.places if q.role in ("command", "valve_command") or q.commanded)


def _common_clock(survey: Survey) -> Iterator[Fit]:
    found = survey.fitting("measurement")
    if len(found) > 1:
        yield "", tuple((q,) for q in found)


def _late_input(survey: Survey, _: Place) -> tuple[str, ...]:
    """Name the delay of the only input: whatever moves is late by it, or is read late by it."""
    commands, alone = _commands(survey), survey.inputs_alone
    if len(survey.model.inputs) != 1 or len(commands) + len(alone) != 1:
        return ()
    if alone:
        return (f"delay_{alone[0].signals['cause'].source}",)
    (only,) = commands
    return ("valve_delay" if only.role == "valve_command" else f"delay_{by_port(only)}",)


def _late_readings(survey: Survey, at: Place) -> tuple[str, ...]:
    if not _late_input(survey, at):
        return ()
    read = [q.output.name for q in survey.fitting("measurement") if q.output]
    return (f"sensor_delay_{read[0]}",) if len(read) == 1 else ("clock_shift",)


def _late_only_reading(survey: Survey, at: Place) -> tuple[str, ...]:
    return _late_input(survey, at) if len(survey.fitting("measurement")) == 1 else ()


# Y / U = E(g s) / E((D + g) s) with E(x) = 1 + x + x^2 / 2 + x^3 / 6: exactly the identity for
# D = 0, and exp(-D s) up to s^3 for all D. Its zeros are stable, so that a filter can tell the
# signal from the measurement; the error of its amplitude is (w D)^4 / 24 at the frequency w, an
# eighth of that for two halves one after the other. Down to -f / 2 it is a lead, so that a fit may
# pass through zero. Steps overshoot: a command that jumps
# has a law of its own.
sensor_delay = Law(
    "sensor_delay",
    "Y / U = exp(-D s), each half to third order",
    sensors(),
    _times(5, 100, lead=0.5),
    lambda at: _delayed(at, _SECTIONS),
    states=_states_of_parts,
    rates=lambda e: _rates(e, _SECTIONS),
    start=lambda e: _from(e.here.value),
    usual=True,
    group="sensor",
    far=True,
    source="B. Taylor 1715, of the inverse",
    same_as=_late_only_reading,
    look_alikes=("sensor_lag",),
    separated_by="sines of two frequencies: the phase of a delay is proportional to both",
)


clock_shift = replace(
    sensor_delay,
    name="clock_shift",
    where=_common_clock,
    transform=lambda at: _delayed(at, ("",)),
    states=_states,
    rates=lambda e: _rates(e, ("",)),
    start=lambda e: {"late": e.here.value},
    same_as=_late_input,
    usual=False,
    look_alikes=("valve_delay", "spool_bandwidth", "sensor_delay"),
    separated_by="a common event seen by command and measurements, such as a click",
)


def _sections(at: PortView) -> Iterator[tuple[Expression, Expression, tuple[Expression, ...]]]:
    """Yield what comes out of each section of a delay, what its series leaves, and its states."""
    value, time = at.value, at.p.time / len(_SECTIONS)
    r = time / (time + _spare(at.p, time))
    for section in _SECTIONS:
        late, slope, bend = (at.x[f"{name}{section}"] for name in ("late", "slope", "bend"))
        rest = value - late - 0.6 * slope - 0.15 * bend
        smooth = late + (0.6 - r) * slope + (0.15 - 0.6 * r + 0.5 * r * r) * bend
        value = smooth + (1.0 - 9.0 * r + 18.0 * r * r - 10.0 * r * r * r) * rest
        yield value, rest, (slope, bend)


def _delayed_command(at: PortView) -> Expression:
    *_, (value, _, _) = _sections(at)
    return value


def _command_rates(e: EffectView) -> dict[str, Expression]:
    time = e.p.time / len(_SECTIONS)
    b = time + _spare(e.p, time)
    rates: dict[str, Expression] = {}
    for section, (_, rest, (slope, bend)) in zip(
        _SECTIONS, _sections(replace(e.here, x=e.x)), strict=True
    ):
        each = {"late": slope, "slope": bend, "bend": 60.0 * rest}
        rates |= {f"{name}{section}": rate / b for name, rate in each.items()}
    return rates


# Y / U = N(s) / P(b s) with P(x) = 1 + 3 x/5 + 3 x^2/20 + x^3/60, b = D + g and N the series of
# exp(-D s) P(b s) up to s^3: exactly the identity for D = 0, exp(-D s) up to s^3 between, and the
# Pade function of second over third order for D >> f, of which no part of a jump comes through at
# once. Two halves of the delay, one after the other: the error at a frequency w goes by (w D)^6.
delay = at_inputs_too(
    Law(
        "delay",
        "Y / U = exp(-D s), Pade functions of second over third order of both halves",
        drives(),
        _times(5, 50),
        _delayed_command,
        states=_states_of_parts,
        rates=_command_rates,
        start=lambda e: _from(e.here.value),
        far=True,
        same_as=_late_readings,
        usual=True,
        source="H. Pade 1892",
        look_alikes=("clock_shift", "sensor_delay"),
        separated_by="steps of the command beside a fast sensor of what it moves",
    )
)

valve_delay = replace(
    delay,
    name="valve_delay",
    where=each("valve_command"),
    parameters=_times(2.5, 50),
    look_alikes=("clock_shift", "spool_bandwidth", "slew_limit"),
    separated_by="steps of the command beside a fast spool or flow sensor",
)


def _ways(survey: Survey) -> Iterator[Fit]:
    for place in survey.fitting(*FLOWS, needs=("level",)):
        for level in survey.arriving(place) if place.store else ():
            at = place.with_signal("arriving", level)
            yield f"_{level.source}_{place.store}", ((at,),)


def _arriving(at: Place) -> Place:
    """Return the level that arrives late as if it were the signal of the place."""
    level = at.other("arriving")
    return replace(at, port=replace(at.port, unit=level.unit, scale=level.scale, sized=True))


def _arrived(at: PortView) -> PortView:
    return replace(at, value=at.signals.arriving)


# Pipes, ducts and belts: what leaves a store as it is now arrives in the next one later.
transport_delay = replace(
    delay,
    name="transport_delay",
    equation="q(s(t)) = q(s(t - D)), Pade functions of second over third order of both halves",
    where=_ways,
    transform=lambda at: ca.substitute(
        ca.SX(at.value), ca.SX(at.signals.arriving), _delayed_command(_arrived(at))
    ),
    states=lambda at: _states_of_parts(_arriving(at)),
    rates=lambda e: _command_rates(replace(e, at={e.here.port: _arrived(e.here)})),
    start=lambda e: _from(e.here.signals.arriving),
    same_as=lambda *_: (),
    usual=False,
    look_alikes=("sensor_delay", "sensor_lag", "second_store"),
    separated_by="steps of what acts on the second store alone, seen beside those of the first",
)
