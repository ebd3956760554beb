"""LuGre friction: bristles that bend before they slip."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from workbench.model import About, Effect, EffectView, Names, Parameter, PortView, State
from workbench.model.face import Expression, Face

FASTEST_RATE = 1000.0
"""Rate of the bristle, in 1/s, that is not exceeded at high speed: explicit integrators with
steps of a millisecond stay stable. It stretches the presliding distance by speed / rate, which
matters only where the bristle is saturated anyway."""


def _bristle_rate(v: Expression, bend: Expression, p: Names, face: Face) -> Expression:
    speed = face.absolute(v, 1e-3 * p.stribeck_speed)
    steady = 1.0 + p.stribeck_share * ca.exp(-((v / p.stribeck_speed) ** 2))
    return (v - speed * bend / steady) / (p.presliding + speed / FASTEST_RATE)


def lugre_friction(
    port: str = "joint.torque",
    *,
    level: float = 0.3,
    presliding: float = 2e-3,
    stribeck_share: float = 0.5,
    stribeck_speed: float = 0.1,
    damping_time: float = 0.0,
    unit: str = "N m",
    speed_unit: str = "rad/s",
    upper: float = 10.0,
    typical: float = 0.3,
    name: str = "lugre_friction",
) -> Effect:
    """Build dry friction with presliding and a break-away that fades with speed.

    With the bristle's bend ``z`` relative to the presliding distance:
    ``dz/dt = (v - |v| z / s(v)) / presliding``, ``s(v) = 1 + share exp(-(v / stribeck_speed)^2)``,
    ``T = T - level (z + damping_time dz/dt)``. Then sigma_0 = level / presliding and
    sigma_1 = level damping_time / presliding in the usual notation; in steady motion the friction
    is ``level s(v)``.

    Args:
        port: Port of a force or torque, with the local signal ``speed``.
        level: Friction level at high speed, in ``unit``.
        presliding: Displacement over which the bristles bend, in the unit of the coordinate.
        stribeck_share: Break-away above the level, relative to it, dimensionless.
        stribeck_speed: Speed over which the break-away fades, in the unit of the speed.
        damping_time: Damping of the bristle over its stiffness, in s.
        unit: Unit of the port: ``"N m"`` or ``"N"``.
        speed_unit: Unit of the speed: ``"rad/s"`` or ``"m/s"``.
        upper: Largest plausible level, in ``unit``.
        typical: Usual level, in ``unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``level`` with one state.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> lugre_friction().states[0].name
        'bend'
    """

    def transform(at: PortView) -> Expression:
        rate = _bristle_rate(at.signals.speed, at.x.bend, at.p, at.face)
        return at.value - at.p.level * (at.x.bend + at.p.damping_time * rate)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        v = effect.at[port].signals.speed
        return {"bend": _bristle_rate(v, effect.x.bend, effect.p, effect.face)}

    coordinate = speed_unit.removesuffix("/s")
    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "level", unit, typical, "friction at high speed", level, 0.0, upper, fitted=True
            ),
            Parameter(
                "presliding",
                coordinate,
                presliding,
                "displacement over which the bristles bend",
                presliding,
                0.02 * presliding,
                50.0 * presliding,
                "estimate",
                fitted=True,
            ),
            Parameter(
                "stribeck_share",
                "1",
                0.5,
                "break-away above the level, relative to it",
                stribeck_share,
                0.0,
                20.0,
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
            ),
            Parameter(
                "damping_time",
                "s",
                1e-3,
                "damping of the bristle over its stiffness",
                damping_time,
                0.0,
                0.1,
            ),
        ),
        states=(
            State(
                "bend", "1", 1.0, "bend of the bristles over the presliding distance", start_rms=0.5
            ),
        ),
        rates=rates,
        about=About(
            "T = -level (z + damping_time dz/dt), dz/dt = (v - |v| z / s(v)) / presliding",
            "Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE TAC 40 (1995)",
            look_alikes=("coulomb_friction", "stribeck_friction", "joint_hysteresis"),
            separated_by="motions smaller than the presliding distance: here friction is a spring",
        ),
    )
