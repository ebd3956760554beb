"""Drag that is not proportional to speed: quadratic, or different in the two directions."""

from __future__ import annotations

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression
from workbench.physics.port_units import damping_unit

_SPEED_WIDTH = 1e-3
"""Speed, in SI, within which the smooth face rounds the reversal."""


def quadratic_drag(
    port: str = "joint.torque",
    *,
    coefficient: float = 0.1,
    unit: str = "N m",
    speed_unit: str = "rad/s",
    upper: float = 5.0,
    typical: float = 0.1,
    name: str = "quadratic_drag",
) -> Effect:
    """Build drag that grows with the square of the speed.

    ``T = T - coefficient v |v|``

    Args:
        port: Port of a force or torque, with the local signal ``speed``.
        coefficient: Drag, in ``unit`` per square of ``speed_unit``.
        unit: Unit of the port: ``"N m"`` or ``"N"``.
        speed_unit: Unit of the speed: ``"rad/s"`` or ``"m/s"``.
        upper: Largest plausible coefficient, in ``unit`` per square of ``speed_unit``.
        typical: Usual coefficient, in ``unit`` per square of ``speed_unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``coefficient``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> quadratic_drag().parameters[0].unit
        'N m s2/rad2'
    """

    def transform(at: PortView) -> Expression:
        v = at.signals.speed
        return at.value - at.p.coefficient * v * at.face.absolute(v, _SPEED_WIDTH)

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "coefficient",
                damping_unit(unit, speed_unit, 2),
                typical,
                "drag over squared speed",
                coefficient,
                0.0,
                upper,
                fitted=True,
            ),
        ),
        about=About(
            "T = -coefficient v |v|",
            "I. Newton, drag of a blunt body; turbulent throttling of a damper",
            look_alikes=("viscous_friction", "muscle_viscosity"),
            separated_by="fast against slow runs: the decay per swing grows with the amplitude",
        ),
    )


def direction_dependent_viscous(
    port: str = "joint.torque",
    *,
    difference: float = 0.2,
    unit: str = "N m",
    speed_unit: str = "rad/s",
    upper: float = 2.0,
    typical: float = 0.2,
    name: str = "direction_dependent_viscous",
) -> Effect:
    """Build the difference of a damper's coefficients between the two directions.

    ``T = T - (difference / 2) |v|``: with a damper c this is (c + difference / 2) v for v > 0 and
    (c - difference / 2) v for v < 0. On its own it feeds energy in one direction, so the damper
    must be at least half the difference.

    Args:
        port: Port of a force or torque, with the local signal ``speed``.
        difference: Coefficient for v > 0 less that for v < 0, in ``unit`` per ``speed_unit``.
        unit: Unit of the port: ``"N m"`` or ``"N"``.
        speed_unit: Unit of the speed: ``"rad/s"`` or ``"m/s"``.
        upper: Largest plausible magnitude, in ``unit`` per ``speed_unit``.
        typical: Usual magnitude, in ``unit`` per ``speed_unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``difference``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> direction_dependent_viscous().parameters[0].unit
        'N m s/rad'
    """

    def transform(at: PortView) -> Expression:
        speed = at.face.absolute(at.signals.speed, _SPEED_WIDTH)
        return at.value - 0.5 * at.p.difference * speed

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "difference",
                damping_unit(unit, speed_unit),
                typical,
                "damping forwards less damping backwards",
                difference,
                -upper,
                upper,
                fitted=True,
            ),
        ),
        about=About(
            "T = -(difference / 2) |v|",
            "damper with check valve; bilinear damping",
            look_alikes=("asymmetric_gain", "constant_torque"),
            separated_by="the same speed forwards and backwards through the same angle",
        ),
    )
