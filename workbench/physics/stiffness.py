"""Springs that the equations do not know: linear and cubic stiffness about a rest position."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.port_units import per


def _rest(rest: float, unit: str, scale: float) -> Parameter:
    return Parameter("rest", unit, scale, "position without force", rest, source="estimate")


def linear_spring(
    port: str = "joint.torque",
    *,
    stiffness: float = 1.0,
    rest: float = 0.0,
    coordinate: str = "angle",
    unit: str = "N m",
    coordinate_unit: str = "rad",
    upper: float = 100.0,
    typical: float = 1.0,
    name: str = "linear_spring",
) -> Effect:
    """Build a spring about a rest position: cables, hoses, a forgotten return spring.

    ``T = T - stiffness (x - rest)``. The rest position is held in a fit; a constant force tells
    where it really is.

    Args:
        port: Port of a force or torque, with the position as a local signal.
        stiffness: Stiffness, in ``unit`` per ``coordinate_unit``.
        rest: Position without force, in the unit of the position.
        coordinate: Name of the local signal that is the position.
        unit: Unit of the port.
        coordinate_unit: Unit of the position: ``"rad"`` or ``"m"``.
        upper: Largest plausible stiffness, in ``unit`` per ``coordinate_unit``.
        typical: Usual stiffness, in ``unit`` per ``coordinate_unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``stiffness``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> linear_spring().parameters[0].unit
        'N m/rad'
    """

    def transform(at: PortView) -> Expression:
        return at.value - at.p.stiffness * (at.signals[coordinate] - at.p.rest)

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "stiffness",
                per(unit, coordinate_unit),
                typical,
                "stiffness of the spring",
                stiffness,
                0.0,
                upper,
                fitted=True,
            ),
            _rest(rest, coordinate_unit, 1.0),
        ),
        about=About(
            "T = -stiffness (x - rest)",
            "R. Hooke 1678",
            look_alikes=("cubic_stiffness", "force_shape", "tilt_gravity", "ripple"),
            separated_by="holding positions over the whole travel at two mean pressures",
        ),
    )


def cubic_stiffness(
    port: str = "joint.torque",
    *,
    stiffness: float = 5.0,
    rest: float = 0.0,
    coordinate: str = "angle",
    unit: str = "N m",
    coordinate_unit: str = "rad",
    upper: float = 500.0,
    typical: float = 5.0,
    name: str = "cubic_stiffness",
) -> Effect:
    """Build a spring that hardens (or, negative, softens) with the cube of the deflection.

    ``T = T - stiffness (x - rest)^3``

    Args:
        port: Port of a force or torque, with the position as a local signal.
        stiffness: Cubic stiffness, in ``unit`` per cube of ``coordinate_unit``.
        rest: Position without force, in the unit of the position.
        coordinate: Name of the local signal that is the position.
        unit: Unit of the port.
        coordinate_unit: Unit of the position: ``"rad"`` or ``"m"``.
        upper: Largest plausible magnitude, in ``unit`` per cube of ``coordinate_unit``.
        typical: Usual magnitude, in ``unit`` per cube of ``coordinate_unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``stiffness``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> cubic_stiffness(unit="N", coordinate_unit="m").parameters[0].unit
        'N/m3'
    """

    def transform(at: PortView) -> Expression:
        deflection = at.signals[coordinate] - at.p.rest
        return at.value - at.p.stiffness * deflection * deflection * deflection

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "stiffness",
                per(unit, coordinate_unit, 3),
                typical,
                "cubic stiffness",
                stiffness,
                -upper,
                upper,
                fitted=True,
            ),
            _rest(rest, coordinate_unit, 1.0),
        ),
        about=About(
            "T = -stiffness (x - rest)^3",
            "G. Duffing 1918",
            look_alikes=("linear_spring", "force_shape", "local_catch"),
            separated_by="large amplitudes: at small ones a cube cannot be seen",
        ),
    )
