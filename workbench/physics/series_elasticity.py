"""Elasticity in series with a muscle: tendons, fittings and clamps that stretch.

The muscle contracts more than its anchors by what the tendon stretches; the force in the tendon
follows within 5 ms, which avoids an algebraic loop. The gas volume is left at the anchors' length:
at 500 N and 7e-6 m/N it would be 3.5 mm, some 5 % of volume, off.
"""

from __future__ import annotations

from workbench.model import EffectView, PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.force_laws import PaperLaw
from workbench.physics.law import Law, size, twins

_LAG = 0.005
"""Time, in s, in which the stretch follows the force: shorter than any motion of the rig."""

_BASE = PaperLaw()


def _stretched(at: PortView) -> Expression:
    q, p = at.signals.contraction, at.signals.gauge_pressure
    stretch = at.p.compliance * at.x.pull
    return (
        at.value + _BASE.tension(q + stretch, p, form=at.form) - _BASE.tension(q, p, form=at.form)
    )


def _follow(e: EffectView) -> dict[str, Expression]:
    return {"pull": (e.form.ramp(e.values[e.here.port], 1.0) - e.x.pull) / _LAG}


series_elasticity = Law(
    "series_elasticity",
    "T = T(q + compliance F)",
    twins("muscle_tension", needs=("contraction", "gauge_pressure")),
    lambda at: (
        size("compliance", "m/N", 7e-6, 2e-5, "stretch of the tendon over its force",
             source="1e5 to 2e5 N/m in the literature"),
    ),
    _stretched,
    states=lambda at: (State("pull", "N", 100.0, "force in the tendon", 300.0),),
    rates=_follow,
    start=lambda e: {"pull": e.form.ramp(e.here.value, 1.0)},
    far=True,
    source="A. V. Hill 1938, series element; compliance of fittings",
    look_alikes=("force_shape", "contraction_force_correction", "linear_spring"),
    separated_by="pressure steps with the joint locked at several angles",
)  # fmt: skip
