"""A signal that is off by a constant, by a factor, by one on one side only, or that is bent."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.model.units import SPEEDS, same_dimension
from workbench.physics.law import (
    Fit,
    Law,
    Own,
    at_inputs_too,
    by_end,
    by_number,
    by_port,
    drives,
    each,
    first_of,
    gain_of,
    known,
    sensors,
    shape,
    size,
    size_at,
    together,
)
from workbench.physics.place import EFFORTS, FLOWS, Place
from workbench.physics.survey import Survey


def _amount(at: Place, typical: float, largest: float) -> tuple[Own, ...]:
    return (size_at(at, "amount", typical, largest, "the constant", signed=True),)


def sensor_error(at: Place) -> float:
    """Return the usual zero error of a sensor as a fraction of its scale: a pressure's is large."""
    return {"Pa": 0.1, "rad": 0.01}.get(at.unit, 0.02)


offset = Law(
    "offset",
    "y = u + amount",
    drives("flow"),
    lambda at: _amount(at, 0.05, 1.0),
    lambda at: at.value + at.p.amount,
    usual=True,
    source="zero error",
    look_alikes=("gain",),
    separated_by="hold still at several positions: an offset is the same everywhere",
)

valve_offset = replace(
    offset,
    name="valve_offset",
    where=each("valve_command"),
    parameters=lambda at: _amount(at, 0.1, 1.0),
    look_alikes=("asymmetric_gain", "constant_torque", "edge_gain", "edge_leakage"),
    separated_by="small steps to both sides of the centre against large ones",
)

constant_force = replace(
    offset,
    name="constant_force",
    where=each(*EFFORTS, only=lambda at: "speed" in at.signals and at.unit != "N m"),
    parameters=lambda at: _amount(at, 0.05, 0.5),
    look_alikes=("linear_spring", "ripple"),
    separated_by="hold several positions at two levels of the drive and with two loads",
)

constant_torque = replace(
    offset,
    name="constant_torque",
    where=each(*EFFORTS, only=lambda at: "speed" in at.signals and at.unit == "N m"),
    parameters=lambda at: _amount(at, 0.05, 0.5),
    look_alikes=("tilt_gravity", "force_gain", "linear_spring", "valve_offset"),
    separated_by="hold several positions at two levels of the drive and with two loads",
)

sensor_offset = replace(
    offset,
    name="sensor_offset",
    where=sensors(),
    parameters=lambda at: _amount(at, sensor_error(at), 5 * sensor_error(at)),
    group="sensor",
    look_alikes=("sensor_gain", "sensor_drift", "constant_torque", "force_gain"),
    separated_by="compare with a reference at rest, at two levels",
)


def _excess(typical: float) -> tuple[Own, ...]:
    return (size("excess", "1", typical, 0.5, "factor less one", signed=True),)


gain = at_inputs_too(
    Law(
        "gain",
        "y = (1 + excess) u",
        drives("flow"),
        lambda at: _excess(0.05),
        lambda at: at.value * (1.0 + at.p.excess),
        usual=True,
        source="span error",
        look_alikes=("offset",),
        separated_by="compare with a reference at two levels of the signal",
    )
)


def _beside_unused(survey: Survey) -> Iterator[Fit]:
    for cause in survey.unused_inputs:
        for at in survey.fitting(*EFFORTS, *FLOWS):
            if not at.commanded:
                site = at.with_signal("cause", cause)
                yield f"_{cause.source}_{by_port(at)}", ((site,),)


def _entered(at: PortView) -> Expression:
    cause, usual = at.signals.cause, at.p.usual
    bent = ((cause / usual) ** 2 + 1e-6) ** (0.5 * (at.p.exponent - 1.0))
    return at.value + at.p.gain * cause * bent


# What was recorded because it may matter, and stands nowhere in the equations: the sun; the wind,
# whose push grows with its square.
unused_input = Law(
    "unused_input",
    "y = u + gain v |v / usual|^(exponent - 1), v an input that the equations do not use",
    _beside_unused,
    lambda at: (
        gain_of(at, at.other("cause"), 0.05, "signal over the input"),
        shape("exponent", "1", 1.0, "power of the input", between=(0.3, 4.0), refined=True),
        known("usual", at.other("cause").unit, at.other("cause").largest, "largest input seen"),
    ),
    _entered,
    shapes=lambda at: [{"exponent": 1.0}, {"exponent": 2.0}],
    source="first term of a Taylor series; pressure of a wind",
    look_alikes=("exchange_with_input", "offset"),
    separated_by="that input changes, and nothing else",
)


def _turned_to(survey: Survey) -> Iterator[Fit]:
    """Yield what turns, with unused inputs that may push it by how it stands to them."""
    for cause in survey.unused_inputs:
        for at in survey.fitting(*EFFORTS, needs=("coordinate",)):
            if not at.commanded and at.coordinate.unit == "rad":
                yield f"_{cause.source}_{by_port(at)}", ((at.with_signal("cause", cause),),)


def _turned(name: str, turns: int, source: str) -> Law:
    """Return the law of a push that repeats so often in a turn."""
    angle = "x - facing" if turns == 1 else f"{turns} (x - facing)"

    def transform(at: PortView) -> Expression:
        turned = ca.sin(turns * (at.signals.coordinate - at.p.facing))
        return at.value + turned * (_entered(at) - at.value)

    def shapes(at: Place) -> list[dict[str, float]]:
        power = 2.0 if same_dimension(at.other("cause").unit, *SPEEDS) else 1.0
        return [{"exponent": power, "facing": part * math.pi / turns} for part in (0.0, 0.5)]

    return replace(
        unused_input,
        name=name,
        equation=f"y = u + gain v |v / usual|^(exponent - 1) sin({angle}), v an input that the"
        " equations do not use, x an angle",
        where=_turned_to,
        parameters=lambda at: (
            *unused_input.parameters(at),
            shape("facing", "rad", 0.0, "angle at which it vanishes", between=(-math.pi, math.pi),
                  scale=0.3),
        ),
        transform=transform,
        shapes=shapes,
        source=source,
        look_alikes=("unused_input", "unbalanced_mass"),
        separated_by="that input changes, at several angles",
    )  # fmt: skip


# A vane, a panel in the sun.
turned_input = _turned("turned_input", 1, "projection of a push on what turns")
# A dish or a hull in the wind: along it and across there is no torque.
twice_turned_input = _turned(
    "twice_turned_input", 2, "M. M. Munk 1924: a stream turns a hull by the sine of twice its angle"
)


def _flowing_past(survey: Survey) -> Iterator[Fit]:
    """Yield terms that are no straight lines of a state that an unused input has the unit of.

    Of a straight line the input is a term of its own.
    """
    t, ports = survey.trace, survey.ports
    for cause in survey.unused_inputs:
        states = [q for q in survey.model.states if same_dimension(q.unit, cause.unit)]
        for at in survey.fitting(*EFFORTS, *FLOWS) if states else ():
            for k, q in enumerate(survey.model.parameters):
                term = ca.jacobian(ports.value_at(at), t.p[k])
                for state in states if not ca.depends_on(term, t.p[k]) else ():
                    slope = ca.jacobian(term, t.x[ports.state_index[state.name]])
                    if ca.depends_on(slope, ca.vertcat(t.x, t.u)):
                        site = replace(at, parameters=(q,)).with_signal("cause", cause)
                        site = site.with_signal("own", ports.of(state.name))
                        yield f"_{cause.source}_{state.name}_{q.name}_{by_port(at)}", ((site,),)


def _past(at: PortView) -> Expression:
    own, value = ca.SX(at.signals.own), ca.SX(at.value)
    term = value - ca.substitute(value, ca.SX(at.subject), 0.0)
    return value - term + ca.substitute(term, own, own + at.p.gain * at.signals.cause)


# A car in a headwind, a boat in a stream: what drags goes by the speed through the medium.
moving_medium = Law(
    "moving_medium",
    "u(x + gain v) in place of u(x) in the term of a parameter, v an input that the equations do"
    " not use, in the unit of the state x",
    _flowing_past,
    lambda at: (
        size("gain", "1", 1.0, 10.0, "what a unit of the input is in the state", signed=True),
    ),
    _past,
    of_parameter=True,
    source="speed through a medium: its own less that of the medium",
    look_alikes=("unused_input", "parameter_curve"),
    separated_by="that input changes, and nothing else",
)


sensor_gain = replace(
    gain,
    name="sensor_gain",
    where=sensors(),
    parameters=lambda at: _excess(0.02),
    group="sensor",
    look_alikes=("sensor_offset", "force_gain"),
)

force_gain = replace(
    gain,
    name="force_gain",
    where=each("muscle_force", label=by_number),
    usual=False,
    look_alikes=("tilt_gravity", "constant_torque", "sensor_gain", "force_gain"),
    separated_by="isometric force of each muscle with a load cell",
)

edge_gain = replace(
    gain,
    name="edge_gain",
    where=each("edge", label=by_end),
    parameters=lambda at: _excess(0.1),
    usual=False,
    look_alikes=("asymmetric_gain", "valve_offset", "silencer"),
    separated_by="fill and vent each chamber alone over the same pressures",
)


def _both_ways(at: Place) -> bool:
    """Tell whether a signal goes to both sides of zero: else two gains are one."""
    return at.seen is None or at.seen[0] < 0.0 < at.seen[1]


asymmetric_gain = Law(
    "asymmetric_gain",
    "y = u + difference ((share - 1/2) (u - centre) + |u - centre| / 2)",
    together(
        first_of(each("spool"), each("command", "voltage", label=by_port, only=_both_ways)),
        each("flow", only=lambda at: at.driven and _both_ways(at), label=by_port),
    ),
    lambda at: (
        size("difference", "1", 0.1, 1.0, "factor above the centre less that below", signed=True),
        shape("centre", at.unit, 0.0, "where the two sides meet", around=None, scale=1.0,
              source="", fitted=False),
        # Where what follows is no line, a gain of both sides is not made up for by another one.
        shape("share", "1", 0.5, "part of the difference that is above the centre",
              between=(0.0, 1.0), source="", refined=True),
    ),
    lambda at: at.value
    + at.p.difference
    * (
        (at.p.share - 0.5) * (at.value - at.p.centre)
        + 0.5 * at.form.absolute(at.value - at.p.centre, 0.02 * at.scale)
    ),
    shapes=lambda at: [{"share": part} for part in (0.5, 1.0, 0.0)],
    source="unequal edges of a valve, unequal sides of an amplifier, losses of one direction",
    look_alikes=("valve_offset", "silencer", "edge_gain"),
    separated_by="steps of several sizes to both sides: an offset fades for large ones",
)  # fmt: skip


def _reach(at: Place) -> tuple[float, float, float]:
    """Return the ends of a signal's range, and its length, in its unit."""
    low, high = at.seen or (-at.scale, at.scale)
    return low, high, (high - low) or 1.0


def _bend(at: Place, typical: float) -> tuple[Own, ...]:
    low, high, reach = _reach(at)
    usual = 2.0 * typical * reach
    return (
        size("amount", at.unit, usual, 20.0 * usual, "deviation at one reach from the place",
             signed=True),
        shape("straight", at.unit, 0.5 * (low + high), "where the curve has no error",
              between=(low - 10.0 * reach, high + 10.0 * reach), scale=reach),
        known("reach", at.unit, reach, "length of the range seen"),
    )  # fmt: skip


def _bent(at: PortView) -> Expression:
    along = (at.value - at.p.straight) / at.p.reach
    return at.value + at.p.amount * along * along


bend = Law(
    "bend",
    "y = u + amount ((u - straight) / reach)^2",
    drives("flow", only=lambda at: at.commanded),
    lambda at: _bend(at, 0.05),
    _bent,
    shapes=lambda at: [{"straight": at_} for at_ in (0.5 * sum(_reach(at)[:2]), *_reach(at)[:2])],
    source="characteristic of a valve, pump or amplifier, to second order",
    look_alikes=("gain", "saturation", "asymmetric_gain"),
    separated_by="the same small step about several levels of the signal",
)

sensor_bend = replace(
    bend,
    name="sensor_bend",
    where=sensors(),
    parameters=lambda at: _bend(at, sensor_error(at)),
    group="sensor",
    source="characteristic of a sensor, to second order",
    look_alikes=("sensor_gain", "sensor_clipping"),
)


_NOTHING = 1e-6
"""Square of the part of the largest value up to which another signal is nothing."""


def _beside_others(survey: Survey) -> Iterator[Fit]:
    read = {q.name for q in survey.model.outputs}
    # The noise of a measurement goes into the command of a loop that follows it.
    heard = (q for q in survey.model.inputs if not (survey.recorded.held and q.commanded))
    causes = [survey.ports.of(q.name) for q in heard if q.name not in read]
    for place in survey.fitting("measurement"):
        if place.output is None:
            continue
        for cause in (*causes, *survey.beside(place)):
            site = place.with_signal("cause", cause)
            yield f"_{place.output.name}_{cause.source}", ((site,),)


def _coupled(at: Place) -> tuple[Own, ...]:
    cause = at.other("cause")
    return (
        gain_of(at, cause, sensor_error(at), "what the sensor reads of the other signal"),
        shape("zero", cause.unit, cause.start, "value of the other signal that it does not read",
              around=None, source="", fitted=False),
        shape("exponent", "1", 1.0, "1 for what goes in proportion, 1/2 for a leak",
              around=(0.25, 4.0), refined=True),
        known("most", cause.unit, cause.largest, "largest value of the other signal seen"),
    )  # fmt: skip


def _counts_leaks(at: Place) -> bool:
    """Tell whether a sensor reads a flow, and the other signal may press it through a leak."""
    presses = same_dimension(at.other("cause").unit, "Pa", "m")
    return presses and same_dimension(at.unit, "m3/s", "kg/s")


def _read_too(at: PortView) -> Expression:
    beyond = at.signals.cause - at.p.zero
    part = ca.sqrt((beyond / at.p.most) ** 2 + _NOTHING)
    return at.value + at.p.gain * beyond * part ** (at.p.exponent - 1.0)


# A thermometer in the sun, a strain gauge beside a hot pipe, a leak that a meter counts.
sensor_cross_talk = Law(
    "sensor_cross_talk",
    "y = u + gain s |s / most|^(exponent - 1), s = cause - zero",
    _beside_others,
    _coupled,
    _read_too,
    shapes=lambda at: [{"exponent": e} for e in ((1.0, 0.5) if _counts_leaks(at) else (1.0,))],
    group="sensor",
    source="cross-sensitivity of a sensor, a leak before a meter",
    look_alikes=("sensor_gain", "sensor_offset", "slow_response"),
    separated_by="change that signal alone, where what is measured stays",
)
