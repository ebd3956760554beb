"""Soft stops: a bumper that pushes before the hard stop is reached."""

from __future__ import annotations

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, shape, size, twins
from workbench.physics.place import COORDINATES, Place, per


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
