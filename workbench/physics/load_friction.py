"""Dry friction whose level follows a load: the forces of a bearing, or a pressure.

For a bearing the coefficient is friction coefficient times journal radius; for a muscle the gauge
pressure loads the contact of braid and tube. Negative sums of loads count as none.
"""

from __future__ import annotations

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, each, shape, size, twins
from workbench.physics.place import EFFORTS, Place, per


def _of_bearing(at: PortView) -> Expression:
    load = sum(value for name, value in at.signals.items() if name.startswith("bearing_load_"))
    sliding = ca.tanh(at.signals.speed / at.p.transition_speed)
    return at.value - at.p.coefficient * at.form.ramp(load, 1.0) * sliding


def _typical(at: Place) -> float:
    unit = at.signals["bearing_load_1"].unit if "bearing_load_1" in at.signals else "N"
    return {"N": 5e-5 * at.scale, "Pa": 1e-7 * at.scale}.get(unit, 0.05)


def _load_unit(at: Place) -> str:
    return at.signals["bearing_load_1"].unit if "bearing_load_1" in at.signals else "1"


load_dependent_friction = Law(
    "load_dependent_friction",
    "T = -coefficient (sum of loads) tanh(v / transition_speed)",
    each(*EFFORTS, needs=("speed", "bearing_load_1")),
    lambda at: (
        size("coefficient", per(at.unit, _load_unit(at)), _typical(at),
             20.0 * _typical(at), "friction over load", resists=True),
        shape("transition_speed", at.speed.unit, 0.02 * at.speed.scale,
              "speed scale of the reversal", around=(1e-3, 1e3), fitted=False),
    ),
    _of_bearing,
    dry=True,
    source="G. Amontons 1699; journal bearing under radial load",
    look_alikes=("coulomb_friction", "stribeck_friction", "muscle_hysteresis"),
    separated_by="the same motion under a light and under a heavy load",
)  # fmt: skip


def _of_muscle(at: PortView) -> Expression:
    load = at.form.ramp(at.signals.gauge_pressure, 1.0)
    sliding = ca.tanh(at.signals.contraction_speed / at.p.transition_speed)
    return at.value - at.p.coefficient * load * sliding


pressure_friction = Law(
    "pressure_friction",
    "F = -coefficient p tanh(v / transition_speed)",
    twins("muscle_force", needs=("contraction_speed", "gauge_pressure")),
    lambda at: (
        size("coefficient", "N/Pa", 7e-5, 5e-4, "friction over pressure"),
        shape("transition_speed", "m/s", 1e-3, "speed scale of the reversal",
              around=(1e-3, 1e3), fitted=False),
    ),
    _of_muscle,
    dry=True,
    source="G. Amontons 1699; contact of braid and tube under pressure",
    look_alikes=("coulomb_friction", "stribeck_friction", "muscle_hysteresis"),
    separated_by="the same motion at a low and at a high mean pressure",
)  # fmt: skip
