"""Forces and torques that depend on position: ripple, local catches and local friction."""

from __future__ import annotations

import math

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, Own, each, shape, size
from workbench.physics.place import EFFORTS, Place, per

_TEETH = (6.0, 9.0, 12.0, 15.0, 18.0, 21.0, 24.0, 27.0, 30.0, 36.0, 42.0, 50.0, 60.0)
_PITCHES = (0.005, 0.01, 0.02)
_PLACES = 6


def _turns(at: Place) -> tuple[float, ...]:
    """Radians of the ripple per unit of the position that are worth trying."""
    if at.coordinate.unit == "rad":
        return _TEETH
    span = 1.0 if at.coordinate.unit == "m" else at.coordinate.scale
    return tuple(2 * math.pi / (pitch * span) for pitch in _PITCHES)


# The frequency of a rotary ripple is its number of teeth.
ripple = Law(
    "ripple",
    "T = amplitude sin(frequency x + phase)",
    each(*EFFORTS, needs=("coordinate",)),
    lambda at: (
        size("amplitude", at.unit, 0.03 * at.scale, 0.5 * at.scale,
             "amplitude of the ripple", signed=True),
        shape("frequency", per("1", at.coordinate.unit), _turns(at)[len(_turns(at)) // 2],
              "ripples per unit of position, times 2 pi",
              scale=0.1 * _turns(at)[len(_turns(at)) // 2]),
        shape("phase", "1", 0.0, "phase at position zero", around=None, between=(-6.3, 6.3),
              source=""),
    ),
    lambda at: at.value
    + at.p.amplitude * ca.sin(at.p.frequency * at.signals.coordinate + at.p.phase),
    shapes=lambda at: [
        {"frequency": frequency, "phase": phase}
        for frequency in _turns(at)
        for phase in (0.0, 1.5708)
    ],
    source="cogging and meshing torque",
    look_alikes=("local_catch", "linear_spring"),
    separated_by="one slow, steady sweep of the whole travel in each direction",
)  # fmt: skip


def _local(at: PortView) -> Expression:
    away = (at.signals.coordinate - at.p.centre) / at.p.width
    return ca.exp(-(away * away))


def _width(at: Place) -> float:
    return (at.travel[1] - at.travel[0]) / (2 * _PLACES)


def _place(at: Place) -> tuple[Own, ...]:
    unit, width, reach = at.coordinate.unit, _width(at), max(abs(q) for q in at.travel)
    return (
        shape("centre", unit, at.middle, "the place", around=None, between=(-reach, reach),
              scale=width),
        shape("width", unit, width, "half width of the place"),
    )  # fmt: skip


def _centres(at: Place) -> list[dict[str, float]]:
    return [{"centre": at.travel[0] + _width(at) * (2 * i + 1)} for i in range(_PLACES)]


local_catch = Law(
    "local_catch",
    "T = height exp(-((x - centre) / width)^2)",
    each(*EFFORTS, needs=("coordinate",)),
    lambda at: (
        size("height", at.unit, 0.06 * at.scale, 0.5 * at.scale, "height of the bump", signed=True),
        *_place(at),
    ),
    lambda at: at.value + at.p.height * _local(at),
    shapes=_centres,
    source="local deformation or cable drag; Gaussian shape",
    look_alikes=("ripple", "local_friction", "cubic_stiffness"),
    separated_by="slow passes over the place in both directions: a bump keeps its sign",
)  # fmt: skip

local_friction = Law(
    "local_friction",
    "T = -level exp(-((x - centre) / width)^2) tanh(v / transition_speed)",
    each(*EFFORTS, needs=("coordinate", "speed")),
    lambda at: (
        size("level", at.unit, 0.06 * at.scale, 0.5 * at.scale,
             "friction at the place", resists=True),
        *_place(at),
        shape("transition_speed", at.speed.unit, 0.02 * at.speed.scale,
              "speed scale of the reversal", around=(1e-3, 1e3), fitted=False),
    ),
    lambda at: at.value
    - at.p.level * _local(at) * ca.tanh(at.signals.speed / at.p.transition_speed),
    shapes=_centres,
    dry=True,
    source="dry friction of a local contact; Gaussian shape",
    look_alikes=("local_catch", "stribeck_friction", "coulomb_friction"),
    separated_by="slow passes over the place in both directions: friction changes its sign",
)  # fmt: skip
