"""Soft stops: a bumper that pushes before the hard stop is reached."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.port_units import per


def stop_compliance(
    ports: tuple[str, ...] = ("lower_stop.torque", "upper_stop.torque"),
    *,
    stiffness: float = 50.0,
    thickness: float = 0.05,
    unit: str = "N m",
    coordinate_unit: str = "rad",
    upper: float = 2e4,
    typical: float = 50.0,
    name: str = "stop_compliance",
) -> Effect:
    """Build a soft bumper in front of a stop.

    ``T = T + stiffness max(0, penetration + thickness)``: the push begins ``thickness`` before the
    hard stop.

    Args:
        ports: Ports of the pushes of stops, with the local signal ``penetration``.
        stiffness: Stiffness of the bumper, in ``unit`` per ``coordinate_unit``.
        thickness: Distance before the stop at which it touches, in the unit of the position.
        unit: Unit of the ports.
        coordinate_unit: Unit of the position: ``"rad"`` or ``"m"``.
        upper: Largest plausible stiffness, in ``unit`` per ``coordinate_unit``.
        typical: Usual stiffness, in ``unit`` per ``coordinate_unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``stiffness``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> stop_compliance().ports
        ('lower_stop.torque', 'upper_stop.torque')
    """

    def transform(at: PortView) -> Expression:
        reach = at.signals.penetration + at.p.thickness
        return at.value + at.p.stiffness * at.face.ramp(reach, 0.02 * thickness)

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "stiffness",
                per(unit, coordinate_unit),
                typical,
                "stiffness of the bumper",
                stiffness,
                0.0,
                upper,
                fitted=True,
            ),
            Parameter(
                "thickness",
                coordinate_unit,
                thickness,
                "distance before the stop at which it touches",
                thickness,
                0.05 * thickness,
                10.0 * thickness,
                "estimate",
                fitted=True,
            ),
        ),
        about=About(
            "T = T + stiffness max(0, penetration + thickness)",
            "elastomer bumper",
            look_alikes=("cubic_stiffness", "local_catch"),
            separated_by="slow approaches to both stops",
        ),
    )
