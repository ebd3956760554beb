"""Friction: forces and torques against the direction of motion.

Each effect subtracts from a force or torque port whose local signals include ``speed``.
"""

from __future__ import annotations

import casadi as ca

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.model.units import parse_unit


def _rate_unit(unit: str, speed_unit: str) -> str:
    return f"{unit} s/{speed_unit.split('/')[0]}"


def coulomb_friction(
    port: str = "joint.torque",
    *,
    level: float = 0.3,
    transition_speed: float = 0.02,
    unit: str = "N m",
    speed_unit: str = "rad/s",
    lower: float = 0.0,
    upper: float = 10.0,
    source: str = "",
    name: str = "coulomb_friction",
) -> Effect:
    """Build dry friction of constant level.

    Args:
        port: Port of a force or torque, with the local signal ``speed``.
        level: Friction level, in ``unit``.
        transition_speed: Speed at which tanh reaches 76 %, in ``speed_unit``.
        unit: Unit of the port: ``"N m"`` or ``"N"``.
        speed_unit: Unit of the speed: ``"rad/s"`` or ``"m/s"``.
        lower: Smallest plausible level, in ``unit``.
        upper: Largest plausible level, in ``unit``.
        source: Where the level comes from.
        name: Name of the effect.

    Returns:
        Effect subtracting ``level * tanh(speed / transition_speed)``.

    Raises:
        WorkbenchError: If the level is outside its bounds.

    Example:
        >>> coulomb_friction(level=0.5).parameters[0].value
        0.5
    """
    parse_unit(unit)

    def transform(at: PortView) -> Expression:
        return at.value - at.p.level * ca.tanh(at.signals.speed / at.p.transition_speed)

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "level",
                unit,
                value=level,
                lower=lower,
                upper=upper,
                source=source,
                fitted=True,
                description="dry friction level",
            ),
            Parameter(
                "transition_speed",
                speed_unit,
                value=transition_speed,
                lower=1e-6,
                upper=10.0,
                description="speed scale of the reversal",
            ),
        ),
        about=About(
            "T = -level tanh(speed / transition_speed)",
            "C. A. Coulomb; regularised with tanh",
            look_alikes=(
                "stribeck_friction",
                "lugre_friction",
                "load_dependent_friction",
                "muscle_hysteresis",
            ),
            separated_by="slow reversals against steady speeds, at low and high mean pressure",
        ),
    )


def viscous_friction(
    port: str = "joint.torque",
    *,
    coefficient: float = 0.3,
    unit: str = "N m",
    speed_unit: str = "rad/s",
    lower: float = 0.0,
    upper: float = 1e4,
    source: str = "",
    name: str = "viscous_friction",
) -> Effect:
    """Build friction proportional to speed: a damper.

    Args:
        port: Port of a force or torque, with the local signal ``speed``.
        coefficient: Damping, in ``unit`` per ``speed_unit``.
        unit: Unit of the port: ``"N m"`` or ``"N"``.
        speed_unit: Unit of the speed: ``"rad/s"`` or ``"m/s"``.
        lower: Smallest plausible coefficient, in ``unit`` per ``speed_unit``.
        upper: Largest plausible coefficient, in ``unit`` per ``speed_unit``.
        source: Where the coefficient comes from.
        name: Name of the effect.

    Returns:
        Effect subtracting ``coefficient * speed``.

    Raises:
        WorkbenchError: If the coefficient is outside its bounds.

    Example:
        >>> viscous_friction(unit="N", speed_unit="m/s", coefficient=200.0).parameters[0].unit
        'N s/m'
    """

    def transform(at: PortView) -> Expression:
        return at.value - at.p.coefficient * at.signals.speed

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "coefficient",
                _rate_unit(unit, speed_unit),
                value=coefficient,
                lower=lower,
                upper=upper,
                source=source,
                fitted=True,
                description="damping",
            ),
        ),
        about=About(
            "T = -coefficient speed",
            "linear damper",
            look_alikes=("muscle_viscosity", "quadratic_drag"),
            separated_by="swings of small and large amplitude, at low and high mean pressure",
        ),
    )
