"""Drag that is not proportional to speed: quadratic, or different in the two directions."""

from __future__ import annotations

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, each, size
from workbench.physics.place import EFFORTS, per

_SPEED_WIDTH = 1e-3
"""Speed, in SI, within which the regularised form rounds the reversal."""


def _magnitude(at: PortView) -> Expression:
    return at.form.absolute(at.signals.speed, _SPEED_WIDTH)


quadratic_drag = Law(
    "quadratic_drag",
    "T = -coefficient v |v|",
    each(*EFFORTS, needs=("speed",)),
    lambda at: (
        size("coefficient", per(at.unit, at.speed.unit, 2), 0.02 * at.scale / at.speed.scale**2,
             0.5 * at.scale / at.speed.scale**2, "drag over squared speed", resists=True),
    ),
    lambda at: at.value - at.p.coefficient * at.signals.speed * _magnitude(at),
    source="I. Newton, drag of a blunt body; turbulent throttling of a damper",
    look_alikes=("viscous_friction", "muscle_viscosity", "cubic_drag"),
    separated_by="fast against slow runs: the decay per swing grows with the amplitude",
)  # fmt: skip

cubic_drag = Law(
    "cubic_drag",
    "T = -coefficient v^3",
    each(*EFFORTS, needs=("speed",)),
    lambda at: (
        size("coefficient", per(at.unit, at.speed.unit, 3), 0.02 * at.scale / at.speed.scale**3,
             5.0 * at.scale / at.speed.scale**3, "drag over cubed speed", resists=True),
    ),
    lambda at: at.value - at.p.coefficient * at.signals.speed**3,
    source="damping that grows with the amplitude; wire that its current heats",
    look_alikes=("quadratic_drag", "viscous_friction"),
    separated_by="fast against slow runs: the decay grows with the square of the amplitude",
)  # fmt: skip

# With a damper c the difference makes it c + difference / 2 forwards and c - difference / 2
# backwards; on its own it feeds energy in one direction.
direction_dependent_viscous = Law(
    "direction_dependent_viscous",
    "T = -(difference / 2) |v|",
    each(*EFFORTS, needs=("speed",)),
    lambda at: (
        size("difference", per(at.unit, at.speed.unit), 0.025 * at.scale / at.speed.scale,
             0.5 * at.scale / at.speed.scale,
             "damping forwards less damping backwards", signed=True),
    ),
    lambda at: at.value - 0.5 * at.p.difference * _magnitude(at),
    source="damper with check valve; bilinear damping",
    look_alikes=("asymmetric_gain", "constant_torque"),
    separated_by="the same speed forwards and backwards through the same angle",
)  # fmt: skip
