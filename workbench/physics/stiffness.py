"""Springs that the equations do not know: linear, cubic and polynomial, about a rest position.

The rest position is held in a fit; a constant force tells where it really is.
"""

from __future__ import annotations

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, Own, each, shape, size
from workbench.physics.place import EFFORTS, Place, per


def _rest(at: Place) -> Own:
    return shape("rest", at.coordinate.unit, at.middle, "position without force",
                 around=None, scale=1.0, fitted=False)  # fmt: skip


def _deflection(at: PortView) -> Expression:
    return at.signals.coordinate - at.p.rest


def _linear(at: Place) -> tuple[Own, ...]:
    typical = 0.1 * at.scale / at.coordinate.scale
    return (
        size("stiffness", per(at.unit, at.coordinate.unit), typical, 20 * typical,
             "stiffness of the spring", resists=True),
        _rest(at),
    )  # fmt: skip


linear_spring = Law(
    "linear_spring",
    "T = -stiffness (x - rest)",
    each(*EFFORTS, needs=("coordinate",)),
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
    each(*EFFORTS, needs=("coordinate",)),
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
    each(*EFFORTS, needs=("coordinate",)),
    lambda at: (
        size("force", at.unit, 0.1 * at.scale, 5.0 * at.scale,
             "force of the square at the reach", signed=True),
        shape("cubic", "1", 0.0, "cube over square at the reach", around=None,
              between=(-100.0, 100.0), scale=1.0),
        shape("fifth", "1", 0.0, "fifth power over square at the reach", around=None,
              between=(-100.0, 100.0), scale=1.0),
        _rest(at),
        shape("reach", at.coordinate.unit, at.coordinate.scale, "deflection of one", fitted=False),
    ),
    _polynomial,
    source="Taylor expansion of an elastic force",
    look_alikes=("cubic_stiffness", "linear_spring", "force_shape"),
    separated_by="holding positions over the whole travel, to both sides of the middle",
)  # fmt: skip
