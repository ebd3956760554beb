"""Stribeck friction: break-away above the Coulomb level that fades with speed.

The Coulomb level itself is another effect.
"""

from __future__ import annotations

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, each, shape, size
from workbench.physics.place import EFFORTS


def _friction(at: PortView) -> Expression:
    v = at.signals.speed
    fading = ca.exp(-((v / at.p.stribeck_speed) ** 2))
    return at.value - at.p.break_away * fading * ca.tanh(v / at.p.transition_speed)


stribeck_friction = Law(
    "stribeck_friction",
    "T = -break_away exp(-(v / stribeck_speed)^2) tanh(v / transition_speed)",
    each(*EFFORTS, needs=("speed",)),
    lambda at: (
        size("break_away", at.unit, 0.1 * at.scale, 0.5 * at.scale,
             "friction at standstill above the Coulomb level", source="estimate", resists=True),
        shape("stribeck_speed", at.speed.unit, 0.1 * at.speed.scale,
              "speed over which the break-away fades", around=(0.05, 10.0)),
        shape("transition_speed", at.speed.unit, 0.02 * at.speed.scale,
              "speed scale of the reversal", around=(1e-3, 1e3), fitted=False),
    ),
    _friction,
    shapes=lambda at: [{"stribeck_speed": k * at.speed.scale} for k in (0.1, 0.03, 0.3)],
    dry=True,
    source="R. Stribeck 1902; Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994)",
    look_alikes=("coulomb_friction", "lugre_friction", "local_friction"),
    separated_by="runs at several slow steady speeds: only this friction falls with speed",
)  # fmt: skip
