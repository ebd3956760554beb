"""Rate-independent hysteresis of a pulling element such as a pneumatic muscle."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression

_SPEED_WIDTH = 1e-5
"""Contraction speed, m/s, within which the smooth face rounds the reversal."""


def bouc_wen_hysteresis(
    ports: tuple[str, ...] = ("muscle_1.force", "muscle_2.force"),
    *,
    level: float = 10.0,
    level_per_pressure: float = 7e-5,
    breakaway: float = 5e-4,
    exponent: float = 1.0,
    name: str = "muscle_hysteresis",
) -> Effect:
    """Build hysteresis between braid and tube of a muscle, growing with its pressure.

    ``F = F_0 - (level + level_per_pressure p) z``,
    ``dz/dt = (v - |v| |z|^(n-1) z) / breakaway`` with the contraction speed v; each port has its
    own z in -1..1. The exponent 1 is Dahl's law; larger exponents turn more sharply.

    Args:
        ports: Ports of muscle forces, with the local signals ``contraction_speed`` and
            ``gauge_pressure``.
        level: Half width of the loop without pressure, in N.
        level_per_pressure: Growth of the half width, in N/Pa.
        breakaway: Contraction over which the loop turns, in m.
        exponent: Sharpness of the turn, dimensionless.
        name: Name of the effect.

    Returns:
        Effect with one state per port.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> [state.name for state in bouc_wen_hysteresis().states]
        ['turn_1', 'turn_2']
    """

    def half_width(at: PortView) -> Expression:
        pressure = at.face.ramp(at.signals.gauge_pressure, 1e3)
        return at.p.level + at.p.level_per_pressure * pressure

    def transform(at: PortView) -> Expression:
        return at.value - half_width(at) * at.x[f"turn_{at.index + 1}"]

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        result = {}
        for at in effect.at.values():
            z = at.x[f"turn_{at.index + 1}"]
            v = at.signals.contraction_speed
            speed = at.face.absolute(v, _SPEED_WIDTH)
            # |z|^(n-1) is kept off zero, where its derivative would be infinite for n < 2.
            sharp = (z * z + 1e-12) ** (0.5 * (effect.p.exponent - 1.0))
            result[f"turn_{at.index + 1}"] = (v - speed * sharp * z) / effect.p.breakaway
        return result

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "level",
                "N",
                10.0,
                value=level,
                lower=0.0,
                upper=100.0,
                fitted=True,
                description="half width of the loop without pressure",
            ),
            Parameter(
                "level_per_pressure",
                "N/Pa",
                1e-4,
                value=level_per_pressure,
                lower=0.0,
                upper=5e-4,
                fitted=True,
                description="growth of the half width with pressure",
            ),
            Parameter(
                "breakaway",
                "m",
                value=breakaway,
                lower=5e-5,
                upper=1e-2,
                fitted=True,
                description="contraction over which the loop turns",
            ),
            Parameter(
                "exponent",
                "1",
                value=exponent,
                lower=1.0,
                upper=6.0,
                description="sharpness of the turn",
            ),
        ),
        states=tuple(
            State(
                f"turn_{i + 1}",
                "1",
                1.0,
                "position in the loop",
                lower=-1.05,
                upper=1.05,
                start_rms=0.5,
            )
            for i in range(len(ports))
        ),
        rates=rates,
        about=About(
            "F = F0 - (level + level_per_pressure p) z, dz/dt = (v - |v| |z|^(n-1) z) / breakaway",
            "R. Bouc 1967, Y.-K. Wen 1976; P. R. Dahl 1968 for n = 1",
            look_alikes=("coulomb_friction", "maxwell_slip_hysteresis"),
            separated_by="isometric pressure cycles: joint friction shows no loop there",
        ),
    )
