"""Stribeck friction: break-away above the Coulomb level that fades with speed."""

from __future__ import annotations

import casadi as ca

from workbench.model import About, Effect, Parameter, PortView
from workbench.model.face import Expression


def stribeck_friction(
    port: str = "joint.torque",
    *,
    break_away: float = 1.0,
    stribeck_speed: float = 0.1,
    transition_speed: float = 0.02,
    unit: str = "N m",
    speed_unit: str = "rad/s",
    upper: float = 10.0,
    typical: float = 1.0,
    name: str = "stribeck_friction",
) -> Effect:
    """Build the break-away above the Coulomb level; the Coulomb level itself is another effect.

    ``T = T - break_away exp(-(v / stribeck_speed)^2) tanh(v / transition_speed)``

    Args:
        port: Port of a force or torque, with the local signal ``speed``.
        break_away: Friction at standstill above the Coulomb level, in ``unit``.
        stribeck_speed: Speed at which 37 % of it is left, in ``speed_unit``.
        transition_speed: Speed at which tanh reaches 76 %, in ``speed_unit``.
        unit: Unit of the port: ``"N m"`` or ``"N"``.
        speed_unit: Unit of the speed: ``"rad/s"`` or ``"m/s"``.
        upper: Largest plausible break-away, in ``unit``.
        typical: Usual break-away, in ``unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``break_away``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> stribeck_friction(break_away=1.7).parameters[0].value
        1.7
    """

    def transform(at: PortView) -> Expression:
        v = at.signals.speed
        fading = ca.exp(-((v / at.p.stribeck_speed) ** 2))
        return at.value - at.p.break_away * fading * ca.tanh(v / at.p.transition_speed)

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "break_away",
                unit,
                typical,
                "friction at standstill above the Coulomb level",
                break_away,
                0.0,
                upper,
                "estimate",
                fitted=True,
            ),
            Parameter(
                "stribeck_speed",
                speed_unit,
                stribeck_speed,
                "speed over which the break-away fades",
                stribeck_speed,
                0.05 * stribeck_speed,
                10.0 * stribeck_speed,
                "estimate",
                fitted=True,
            ),
            Parameter(
                "transition_speed",
                speed_unit,
                transition_speed,
                "speed scale of the reversal",
                transition_speed,
                1e-3 * transition_speed,
                1e3 * transition_speed,
            ),
        ),
        about=About(
            "T = -break_away exp(-(v / stribeck_speed)^2) tanh(v / transition_speed)",
            "R. Stribeck 1902; Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994)",
            look_alikes=("coulomb_friction", "lugre_friction", "local_friction"),
            separated_by="runs at several slow steady speeds: only this friction falls with speed",
        ),
    )
