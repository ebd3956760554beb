"""Gas volume of the muscles: the volume that changes with contraction, and flattened ends."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.muscle_volume import BraidedCylinder

VOLUMES = ("muscle_1.volume", "muscle_2.volume")
"""Ports of the braid volumes of both muscles."""


def braid_volume(
    ports: tuple[str, ...] = VOLUMES, *, share: float = 1.0, name: str = "braid_volume"
) -> Effect:
    """Build the volume of the braided cylinder with its flattened ends, in part or in whole.

    ``V = V + share [V_braid(s) - V]``: what a plant of constant volume leaves out.

    Args:
        ports: Ports of braid volumes, with the local signal ``fibre_length``.
        share: Share of the braid's volume, a fraction; 1 replaces the plant's volume.
        name: Name of the effect.

    Returns:
        Effect of size ``share``.

    Raises:
        WorkbenchError: If the share is outside its bounds.

    Example:
        >>> braid_volume().ports
        ('muscle_1.volume', 'muscle_2.volume')
    """
    braid = BraidedCylinder()

    def transform(at: PortView) -> Expression:
        volume = braid.volume(at.signals.fibre_length, face=at.face)
        return at.value + at.p.share * (volume - at.value)

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "share", "1", 1.0, "share of the braid's volume", share, 0.0, 1.5, fitted=True
            ),
        ),
        about=About(
            "V = V + share (V_braid(s) - V)",
            "lines [6] to [10] of the paper's Figure 3",
            look_alikes=("flattened_ends",),
            separated_by="fast swings with the valve shut: the pressures follow the volume",
        ),
    )


def flattened_ends(
    ports: tuple[str, ...] = VOLUMES, *, share: float = 1.0, name: str = "flattened_ends"
) -> Effect:
    """Build what the flattened ends take off the volume of the cylinder, in part or in whole.

    ``V = V - share (2 pi / 3) h^3``, with h the height of a flattened end.

    Args:
        ports: Ports of braid volumes, with the local signal ``fibre_length``.
        share: Share of the flattening, a fraction.
        name: Name of the effect.

    Returns:
        Effect of size ``share``.

    Raises:
        WorkbenchError: If the share is outside its bounds.

    Example:
        >>> flattened_ends().parameters[0].name
        'share'
    """
    braid = BraidedCylinder()

    def transform(at: PortView) -> Expression:
        ends = braid.end_flattening(at.signals.fibre_length, face=at.face)
        return at.value + at.p.share * ends

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("share", "1", 1.0, "share of the flattening", share, 0.0, 2.0, fitted=True),
        ),
        about=About(
            "V + dV_ends(s)",
            "lines [8] to [10] of the paper's Figure 3",
            look_alikes=("braid_volume",),
            separated_by="fast swings with the valve shut near full contraction",
        ),
    )
