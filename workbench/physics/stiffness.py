"""Forces over position that the equations do not know: springs, bumpers, ripple, local catches.

The rest position of a linear spring is refitted; that of another is held in a fit, and a constant
force tells where it really is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.model.units import per, same_dimension
from workbench.physics.friction import sliding, transition
from workbench.physics.law import (
    Fit,
    Law,
    Own,
    by_port,
    each,
    flag,
    known,
    reference,
    sensors,
    shape,
    size,
    size_at,
    twins,
)
from workbench.physics.place import COORDINATES, RESISTED, Place
from workbench.physics.survey import Survey


def _rest(at: Place) -> Own:
    return shape("rest", at.coordinate.unit, at.middle, "position without force",
                 around=None, scale=1.0, fitted=False)  # fmt: skip


def _deflection(at: PortView) -> Expression:
    return at.signals.coordinate - at.p.rest


def _linear(at: Place) -> tuple[Own, ...]:
    typical, (low, high) = 0.1 * at.scale / at.coordinate.scale, _seen(at)
    reach = high - low or 1.0
    return (
        size("stiffness", per(at.unit, at.coordinate.unit), typical, 20 * typical,
             "stiffness of the spring, negative where it pushes away", signed=True),
        shape("rest", at.coordinate.unit, 0.5 * (low + high), "position without force",
              between=(low - reach, high + reach), scale=0.1 * reach),
    )  # fmt: skip


linear_spring = Law(
    "linear_spring",
    "T = -stiffness (x - rest)",
    each(*RESISTED, needs=("coordinate",)),
    _linear,
    lambda at: at.value - at.p.stiffness * _deflection(at),
    source="R. Hooke 1678",
    look_alikes=("cubic_stiffness", "force_shape", "tilt_gravity", "ripple"),
    separated_by="holding positions over the whole travel at two levels of the drive",
)


def _cubic(at: Place) -> tuple[Own, ...]:
    typical = 0.5 * at.scale / at.coordinate.scale**3
    return (
        size("stiffness", per(at.unit, at.coordinate.unit, 3), typical,
             100 * typical, "cubic stiffness", signed=True),
        _rest(at),
    )  # fmt: skip


cubic_stiffness = Law(
    "cubic_stiffness",
    "T = -stiffness (x - rest)^3",
    each(*RESISTED, needs=("coordinate",)),
    _cubic,
    lambda at: at.value - at.p.stiffness * _deflection(at) * _deflection(at) * _deflection(at),
    source="G. Duffing 1918",
    look_alikes=("linear_spring", "force_shape", "local_catch", "polynomial_stiffness"),
    separated_by="large amplitudes: at small ones a cube cannot be seen",
)


def _polynomial(at: PortView) -> Expression:
    s = _deflection(at) / at.p.reach
    square = s * s
    return at.value - at.p.force * square * (1.0 + at.p.cubic * s + at.p.fifth * square * s)


# Divided by the reach, every coefficient is the force at the end of the travel.
polynomial_stiffness = Law(
    "polynomial_stiffness",
    "T = -force (s^2 + cubic s^3 + fifth s^5), s = (x - rest) / reach",
    each(*RESISTED, needs=("coordinate",)),
    lambda at: (
        size_at(at, "force", 0.1, 5.0, "force of the square at the reach", signed=True),
        shape("cubic", "1", 0.0, "cube over square at the reach", between=(-100.0, 100.0),
              scale=1.0),
        shape("fifth", "1", 0.0, "fifth power over square at the reach", between=(-100.0, 100.0),
              scale=1.0),
        _rest(at),
        reference("reach", at.coordinate.unit, at.coordinate.scale, "deflection of one"),
    ),
    _polynomial,
    source="Taylor expansion of an elastic force",
    look_alikes=("cubic_stiffness", "linear_spring", "force_shape"),
    separated_by="holding positions over the whole travel, to both sides of the middle",
)  # fmt: skip


def _pushed(at: PortView) -> Expression:
    reach = at.signals.penetration + at.p.thickness
    return at.value + at.p.stiffness * at.form.ramp(reach, 0.02 * at.p.thickness)


def _travel(at: Place) -> float:
    """Typical size of the position, in its unit."""
    return at.signals["penetration"].scale if "penetration" in at.signals else 1.0


stop_compliance = Law(
    "stop_compliance",
    "T = T + stiffness max(0, penetration + thickness)",
    twins("stop", needs=("penetration",)),
    lambda at: (
        size("stiffness", per(at.unit, COORDINATES.get(at.unit, "1")), 5.0 * at.scale / _travel(at),
             2e3 * at.scale / _travel(at), "stiffness of the bumper"),
        shape("thickness", COORDINATES.get(at.unit, "1"), 0.05 * _travel(at),
              "distance before the stop at which it touches", around=(0.05, 10.0)),
    ),
    _pushed,
    source="elastomer bumper",
    look_alikes=("cubic_stiffness", "local_catch"),
    separated_by="slow approaches to both stops",
)  # fmt: skip

_TOUCHES = (0.02, 0.08, 0.2, 0.4)
"""Parts of the travel seen, before its end, where a stop may be touched first."""


def _seen(at: Place) -> tuple[float, float]:
    return at.coordinate.seen or at.travel


def _stop(at: Place, *places: Own) -> tuple[Own, ...]:
    low, high = _seen(at)
    # A twentieth of the travel deep it pushes as hard as all else together.
    typical = 20.0 * at.scale / (high - low or 1.0)
    return (
        size("stiffness", per(at.unit, at.coordinate.unit), typical, 1e3 * typical,
             "stiffness of the stop", resists=True),
        *places,
        shape("loss", per("1", at.speed.unit), 0.0, "force lost over speed, relative to it",
              between=(0.0, 10.0 / at.speed.scale), scale=0.1 / at.speed.scale),
        known("touch", at.coordinate.unit, 1e-4 * (high - low or 1.0),
              "distance over which a contact begins in regularised equations"),
    )  # fmt: skip


def _touched(at: Place, name: str, side: float, part: float = _TOUCHES[2]) -> dict[str, float]:
    low, high = _seen(at)
    return {name: high - part * (high - low) if side > 0.0 else low + part * (high - low)}


def _place_of_stop(at: Place, name: str, side: float, text: str) -> Own:
    low, high = _seen(at)
    reach = high - low or 1.0
    # What touches wherever it was seen is a spring, and what never does is not there.
    beyond = 0.0 if at.coordinate.seen and high > low else reach
    return shape(name, at.coordinate.unit, _touched(at, name, side)[name], text,
                 between=(low - beyond, high + beyond), scale=0.1 * reach,
                 strict=beyond == 0.0)  # fmt: skip


def _held_off(at: PortView, place: Expression, side: Expression) -> Expression:
    """Return the force of a stop on what moves beyond its place to one side."""
    deep = at.form.ramp(side * (at.signals.coordinate - place), at.p.touch)
    lost = at.form.ramp(1.0 + at.p.loss * side * at.signals.speed, 1e-3)
    return side * at.p.stiffness * deep * lost


end_stop = Law(
    "end_stop",
    "T = -side stiffness d (1 + loss side v), d = max(0, side (x - place))",
    each(*RESISTED, needs=("coordinate", "speed")),
    lambda at: _stop(
        at,
        _place_of_stop(at, "place", 1.0, "position at which it touches"),
        flag("side", 1.0, "1 for a stop above, -1 below", lower=-1.0),
    ),
    lambda at: at.value - _held_off(at, at.p.place, at.p.side),
    shapes=lambda at: [
        {"side": side, **_touched(at, "place", side, part)}
        for side in (1.0, -1.0)
        for part in _TOUCHES
    ],
    stiff=True,
    far=True,
    source="K. H. Hunt and F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440",
    look_alikes=("end_stops", "polynomial_stiffness", "cubic_stiffness", "local_catch"),
    separated_by="slow motion to both ends of the travel",
)

end_stops = replace(
    end_stop,
    name="end_stops",
    equation="T = -stiffness (max(0, x - upper) - max(0, lower - x)), each loses as end_stop does",
    parameters=lambda at: _stop(
        at,
        _place_of_stop(at, "upper", 1.0, "position at which the upper one touches"),
        _place_of_stop(at, "lower", -1.0, "position at which the lower one touches"),
    ),
    transform=lambda at: (
        at.value - _held_off(at, at.p.upper, 1.0) - _held_off(at, at.p.lower, -1.0)
    ),
    shapes=lambda at: [
        {**_touched(at, "upper", 1.0, part), **_touched(at, "lower", -1.0, part)}
        for part in _TOUCHES
    ],
    look_alikes=("end_stop", "polynomial_stiffness", "cubic_stiffness", "elastic_play"),
)

_TEETH = (6.0, 9.0, 12.0, 15.0, 18.0, 21.0, 24.0, 27.0, 30.0, 36.0, 42.0, 50.0, 60.0)
_WHOLE_TURNS = (*range(1, 25), *_TEETH[8:], 28, 32, 40, 44, 48, 54, 72, 84, 96, 100)
"""Teeth, poles, slots and orders that a body may have that turns round: one of seven is none of
six then, while within a part of a turn they hardly differ."""

_PITCHES = (0.005, 0.01, 0.02)
_SCREWS = (0.01, 10.0)
"""Sizes of a travel, in m, to which the pitches of usual screws and racks belong."""

_PLACES = 6

_LEAST_WAVE = 0.8
"""Part of a wave of a ripple that is at least in a turn, or in what was seen where that is more."""


def _turns(at: Place) -> tuple[float, ...]:
    """Radians of the ripple per unit of the position that are worth trying."""
    if at.stride > 0.0:
        return (2.0 * math.pi / at.stride,)
    if at.coordinate.unit == "rad":
        return _orders(_seen(at))
    scale = at.coordinate.scale
    span = 1.0 if at.coordinate.unit == "m" and _SCREWS[0] < scale < _SCREWS[1] else scale
    return tuple(2 * math.pi / (pitch * span) for pitch in _PITCHES)


def _orders(travel: tuple[float, float]) -> tuple[float, ...]:
    """Ripples a turn that are worth trying, of what turns between two angles."""
    whole = travel[1] - travel[0] >= 2.0 * math.pi
    return tuple(map(float, _WHOLE_TURNS)) if whole else _TEETH


def _waves(
    frequencies: Sequence[float], unit: str, seen: tuple[float, float] | None
) -> tuple[Own, ...]:
    """Return frequency and phase of what repeats with the position, in ``unit``, where ``seen``."""
    usual = frequencies[len(frequencies) // 2]
    lower, upper, turning = 0.3 * min(frequencies), 3.0 * max(frequencies), unit == "rad"
    if seen and turning:
        # A turn later it is where it was: with less than a wave until then the law is a curve.
        lower = _LEAST_WAVE * 2.0 * math.pi / max(seen[1] - seen[0], 2.0 * math.pi)
        upper = 1e3 * max(frequencies)
    return (
        shape("frequency", per("rad", unit), usual, "ripples per unit of position, times 2 pi",
              around=(lower / usual, upper / usual), scale=0.1 * usual,
              strict=bool(seen) and turning),
        shape("phase", "1", 0.0, "phase at position zero", between=(-6.3, 6.3), source=""),
    )  # fmt: skip


def _phases(frequencies: Sequence[float]) -> list[dict[str, float]]:
    return [{"frequency": f, "phase": phase} for f in frequencies for phase in (0.0, 1.5708)]


# The frequency of a rotary ripple is its number of teeth.
ripple = Law(
    "ripple",
    "T = amplitude sin(frequency x + phase)",
    each(*RESISTED, needs=("coordinate",)),
    lambda at: (
        size_at(at, "amplitude", 0.03, 0.5, "amplitude of the ripple", signed=True),
        *_waves(_turns(at), at.coordinate.unit, at.coordinate.seen),
    ),
    lambda at: at.value
    + at.p.amplitude * ca.sin(at.p.frequency * at.signals.coordinate + at.p.phase),
    shapes=lambda at: _phases(_turns(at)),
    source="cogging and meshing torque",
    look_alikes=("local_catch", "linear_spring", "unbalanced_mass"),
    separated_by="one slow, steady sweep of the whole travel in each direction",
)  # fmt: skip


def _read_orders(at: Place) -> tuple[float, ...]:
    return tuple(sorted({1.0, 2.0, *_orders(at.seen or (-at.scale, at.scale))}))


# A code wheel beside its axis errs once a turn, a resolver twice, the interpolation of an optical
# one once a line.
sensor_ripple = replace(
    ripple,
    name="sensor_ripple",
    equation="y = u + amplitude [sin(frequency u + phase) - sin(phase)]",
    where=sensors(together=False, only=lambda at: at.unit == "rad"),
    parameters=lambda at: (
        size("amplitude", "rad", 2e-3, 0.1, "amplitude of the error", signed=True),
        *_waves(_read_orders(at), at.unit, at.seen),
    ),
    transform=lambda at: (
        at.value
        + at.p.amplitude * (ca.sin(at.p.frequency * at.value + at.p.phase) - ca.sin(at.p.phase))
    ),
    shapes=lambda at: _phases(_read_orders(at)),
    group="sensor",
    source="eccentric code wheel; J. R. R. Mayer, IEEE Trans. Instrum. Meas. 43 (1994) 494",
    look_alikes=("sensor_gain", "sensor_bend", "ripple"),
    separated_by="one slow turn beside a second encoder",
)


unbalanced_mass = Law(
    "unbalanced_mass",
    "T = moment sin(x + phase)",
    each(*RESISTED, needs=("coordinate",), only=lambda at: at.coordinate.unit == "rad"),
    lambda at: (
        size_at(at, "moment", 0.1, 5.0,
                "torque of gravity on the mass when it is level with the axis", signed=True),
        shape("phase", "rad", 0.0, "angle of the mass over its equilibrium at position zero",
              between=(-6.3, 6.3), scale=1.0, source=""),
    ),
    lambda at: at.value + at.p.moment * ca.sin(at.signals.coordinate + at.p.phase),
    shapes=lambda at: [{"phase": phase} for phase in (0.0, 0.5 * math.pi)],
    source="gravity on a mass beside its axis",
    look_alikes=("ripple", "linear_spring", "tilt_gravity", "cubic_stiffness"),
    separated_by="holding positions over a whole turn",
)  # fmt: skip


def _local(at: PortView) -> Expression:
    away = (at.signals.coordinate - at.p.centre) / at.p.width
    return ca.exp(-(away * away))


def _width(at: Place) -> float:
    return (at.travel[1] - at.travel[0]) / (2 * _PLACES)


def _place(at: Place) -> tuple[Own, ...]:
    unit, width, reach = at.coordinate.unit, _width(at), max(abs(q) for q in at.travel)
    return (
        shape("centre", unit, at.middle, "the place", between=(-reach, reach), scale=width),
        shape("width", unit, width, "half width of the place"),
    )


def _centres(at: Place) -> list[dict[str, float]]:
    return [{"centre": at.travel[0] + _width(at) * (2 * i + 1)} for i in range(_PLACES)]


local_catch = Law(
    "local_catch",
    "T = height exp(-((x - centre) / width)^2)",
    each(*RESISTED, needs=("coordinate",)),
    lambda at: (
        size_at(at, "height", 0.06, 0.5, "height of the bump", signed=True),
        *_place(at),
    ),
    lambda at: at.value + at.p.height * _local(at),
    shapes=_centres,
    source="local deformation or cable drag; Gaussian shape",
    look_alikes=("ripple", "local_friction", "cubic_stiffness"),
    separated_by="slow passes over the place in both directions: a bump keeps its sign",
)

# A spring that is held in tension between two plates, such as that of a throttle at its limp-home
# position, of a joystick, of a spool: it gives its whole force as soon as it leaves its place.
preload = Law(
    "preload",
    "T = -force tanh((x - place) / width)",
    each(*RESISTED, needs=("coordinate",)),
    lambda at: (
        size_at(at, "force", 0.1, 5.0, "force beside its place", resists=True),
        shape("place", at.coordinate.unit, at.middle, "position that it holds", between=at.travel,
              scale=_width(at)),
        shape("width", at.coordinate.unit, 0.1 * _width(at), "distance over which it sets in",
              around=(0.01, 10.0), fitted=False),
    ),
    lambda at: at.value - at.p.force * ca.tanh((at.signals.coordinate - at.p.place) / at.p.width),
    shapes=lambda at: [{"place": place["centre"]} for place in _centres(at)],
    source="a spring with preload to both sides",
    look_alikes=("linear_spring", "local_catch", "polynomial_stiffness", "ripple"),
    separated_by="slow passes over its place: the force jumps there, both ways alike",
)  # fmt: skip

_NEARER = 2.0
"""How far what grows towards a surface does so beyond what was seen, as a factor of distance."""


def _before(at: Place) -> bool:
    return not at.coordinate.minus and same_dimension(at.coordinate.unit, "m")


def _driven(survey: Survey) -> Iterator[Fit]:
    for place in survey.fitting("force", "acceleration", needs=("coordinate",)):
        drives = survey.drives(place)
        if len(drives) == 1 and _before(place):
            at = place.with_signal("cause", drives[0])
            yield f"_{by_port(place)}", ((at,),)


def _surfaces(at: Place) -> list[dict[str, float]]:
    """Return surfaces below and above what was seen, each with the place seen nearest to it."""
    low, high = _seen(at)
    return [
        {"nearest": end, "surface": end + side * part * (high - low)}
        for part in (0.2, 0.6)
        for end, side in ((low, -1.0), (high, 1.0))
    ]


def _surface(at: Place) -> tuple[Own, Own]:
    low, high = _seen(at)
    return (
        shape("surface", at.coordinate.unit, _surfaces(at)[0]["surface"], "place of the surface",
              scale=0.2 * (high - low), between=(2.0 * low - high, 2.0 * high - low)),
        shape("nearest", at.coordinate.unit, _surfaces(at)[0]["nearest"],
              "place seen nearest to it", around=None, source="", fitted=False),
    )  # fmt: skip


def _near(at: PortView) -> Expression:
    x, nearest, surface = at.signals.coordinate, at.p.nearest, at.p.surface
    closest = ca.fabs(nearest - surface)
    near = closest / ca.fmax(ca.fabs(x - surface), closest / _NEARER + 1e-300)
    return near**2


def _grown(at: PortView) -> Expression:
    driven = at.value - ca.substitute(ca.SX(at.value), ca.SX(at.signals.cause), 0.0)
    return at.value + at.p.part * driven * _near(at)


# A rotor above the ground, a wing above water, a magnet before iron, a thruster beside a wall.
ground_effect = Law(
    "ground_effect",
    "T = T + part T_u ((nearest - surface) / (x - surface))^2, T_u what the drive gives",
    _driven,
    lambda at: (
        size("part", "1", 0.2, 10.0, "growth at the place seen nearest to it", signed=True),
        *_surface(at),
    ),
    _grown,
    shapes=_surfaces,
    source="I. Cheeseman and W. Bennett 1955",
    look_alikes=("local_catch", "parameter_curve", "end_stops", "linear_spring"),
    separated_by="holding several distances with different loads",
)

surface_force = Law(
    "surface_force",
    "T = u + force ((nearest - surface) / (x - surface))^2",
    each("force", "acceleration", needs=("coordinate",), only=_before),
    lambda at: (
        size_at(at, "force", 0.06, 0.5, "force at the place seen nearest to it", signed=True),
        *_surface(at),
    ),
    lambda at: at.value + at.p.force * _near(at),
    shapes=_surfaces,
    source="magnets, charged plates and fine tips attract with the square of one over a distance",
    look_alikes=("local_catch", "ground_effect", "polynomial_stiffness", "end_stops"),
    separated_by="holding several distances from it",
)

local_friction = Law(
    "local_friction",
    "T = -level exp(-((x - centre) / width)^2) tanh(v / transition_speed)",
    each(*RESISTED, needs=("coordinate", "speed")),
    lambda at: (
        size_at(at, "level", 0.06, 0.5, "friction at the place", resists=True),
        *_place(at),
        transition(at),
    ),
    lambda at: at.value - at.p.level * _local(at) * sliding(at),
    shapes=_centres,
    dry=True,
    source="dry friction of a local contact; Gaussian shape",
    look_alikes=("local_catch", "stribeck_friction", "coulomb_friction"),
    separated_by="slow passes over the place in both directions: friction changes its sign",
)
