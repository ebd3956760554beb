"""Viscosity of a muscle: its force falls with the speed of contraction."""

from __future__ import annotations

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, shape, size, twins


def _damped(at: PortView) -> Expression:
    pressure = at.form.ramp(at.signals.gauge_pressure, 1e3)
    damping = at.p.coefficient * (1.0 + at.p.growth * pressure)
    return at.value - damping * at.signals.contraction_speed


muscle_viscosity = Law(
    "muscle_viscosity",
    "F = F0 - coefficient (1 + growth p) v",
    twins("muscle_force", needs=("contraction_speed", "gauge_pressure")),
    lambda at: (
        size("coefficient", "N s/m", 300.0, 5000.0, "damping without pressure",
             source="100 to 800 in the literature"),
        shape("growth", "Pa^-1", 0.0, "relative growth of the damping with pressure", around=None,
              between=(0.0, 2e-4), scale=1e-5, source="", fitted=False),
    ),
    _damped,
    source="Reynolds, Repperger, Phillips and Bandry, Ann. Biomed. Eng. 31 (2003)",
    look_alikes=("viscous_friction", "quadratic_drag", "series_elasticity"),
    separated_by="swings at low and high mean pressure; a load cell behind one muscle",
)  # fmt: skip
