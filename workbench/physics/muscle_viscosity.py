"""Viscosity of a muscle: its force falls with the speed of contraction."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression


def muscle_viscosity(
    ports: tuple[str, ...] = ("muscle_1.force", "muscle_2.force"),
    *,
    coefficient: float = 300.0,
    growth: float = 0.0,
    name: str = "muscle_viscosity",
) -> Effect:
    """Build a damper beside a muscle, stiffer with pressure if wanted.

    ``F = F_0 - coefficient (1 + growth p) v`` with the contraction speed v and gauge pressure p.

    Args:
        ports: Ports of muscle forces, with the local signals ``contraction_speed`` and
            ``gauge_pressure``.
        coefficient: Damping without pressure, in N s/m.
        growth: Relative growth of the damping with gauge pressure, in 1/Pa.
        name: Name of the effect.

    Returns:
        Effect of size ``coefficient``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> muscle_viscosity().parameters[0].unit
        'N s/m'
    """

    def transform(at: PortView) -> Expression:
        pressure = at.face.ramp(at.signals.gauge_pressure, 1e3)
        damping = at.p.coefficient * (1.0 + at.p.growth * pressure)
        return at.value - damping * at.signals.contraction_speed

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "coefficient",
                "N s/m",
                300.0,
                "damping without pressure",
                coefficient,
                0.0,
                5000.0,
                "100 to 800 in the literature",
                fitted=True,
            ),
            Parameter(
                "growth",
                "Pa^-1",
                1e-5,
                "relative growth of the damping with pressure",
                growth,
                0.0,
                2e-4,
            ),
        ),
        about=About(
            "F = F0 - coefficient (1 + growth p) v",
            "Reynolds, Repperger, Phillips and Bandry, Ann. Biomed. Eng. 31 (2003)",
            look_alikes=("viscous_friction", "quadratic_drag", "series_elasticity"),
            separated_by="swings at low and high mean pressure; a load cell behind one muscle",
        ),
    )
