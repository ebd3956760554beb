"""A braided muscle beside the ideal braid: flattened ends, and the force of its wall.

The factor acts on the contraction wherever the equations of the force have it, so that it needs no
geometry of its own.
"""

from __future__ import annotations

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, Own, shape, size, twins
from workbench.physics.place import Place

_NEEDS = ("contraction", "gauge_pressure")


def _further(at: PortView) -> Expression:
    q = at.signals.contraction
    return ca.substitute(ca.SX(at.value), ca.SX(q), (1.0 + at.p.excess) * q)


end_factor = Law(
    "end_factor",
    "F = F(k q, p), k = 1 + excess",
    twins("muscle_tension", "force", needs=_NEEDS, only=lambda at: at.shaped),
    lambda at: (size("excess", "1", 0.1, 2.0, "factor on the contraction less one", signed=True),),
    _further,
    source="B. Tondu and P. Lopez 2000, factor k of the flattened ends",
    look_alikes=("wall_term", "contraction_force_correction", "linear_spring"),
    separated_by="slope of the force over pressure, at several contractions",
)


def _wall(at: Place) -> tuple[Own, ...]:
    length = at.signals["contraction"]
    return (
        size("force", at.unit, 0.2 * at.scale, 5.0 * at.scale,
             "force of the wall at the plateau", signed=True),
        shape("reach", length.unit, 0.3 * length.scale, "contraction that leads to the plateau",
              around=(0.05, 20.0)),
        shape("start", "1", 0.0, "force at full length over that of the plateau", around=None,
              between=(-5.0, 5.0), scale=0.2),
    )  # fmt: skip


wall_term = Law(
    "wall_term",
    "F = F - force [start + tanh(q / reach)]",
    twins("muscle_tension", "force", needs=_NEEDS, only=lambda at: at.shaped),
    _wall,
    lambda at: at.value - at.p.force * (at.p.start + ca.tanh(at.signals.contraction / at.p.reach)),
    source="elastic wall, C.-P. Chou and B. Hannaford, IEEE Trans. Robotics Autom. 12 (1996)",
    look_alikes=("end_factor", "phi_term", "linear_spring", "constant_force"),
    separated_by="isometric pressure ramps at several contractions: the force without pressure",
)
