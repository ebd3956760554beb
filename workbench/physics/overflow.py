"""Overflow: what a full store cannot hold is spilled."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression
from workbench.physics.port_units import per


def overflow(
    port: str = "upper_tank.flow",
    *,
    coefficient: float = 1.0,
    limit: float = 10.0,
    into: str = "",
    caught: float = 0.0,
    level_signal: str = "level",
    unit: str = "m3/s",
    level_unit: str = "m",
    level_scale: float = 1.0,
    lag: float = 0.1,
    upper: float = 1e3,
    typical: float = 1.0,
    name: str = "overflow",
) -> Effect:
    """Build a store whose level beyond a limit runs over, partly into another store.

    ``flow = flow - coefficient s``, ``ds/dt = (max(0, level - limit) - s) / lag``; the store
    ``into`` gains ``caught coefficient s``. The lag, short beside the store's own time, lets both
    stores see the same spill.

    Args:
        port: Port of the net inflow of the store, with the local signal ``level_signal``.
        coefficient: Spill over excess level, in ``unit`` per ``level_unit``.
        limit: Level of the brim, in the unit of the level.
        into: Port of the net inflow of the store that catches a part, or nothing.
        caught: Part of the spill that is caught, a fraction.
        level_signal: Name of the local signal that is the level.
        unit: Unit of the ports.
        level_unit: Unit of the level.
        level_scale: Typical level, in the unit of the level.
        lag: Time in which the spill follows, in s.
        upper: Largest plausible coefficient, in ``unit`` per ``level_unit``.
        typical: Usual coefficient, in ``unit`` per ``level_unit``; scales the fit.
        name: Name of the effect.

    Returns:
        Effect of size ``coefficient`` with one state.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> overflow(into="lower_tank.flow", caught=0.5).ports
        ('upper_tank.flow', 'lower_tank.flow')
    """

    def transform(at: PortView) -> Expression:
        spill = at.p.coefficient * at.x.excess
        return at.value - spill if at.port == port else at.value + at.p.caught * spill

    def excess(at: PortView) -> Expression:
        beyond = at.signals[level_signal] - at.p.limit
        return at.face.ramp(beyond, 0.005 * level_scale)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        return {"excess": (excess(effect.at[port]) - effect.x.excess) / lag}

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {"excess": excess(effect.at[port])}

    catching = (
        Parameter(
            "caught", "1", 0.5, "part of the spill that is caught", caught, 0.0, 1.0, fitted=True
        ),
    )
    return Effect(
        name,
        (port, into) if into else (port,),
        transform,
        parameters=(
            Parameter(
                "coefficient",
                per(unit, level_unit),
                typical,
                "spill over excess level",
                coefficient,
                0.0,
                upper,
                fitted=True,
            ),
            Parameter(
                "limit",
                level_unit,
                level_scale,
                "level of the brim",
                limit,
                source="estimate",
                fitted=True,
            ),
            *(catching if into else ()),
        ),
        states=(State("excess", level_unit, level_scale, "level beyond the brim"),),
        rates=rates,
        start=start,
        about=About(
            "flow = flow - coefficient max(0, level - limit)",
            "broad-crested brim, linearised",
            look_alikes=("saturation",),
            separated_by="fill slowly beyond the brim: the level stops rising",
        ),
    )
