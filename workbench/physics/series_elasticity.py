"""Elasticity in series with a muscle: tendons, fittings and clamps that stretch."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression
from workbench.physics.force_laws import ForceLaw, PaperLaw

_LAG = 0.005
"""Time, in s, in which the stretch follows the force: shorter than any motion of the rig."""


def series_elasticity(
    ports: tuple[str, ...] = ("muscle_1.tension", "muscle_2.tension"),
    *,
    compliance: float = 7e-6,
    law: ForceLaw | None = None,
    name: str = "series_elasticity",
) -> Effect:
    """Build tendons: a muscle contracts more than its anchors by what the tendon stretches.

    ``T = T_0(q) + [T_law(q + compliance F) - T_law(q)]``, with the force F in the tendon following
    within 5 ms, which avoids an algebraic loop. The gas volume is left at the anchors' length: at
    500 N and 7e-6 m/N it would be 3.5 mm, some 5 % of volume, off.

    Args:
        ports: Ports of muscle tensions, with the local signals ``contraction`` and
            ``gauge_pressure``.
        compliance: Stretch over force, in m/N: the inverse of the stiffness.
        law: Force law for the slope over contraction; the paper's equation (4) by default.
        name: Name of the effect.

    Returns:
        Effect of size ``compliance`` with one state per port.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> series_elasticity().parameters[0].unit
        'm/N'
    """
    base = law or PaperLaw()

    def transform(at: PortView) -> Expression:
        q, p = at.signals.contraction, at.signals.gauge_pressure
        stretch = at.p.compliance * at.x[f"pull_{at.index + 1}"]
        return (
            at.value + base.tension(q + stretch, p, face=at.face) - base.tension(q, p, face=at.face)
        )

    def pull(effect: EffectView, at: PortView) -> Expression:
        return at.face.ramp(effect.values[at.port], 1.0)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        return {
            f"pull_{at.index + 1}": (pull(effect, at) - effect.x[f"pull_{at.index + 1}"]) / _LAG
            for at in effect.at.values()
        }

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {f"pull_{at.index + 1}": at.face.ramp(at.value, 1.0) for at in effect.at.values()}

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "compliance",
                "m/N",
                7e-6,
                "stretch of the tendon over its force",
                compliance,
                0.0,
                2e-5,
                "1e5 to 2e5 N/m in the literature",
                fitted=True,
            ),
        ),
        states=tuple(
            State(f"pull_{i + 1}", "N", 100.0, "force in the tendon", 300.0)
            for i in range(len(ports))
        ),
        rates=rates,
        start=start,
        about=About(
            "T = T(q + compliance F)",
            "A. V. Hill 1938, series element; compliance of fittings",
            look_alikes=("force_shape", "contraction_force_correction", "linear_spring"),
            separated_by="pressure steps with the joint locked at several angles",
        ),
    )
