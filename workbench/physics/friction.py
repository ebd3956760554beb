"""Friction against the direction of motion: dry, of constant level, and proportional to speed."""

from __future__ import annotations

import casadi as ca

from workbench.physics.law import Law, each, shape, size
from workbench.physics.place import EFFORTS, per

coulomb_friction = Law(
    "coulomb_friction",
    "T = -level tanh(speed / transition_speed)",
    each(*EFFORTS, needs=("speed",)),
    lambda at: (
        size("level", at.unit, 0.05 * at.scale, 0.5 * at.scale, "dry friction level", resists=True),
        shape("transition_speed", at.speed.unit, 0.02 * at.speed.scale,
              "speed scale of the reversal", around=(1e-4, 1e4), fitted=False),
    ),
    lambda at: at.value - at.p.level * ca.tanh(at.signals.speed / at.p.transition_speed),
    dry=True,
    source="C. A. Coulomb; regularised with tanh",
    look_alikes=(
        "stribeck_friction", "lugre_friction", "load_dependent_friction", "muscle_hysteresis",
    ),
    separated_by="slow reversals against steady speeds",
)  # fmt: skip

viscous_friction = Law(
    "viscous_friction",
    "T = -coefficient speed",
    each(*EFFORTS, needs=("speed",)),
    lambda at: (
        size("coefficient", per(at.unit, at.speed.unit), 0.05 * at.scale / at.speed.scale,
             0.5 * at.scale / at.speed.scale, "damping", resists=True),
    ),
    lambda at: at.value - at.p.coefficient * at.signals.speed,
    source="linear damper",
    look_alikes=("muscle_viscosity", "quadratic_drag"),
    separated_by="swings of small and large amplitude",
)  # fmt: skip
