"""Gas volume of the muscles: the volume that changes with contraction, and flattened ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Fit, Law, size, twins
from workbench.physics.muscle_volume import BraidedCylinder
from workbench.physics.place import Survey

_BRAID = BraidedCylinder()
_muscles = twins("muscle_volume", needs=("fibre_length",))


def _constant(survey: Survey) -> Iterator[Fit]:
    if any(e.about.equation.startswith("V = constant") for e in survey.model.effects):
        yield from _muscles(survey)


def _braid(at: PortView) -> Expression:
    volume = _BRAID.volume(at.signals.fibre_length, form=at.form)
    return at.value + at.p.share * (volume - at.value)


braid_volume = Law(
    "braid_volume",
    "V = V + share (V_braid(s) - V)",
    _constant,
    lambda at: (size("share", "1", 1.0, 1.5, "share of the braid's volume"),),
    _braid,
    source="lines [6] to [10] of the paper's Figure 3",
    look_alikes=("flattened_ends",),
    separated_by="fast swings with the valve shut: the pressures follow the volume",
)


def _ends(at: PortView) -> Expression:
    return at.value + at.p.share * _BRAID.end_flattening(at.signals.fibre_length, form=at.form)


# V = V - share (2 pi / 3) h^3, with h the height of a flattened end.
flattened_ends = replace(
    braid_volume,
    name="flattened_ends",
    equation="V + dV_ends(s)",
    where=_muscles,
    parameters=lambda at: (size("share", "1", 1.0, 2.0, "share of the flattening"),),
    transform=_ends,
    source="lines [8] to [10] of the paper's Figure 3",
    look_alikes=("braid_volume",),
    separated_by="fast swings with the valve shut near full contraction",
)
