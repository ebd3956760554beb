"""Forces and torques that depend on position: ripple and local catches."""

from __future__ import annotations

import casadi as ca

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.port_units import per


def ripple(
    port: str = "joint.torque",
    *,
    amplitude: float = 0.3,
    frequency: float = 24.0,
    phase: float = 0.0,
    coordinate: str = "angle",
    unit: str = "N m",
    coordinate_unit: str = "rad",
    upper: float = 5.0,
    typical: float = 0.3,
    name: str = "ripple",
) -> Effect:
    """Build a force or torque that is periodic in the position: cogging, gear teeth, screw pitch.

    ``T = T + amplitude sin(frequency x + phase)``

    Args:
        port: Port of a force or torque, with the position as a local signal.
        amplitude: Amplitude, in ``unit``.
        frequency: Radians of the ripple per unit of the position, in rad/``coordinate_unit``: the
            number of teeth of a rotary ripple.
        phase: Phase at position zero, in rad.
        coordinate: Name of the local signal that is the position.
        unit: Unit of the port.
        coordinate_unit: Unit of the position: ``"rad"`` or ``"m"``.
        upper: Largest plausible magnitude, in ``unit``.
        typical: Usual magnitude, in ``unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``amplitude``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> [q.name for q in ripple().parameters]
        ['amplitude', 'frequency', 'phase']
    """

    def transform(at: PortView) -> Expression:
        argument = at.p.frequency * at.signals[coordinate] + at.p.phase
        return at.value + at.p.amplitude * ca.sin(argument)

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "amplitude",
                unit,
                typical,
                "amplitude of the ripple",
                amplitude,
                -upper,
                upper,
                fitted=True,
            ),
            Parameter(
                "frequency",
                per("1", coordinate_unit),
                0.1 * frequency,
                "ripples per unit of position, times 2 pi",
                frequency,
                0.1 * frequency,
                10.0 * frequency,
                "estimate",
                fitted=True,
            ),
            Parameter("phase", "1", 1.0, "phase at position zero", phase, -6.3, 6.3, fitted=True),
        ),
        about=About(
            "T = amplitude sin(frequency x + phase)",
            "cogging and meshing torque",
            look_alikes=("local_catch", "linear_spring"),
            separated_by="one slow, steady sweep of the whole travel in each direction",
        ),
    )


def local_catch(
    port: str = "joint.torque",
    *,
    height: float = 0.5,
    centre: float = 0.5,
    width: float = 0.08,
    coordinate: str = "angle",
    unit: str = "N m",
    coordinate_unit: str = "rad",
    upper: float = 10.0,
    typical: float = 0.5,
    reach: float = 10.0,
    name: str = "local_catch",
) -> Effect:
    """Build a force or torque bump at one place of the travel.

    ``T = T + height exp(-((x - centre) / width)^2)``

    Args:
        port: Port of a force or torque, with the position as a local signal.
        height: Height of the bump, in ``unit``.
        centre: Its place, in the unit of the position.
        width: Distance from the centre at which 37 % is left, in ``coordinate_unit``.
        coordinate: Name of the local signal that is the position.
        unit: Unit of the port.
        coordinate_unit: Unit of the position: ``"rad"`` or ``"m"``.
        upper: Largest plausible magnitude, in ``unit``.
        typical: Usual magnitude, in ``unit``; scales the fit.
        reach: Largest magnitude of the centre, in the unit of the position.
        name: Name of the effect.

    Returns:
        Effect of size ``height``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> local_catch(centre=0.7).parameters[1].value
        0.7
    """

    def transform(at: PortView) -> Expression:
        away = (at.signals[coordinate] - at.p.centre) / at.p.width
        return at.value + at.p.height * ca.exp(-(away * away))

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "height", unit, typical, "height of the bump", height, -upper, upper, fitted=True
            ),
            *_place(centre, width, coordinate_unit, reach),
        ),
        about=About(
            "T = height exp(-((x - centre) / width)^2)",
            "local deformation or cable drag; Gaussian shape",
            look_alikes=("ripple", "local_friction", "cubic_stiffness"),
            separated_by="slow passes over the place in both directions: a bump keeps its sign",
        ),
    )


def local_friction(
    port: str = "joint.torque",
    *,
    level: float = 0.5,
    centre: float = 0.5,
    width: float = 0.08,
    transition_speed: float = 0.02,
    coordinate: str = "angle",
    unit: str = "N m",
    coordinate_unit: str = "rad",
    upper: float = 10.0,
    typical: float = 0.5,
    reach: float = 10.0,
    name: str = "local_friction",
) -> Effect:
    """Build dry friction at one place of the travel, such as a damaged bearing.

    ``T = T - level exp(-((x - centre) / width)^2) tanh(v / transition_speed)``

    Args:
        port: Port of a force or torque, with the position and ``speed`` as local signals.
        level: Friction at the place, in ``unit``.
        centre: The place, in the unit of the position.
        width: Distance from the centre at which 37 % is left, in ``coordinate_unit``.
        transition_speed: Speed at which tanh reaches 76 %, in ``coordinate_unit`` per s.
        coordinate: Name of the local signal that is the position.
        unit: Unit of the port.
        coordinate_unit: Unit of the position: ``"rad"`` or ``"m"``.
        upper: Largest plausible level, in ``unit``.
        typical: Usual level, in ``unit``; scales the fit.
        reach: Largest magnitude of the centre, in the unit of the position.
        name: Name of the effect.

    Returns:
        Effect of size ``level``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> local_friction().parameters[0].lower
        0.0
    """

    def transform(at: PortView) -> Expression:
        away = (at.signals[coordinate] - at.p.centre) / at.p.width
        sliding = ca.tanh(at.signals.speed / at.p.transition_speed)
        return at.value - at.p.level * ca.exp(-(away * away)) * sliding

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "level", unit, typical, "friction at the place", level, 0.0, upper, fitted=True
            ),
            *_place(centre, width, coordinate_unit, reach),
            Parameter(
                "transition_speed",
                f"{coordinate_unit}/s",
                transition_speed,
                "speed scale of the reversal",
                transition_speed,
                1e-3 * transition_speed,
                1e3 * transition_speed,
            ),
        ),
        about=About(
            "T = -level exp(-((x - centre) / width)^2) tanh(v / transition_speed)",
            "dry friction of a local contact; Gaussian shape",
            look_alikes=("local_catch", "stribeck_friction", "coulomb_friction"),
            separated_by="slow passes over the place in both directions: friction changes its sign",
        ),
    )


def _place(centre: float, width: float, unit: str, reach: float) -> tuple[Parameter, Parameter]:
    return (
        Parameter(
            "centre", unit, width, "the place", centre, -reach, reach, "estimate", fitted=True
        ),
        Parameter(
            "width",
            unit,
            width,
            "half width of the place",
            width,
            0.1 * width,
            10.0 * width,
            "estimate",
            fitted=True,
        ),
    )
