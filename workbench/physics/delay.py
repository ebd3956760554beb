"""What comes late: pure delays and first-order lags."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import casadi as ca

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.model.scope import Names
from workbench.model.units import SPEEDS, per, same_dimension
from workbench.physics.law import (
    Fit,
    Law,
    Own,
    at_inputs_too,
    by_port,
    drives,
    each,
    floor,
    reference,
    sensors,
    shape,
    size,
)
from workbench.physics.place import FLOWS, Place
from workbench.physics.survey import Survey


def _constant(p: Names) -> Expression:
    """Time constant with what keeps it regular, in s: f at zero time, nothing beside a long one."""
    return p.time + p.floor * ca.exp(-p.time / p.floor)


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
        shape("sampled", "1", 0.0, "whether it filters samples", between=(0.0, 1.0), fitted=False),
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
        transform=lambda at: at.value - at.p.time / _constant(at.p) * (at.value - at.x.memory),
        shapes=lambda at: ({},),
        group="process",
        look_alikes=("delay", "slew_limit"),
        separated_by="steps of the command: a lag answers at once, a delay waits",
    )
)


# The voltage of a capacitor is read with the drop over its series resistance, the pressure of a
# vessel before the line to it.
sensor_lead = Law(
    "sensor_lead",
    "y = u + time du/dt",
    sensors(together=False, only=lambda at: "rate" in at.signals),
    lambda at: (size("time", "s", at.interval, 250 * at.interval, "time by which it leads"),),
    lambda at: at.value + at.p.time * at.signals.rate,
    group="sensor",
    source="drop over a resistance in series with a store",
    look_alikes=("sensor_delay", "sensor_gain"),
    separated_by="steps of what fills the store: a drop in series jumps with them",
)


def _driving(at: PortView) -> Expression:
    """Return what acts on the driven body, which runs ahead of the other by the spring's rate."""
    speed = ca.SX(at.signals.speed)
    if not speed.is_symbolic():
        return at.value
    ahead = at.p.compliance * at.p.frequency * at.x.swing
    return ca.substitute(ca.SX(at.value), speed, speed + ahead)


def _sprung(at: PortView) -> Expression:
    drive, pull = _driving(at), at.x.stretch + 2.0 * at.p.damping * at.x.swing
    return drive + at.p.share * (pull - drive)


def _swinging(e: EffectView) -> dict[str, Expression]:
    over = _driving(replace(e.here, x=e.x)) - e.x.stretch - 2.0 * e.p.damping * e.x.swing
    return {"stretch": e.p.frequency * e.x.swing, "swing": e.p.frequency * over}


# Two bodies m1, driven, and m2, joined by a spring, taken as one of m1 + m2: the second one feels
# the drive through the spring, share 1; the first one, where that is read, feels -m2 / m1 of it.
elastic_drive = Law(
    "elastic_drive",
    "F = F + share (y - F), y'' / w^2 + 2 d y' / w + y = F + 2 d F' / w",
    each(
        "force", "acceleration", needs=("speed",),
        only=lambda at: not at.between and same_dimension(at.speed.unit, *SPEEDS),
    ),
    lambda at: (
        size("share", "1", 0.5, 5.0, "part that a spring passes on", signed=True),
        shape("frequency", "rad/s", 0.1 / at.interval, "at which the two swing",
              around=(0.01, 10.0)),
        shape("damping", "1", 0.1, "damping ratio of that", around=(0.01, 10.0)),
        shape("compliance", per(at.speed.unit, per(at.unit, "s")), 0.0,
              "how far the driven body runs ahead of the read one",
              between=(0.0, 100.0 * at.interval * at.speed.scale / at.scale),
              scale=at.interval * at.speed.scale / at.scale, refined=True),
    ),
    _sprung,
    states=lambda at: (
        State("stretch", at.unit, at.scale, "pull of the spring", start_rms=0.05 * at.scale),
        State("swing", at.unit, at.scale, "rate of that over the frequency",
              start_rms=0.05 * at.scale),
    ),
    rates=_swinging,
    start=lambda e: {"stretch": e.here.value},
    shapes=lambda at: [{"frequency": part / at.interval} for part in (0.02, 0.06, 0.2, 0.5)],
    source="two bodies and a spring: a belt, a shaft, a rope",
    look_alikes=("drive_lag", "delay"),
    separated_by="a step of the drive: what is elastic swings",
)  # fmt: skip


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


def _times(at: Place, usual: float, largest: float, lead: float = 0.0) -> tuple[Own, ...]:
    """State a delay by sampling intervals: usual, largest plausible."""
    return (
        size("time", "s", usual * at.interval, largest * at.interval, "delay",
             lower=-lead * at.interval if lead else None),
        floor(at, 1.0),
    )  # fmt: skip


@dataclass(frozen=True)
class _Late:
    """A delay in equal parts, one after the other.

    Each is ``Y / U = N(s) / P(b s)`` with ``P(x) = 1 + p1 x + p2 x^2 + p3 x^3``, b = D + g, and N
    the series of ``exp(-D s) P(b s)`` up to s^3: exactly the identity for D = 0.

    Args:
        p: The coefficients p1, p2 and p3.
        parts: What ends the names of the states of each part.
        advanced: Whether the measurement may have been moved ahead by some of the delay.
    """

    p: tuple[float, float, float]
    parts: tuple[str, ...] = ("", "_2")
    advanced: bool = False

    def _along(
        self, at: PortView
    ) -> Iterator[tuple[Expression, tuple[Expression, Expression, Expression]]]:
        """Yield what comes out of each part, and its derivatives, each times its power of b."""
        (p1, p2, p3), value, r = self.p, at.value, self._time(at.p) / self._whole(at.p)
        for part in self.parts:
            late, slope, bend = (at.x[f"{name}{part}"] for name in ("late", "slope", "bend"))
            third = (value - late - p1 * slope - p2 * bend) / p3
            value = (
                late
                + (p1 - r) * slope
                + (p2 - p1 * r + 0.5 * r * r) * bend
                + (p3 - p2 * r + 0.5 * p1 * r * r - r * r * r / 6.0) * third
            )
            yield value, (slope, bend, third)

    def _time(self, p: Names) -> Expression:
        return (p.time - p.advance if self.advanced else p.time) / len(self.parts)

    def _whole(self, p: Names) -> Expression:
        """Return b, in s: g = f^2 / (D + f) is f at zero delay, nothing beside a long one."""
        return self._time(p) + p.floor * p.floor / (self._time(p) + p.floor)

    def transform(self, at: PortView) -> Expression:
        *_, (value, _) = self._along(at)
        return value

    def states(self, at: Place) -> tuple[State, ...]:
        # Derivatives times powers of the time constant, so that all have the signal's unit.
        return tuple(
            State(f"{name}{part}", at.unit, at.scale, text, start_rms=0.05 * at.scale)
            for part in self.parts
            for name, text in (
                ("late", "filtered signal"),
                ("slope", "its rate times D + g"),
                ("bend", "the rate of that times D + g"),
            )
        )

    def rates(self, e: EffectView) -> dict[str, Expression]:
        along = self._along(replace(e.here, x=e.x))
        return {
            f"{name}{part}": rate / self._whole(e.p)
            for part, (_, rates) in zip(self.parts, along, strict=True)
            for name, rate in zip(("late", "slope", "bend"), rates, strict=True)
        }

    def start(self, value: Expression) -> dict[str, Expression]:
        """Return where a delay starts that has had a value for long."""
        return {f"late{part}": value for part in self.parts}


def _common_clock(survey: Survey) -> Iterator[Fit]:
    found = survey.fitting("measurement")
    if len(found) > 1:
        yield "", tuple((q,) for q in found)


def _late_input(survey: Survey, _: Place) -> tuple[str, ...]:
    """Name the delay of the only input: whatever moves is late by it, or is read late by it."""
    alone, roles = survey.inputs_alone, ("command", "valve_command")
    commands = [q for q in survey.places if q.role in roles or q.commanded]
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


# P is the exponential series E(x) = 1 + x + x^2 / 2 + x^3 / 6, and N is E(g s): its zeros are
# stable, so that a filter can tell the signal from the measurement; the error of its amplitude is
# (w D)^4 / 24 at the frequency w, an eighth of that for two halves one after the other. Down to
# -f / 2 it is a lead, so that a fit may pass through zero. Steps overshoot: a command that jumps
# has a law of its own.
# Of what moves fast beside a long delay, such as an arm that meets a stop, they tell little: a fit
# moves the recording ahead by whole samples, and leaves what is less than one to them.
_READ = _Late((1.0, 1 / 2, 1 / 6), advanced=True)
_READ_AT_ONCE = _Late((1.0, 1 / 2, 1 / 6), ("",))
sensor_delay = Law(
    "sensor_delay",
    "Y / U = exp(-D s), each half to third order",
    sensors(),
    lambda at: (
        *_times(at, 5, 100, lead=0.5),
        shape("advance", "s", 0.0, "part of it by which a recording was moved ahead",
              between=(0.0, math.inf), scale=at.interval, source="", fitted=False),
    ),
    _READ.transform,
    states=_READ.states,
    rates=_READ.rates,
    start=lambda e: _READ.start(e.here.value),
    usual=True,
    group="sensor",
    far=True,
    source="B. Taylor 1715, of the inverse",
    same_as=_late_only_reading,
    advance="advance",
    look_alikes=("sensor_lag",),
    separated_by="sines of two frequencies: the phase of a delay is proportional to both",
)  # fmt: skip


clock_shift = replace(
    sensor_delay,
    name="clock_shift",
    where=_common_clock,
    parameters=lambda at: _times(at, 5, 100, lead=0.5),
    advance="",
    transform=_READ_AT_ONCE.transform,
    states=_READ_AT_ONCE.states,
    rates=_READ_AT_ONCE.rates,
    start=lambda e: _READ_AT_ONCE.start(e.here.value),
    same_as=_late_input,
    usual=False,
    look_alikes=("valve_delay", "spool_bandwidth", "sensor_delay"),
    separated_by="a common event seen by command and measurements, such as a click",
)


# P(x) = 1 + 3 x/5 + 3 x^2/20 + x^3/60: the Pade function of second over third order for D >> f, of
# which no part of a jump comes through at once. Two halves of the delay, one after the other: the
# error at a frequency w goes by (w D)^6.
_SENT = _Late((3 / 5, 3 / 20, 1 / 60))
delay = at_inputs_too(
    Law(
        "delay",
        "Y / U = exp(-D s), Pade functions of second over third order of both halves",
        drives(),
        lambda at: _times(at, 5, 50),
        _SENT.transform,
        states=_SENT.states,
        rates=_SENT.rates,
        start=lambda e: _SENT.start(e.here.value),
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
    parameters=lambda at: _times(at, 2.5, 50),
    look_alikes=("clock_shift", "spool_bandwidth", "slew_limit"),
    separated_by="steps of the command beside a fast spool or flow sensor",
)


_PACES = 1.2
"""Largest over smallest pace from which a way is told from a time."""

_STANDING = 1e-3
"""Part of the largest pace that counts as none."""


def _carried(survey: Survey) -> Iterator[Fit]:
    """Yield sensors with what may carry to them what they read, at a pace that changes.

    A place or a speed is carried by nothing else.
    """
    inputs = [survey.ports.of(q.name) for q in survey.model.inputs]
    moving = [survey.ports.symbols[n] for n in survey.ports.moving]
    for at in survey.fitting("measurement"):
        moves = ca.depends_on(survey.ports.value_at(at), ca.vertcat(*moving))
        if at.output is None or moves or same_dimension(at.unit, *SPEEDS):
            continue
        for pace in (*inputs, *survey.beside(at)):
            low, high = pace.seen or (0.0, 0.0)
            if 0.0 <= _PACES * low < high and same_dimension(pace.unit, *SPEEDS, "m3/s", "kg/s"):
                yield f"_{at.output.name}_{pace.source}", ((at.with_signal("pace", pace),),)


def _paced(at: Place) -> tuple[Own, ...]:
    pace = at.other("pace")
    return (
        size("time", "s", 5.0 * at.interval, 100.0 * at.interval, "delay at the largest pace",
             lower=0.0),
        reference("largest", pace.unit, pace.largest, "largest pace seen"),
        floor(at, 1.0),
    )  # fmt: skip


def _timed(p: Names, pace: Expression) -> Names:
    """Return the parameters of a delay: over what has passed instead of time it is a constant."""
    time = p.time / ca.sqrt((pace / p.largest) ** 2 + _STANDING**2)
    return Names("parameter", {"time": time, "floor": p.floor})


def _read_below(at: PortView) -> PortView:
    return replace(at, p=_timed(at.p, at.signals.pace))


def _passing(e: EffectView) -> EffectView:
    here = _read_below(e.here)
    return replace(e, p=here.p, at={here.port: here})


# A gauge below a die, a thermometer at the end of a pipe, a scale under a belt.
sensor_distance = replace(
    clock_shift,
    name="sensor_distance",
    equation="y(t) = u(t - D), D = time largest / pace, Pade functions of both halves",
    where=_carried,
    parameters=_paced,
    transform=lambda at: _SENT.transform(_read_below(at)),
    states=_SENT.states,
    rates=lambda e: _SENT.rates(_passing(e)),
    start=lambda e: _SENT.start(e.here.value),
    same_as=lambda *_: (),
    look_alikes=("sensor_delay", "sensor_lag"),
    separated_by="steps at a slow and at a fast pace",
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
        ca.SX(at.value), ca.SX(at.signals.arriving), _SENT.transform(_arrived(at))
    ),
    states=lambda at: _SENT.states(_arriving(at)),
    rates=lambda e: _SENT.rates(replace(e, at={e.here.port: _arrived(e.here)})),
    start=lambda e: _SENT.start(e.here.signals.arriving),
    same_as=lambda *_: (),
    usual=False,
    look_alikes=("sensor_delay", "sensor_lag", "second_store"),
    separated_by="steps of what acts on the second store alone, seen beside those of the first",
)
