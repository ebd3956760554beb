"""Other gas volumes of the muscles, for comparison: a constant one, and the printed one."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.regularisation import Expression
from workbench.physics.muscle_volume import BraidedCylinder

VOLUME_PORTS = ("muscle_1.volume", "muscle_2.volume")
"""Ports of the braid volumes of both muscles."""


def constant_volume() -> Effect:
    """Build muscles whose gas volume does not change with their length.

    ``V = volume``: the simplification of many muscle models, which loses the ripple of the
    open-loop experiment. The volume is that of the DMSP-20-200N in the middle of the arm's travel,
    at 15 mm of contraction.
    """
    middle = float(BraidedCylinder().volume(0.185))
    source = "volume of the braid at 15 mm of contraction"
    text = "constant volume inside the braid"
    return Effect(
        "constant_volume",
        VOLUME_PORTS,
        lambda at: at.p.volume,
        parameters=(Parameter("volume", "m3", 0.0, text, middle, 1e-6, 1e-3, source),),
        about=About("V = constant", "simplification; the paper's lines [6] to [10] left out"),
    )


def printed_volume() -> Effect:
    """Build the gas volume as it is printed in the paper, with its four defects.

    ``V = V_cyl(s) + 2 V_zone`` with n in the unit of a length and without the square root in d.
    """
    braid = BraidedCylinder(printing="as_printed")

    def transform(at: PortView) -> Expression:
        return braid.volume(at.signals.fibre_length, form=at.form)

    return Effect(
        "printed_volume",
        VOLUME_PORTS,
        transform,
        about=About("V = V_cyl(s) + 2 V_zone", "lines [6] to [10] of the paper's Figure 3"),
    )
