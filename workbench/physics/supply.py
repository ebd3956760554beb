"""The air supply: a reservoir behind a regulator."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression
from workbench.physics.flow import orifice_flow
from workbench.physics.gas import AIR

_CRITICAL_RATIO = 0.3


def supply_droop(
    port: str = "supply.pressure",
    *,
    volume: float = 5e-4,
    conductance: float = 1e-8,
    name: str = "supply_droop",
) -> Effect:
    """Build a supply whose pressure falls while flow is drawn.

    ``dp/dt = gamma R T (flow_regulator - flow_drawn) / volume`` with an ISO 6358 restriction
    between the constant source and the reservoir.

    Args:
        port: Port of the supply pressure, with the local signal ``temperature``; the model must
            publish ``supply.flow``.
        volume: Reservoir volume, in m^3.
        conductance: Sonic conductance between source and reservoir, in m^3/(s Pa).
        name: Name of the effect.

    Returns:
        Effect replacing the constant pressure by that of the reservoir.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> supply_droop(volume=1e-3).parameters[0].value
        0.001
    """

    def transform(at: PortView) -> Expression:
        return at.x.pressure

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        at = effect.at[port]
        temperature = at.signals.temperature
        feed = orifice_flow(
            at.value,
            effect.x.pressure,
            temperature,
            temperature,
            effect.p.conductance,
            _CRITICAL_RATIO,
            face=effect.face,
        )
        stiffness = AIR.heat_ratio * AIR.gas_constant * temperature / effect.p.volume
        return {"pressure": stiffness * (feed - effect.values["supply.flow"])}

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {"pressure": effect.at[port].value}

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "volume",
                "m3",
                value=volume,
                lower=1e-5,
                upper=0.1,
                fitted=True,
                description="reservoir volume",
            ),
            Parameter(
                "conductance",
                "m3/(s Pa)",
                value=conductance,
                lower=1e-10,
                upper=1e-6,
                fitted=True,
                description="sonic conductance of the feed",
            ),
        ),
        states=(State("pressure", "Pa", 1e5, "pressure of the reservoir", initial=7e5, lower=0.0),),
        rates=rates,
        start=start,
        about=About(
            "dp/dt = gamma R T (flow_feed - flow_drawn) / V",
            "lumped reservoir; ISO 6358 restriction",
            look_alikes=("valve conductance",),
            separated_by="fill both muscles in quick succession",
        ),
    )
