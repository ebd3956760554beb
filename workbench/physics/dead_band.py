"""Dead band: a signal must pass a threshold before anything happens; beyond, it is shifted.

At zero width it is the identity on both forms, and the derivative by the width is minus the sign
of the distance from the centre.
"""

from __future__ import annotations

from collections.abc import Iterator

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Fit, Law, Own, drives, each, shape, size
from workbench.physics.place import Place, Survey


def _shifted(at: PortView) -> Expression:
    e, corner = at.value - at.p.centre, 0.02 * at.scale
    above = at.form.ramp(e - at.p.half_width, corner)
    below = at.form.ramp(-e - at.p.half_width, corner)
    return at.p.centre + above - below


def _where(survey: Survey) -> Iterator[Fit]:
    yield from each("spool")(survey)
    yield from drives()(survey)


def _band(at: Place) -> tuple[Own, ...]:
    usual = (0.1 if at.role == "spool" else 0.05) * at.scale
    return (
        size("half_width", at.unit, usual, at.scale, "half of the band"),
        shape("centre", at.unit, 0.0, "middle of the band", around=None, scale=1.0, source="",
              fitted=False),
    )  # fmt: skip


dead_band = Law(
    "dead_band",
    "y = max(0, u - w) - max(0, -u - w)",
    _where,
    _band,
    _shifted,
    dry=True,
    source="overlap of a spool, threshold of a drive",
    look_alikes=("play", "spool_hysteresis", "centre_leakage", "backlash"),
    separated_by="a slow triangle about the centre: a dead band has no loop",
)
