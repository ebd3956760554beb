"""Dead band: a signal must pass a threshold before anything happens."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression


def dead_band(
    ports: tuple[str, ...] = ("valve.spool",),
    *,
    half_width: float = 0.1,
    centre: float = 0.0,
    unit: str = "V",
    corner: float = 0.02,
    upper: float = 1.0,
    typical: float = 0.1,
    name: str = "dead_band",
) -> Effect:
    """Build a dead band about a centre; beyond it the signal is shifted, not scaled.

    ``y = centre + max(0, e - half_width) - max(0, -e - half_width)``, ``e = u - centre``. The
    smooth face rounds the corners; at zero width it is the identity on both faces, and the
    derivative by the width is minus the sign of e.

    Args:
        ports: Ports on which it acts.
        half_width: Half of the band, in ``unit``.
        centre: Middle of the band, in ``unit``.
        unit: Unit of the ports.
        corner: Half-width of the corners that the smooth face rounds, in ``unit``.
        upper: Largest plausible half-width, in ``unit``.
        typical: Usual half-width, in ``unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``half_width``.

    Raises:
        WorkbenchError: If the half-width is outside its bounds.

    Example:
        >>> dead_band(half_width=0.2).parameters[0].value
        0.2
    """

    def transform(at: PortView) -> Expression:
        e = at.value - at.p.centre
        above = at.face.ramp(e - at.p.half_width, corner)
        below = at.face.ramp(-e - at.p.half_width, corner)
        return at.p.centre + above - below

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "half_width", unit, typical, "half of the band", half_width, 0.0, upper, fitted=True
            ),
            Parameter("centre", unit, 1.0, "middle of the band", centre),
        ),
        about=About(
            "y = max(0, u - w) - max(0, -u - w)",
            "overlap of a spool",
            look_alikes=("play", "spool_hysteresis", "centre_leakage"),
            separated_by="a slow triangle about the centre: a dead band has no loop",
        ),
    )
