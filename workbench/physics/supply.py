"""The air supply: a reservoir behind a regulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping

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
    share: float = 1.0,
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
        share: Share of the law, a fraction: 1 is the law, 0 its absence.
        name: Name of the effect.

    Returns:
        Effect replacing the constant pressure by that of the reservoir.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> supply_droop(volume=1e-3).parameters[0].value
        0.001
    """

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

    return _reservoir(
        name,
        port,
        volume,
        Parameter(
            "conductance",
            "m3/(s Pa)",
            value=conductance,
            lower=1e-10,
            upper=1e-6,
            fitted=True,
            description="sonic conductance of the feed",
        ),
        share,
        rates,
        About(
            "dp/dt = gamma R T (flow_feed - flow_drawn) / V",
            "lumped reservoir; ISO 6358 restriction",
            look_alikes=("regulator_droop",),
            separated_by="fill both muscles in quick succession",
        ),
    )


def reservoir_droop(
    port: str = "supply.pressure",
    *,
    volume: float = 5e-4,
    gain: float = 5e-9,
    share: float = 1.0,
    name: str = "reservoir_droop",
) -> Effect:
    """Build a reservoir that a proportional regulator refills.

    ``dp/dt = R T (gain (p_0 - p) - flow_drawn) / volume``: the regulator opens in proportion to
    the pressure that is missing; the large reservoir stays at the temperature of its wall.

    Args:
        port: Port of the supply pressure, with the local signal ``temperature``; the model must
            publish ``supply.flow``.
        volume: Reservoir volume, in m^3.
        gain: Refilling flow per missing pressure, in kg/(s Pa).
        share: Share of the law, a fraction: 1 is the law, 0 its absence.
        name: Name of the effect.

    Returns:
        Effect replacing the constant pressure by that of the reservoir.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> reservoir_droop(gain=1e-8).parameters[1].unit
        'kg/(s Pa)'
    """

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        at = effect.at[port]
        refill = effect.p.gain * (at.value - effect.x.pressure)
        stiffness = AIR.gas_constant * at.signals.temperature / effect.p.volume
        return {"pressure": stiffness * (refill - effect.values["supply.flow"])}

    return _reservoir(
        name,
        port,
        volume,
        Parameter(
            "gain",
            "kg/(s Pa)",
            value=gain,
            lower=1e-11,
            upper=1e-6,
            fitted=True,
            description="refilling flow per missing pressure",
        ),
        share,
        rates,
        About(
            "dp/dt = R T (gain (p_0 - p) - flow_drawn) / V",
            "lumped reservoir behind a proportional regulator",
            look_alikes=("supply_droop", "regulator_droop"),
            separated_by="fill both muscles in quick succession, then hold",
        ),
    )


def _reservoir(
    name: str,
    port: str,
    volume: float,
    feed: Parameter,
    share: float,
    rates: Callable[[EffectView], Mapping[str, Expression]],
    about: About,
) -> Effect:
    """Build an effect that puts the pressure of a reservoir in the place of a constant one."""

    def transform(at: PortView) -> Expression:
        return at.value + at.p.share * (at.x.pressure - at.value)

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
            feed,
            Parameter("share", "1", 1.0, "share of the law; 0 is its absence", share, 0.0, 1.0),
        ),
        states=(State("pressure", "Pa", 1e5, "pressure of the reservoir", initial=7e5, lower=0.0),),
        rates=rates,
        start=start,
        about=about,
    )


def regulator_droop(
    port: str = "supply.pressure",
    *,
    resistance: float = 1e7,
    time_constant: float = 0.05,
    name: str = "regulator_droop",
) -> Effect:
    """Build a regulator whose pressure falls in proportion to the flow drawn.

    ``p = p_0 - resistance q``, ``dq/dt = (flow_drawn - q) / time_constant``: the static droop of a
    regulator with a first-order response, which also avoids an algebraic loop.

    Args:
        port: Port of the supply pressure; the model must publish ``supply.flow``.
        resistance: Droop over flow, in Pa s/kg.
        time_constant: Time in which the regulator responds, in s.
        name: Name of the effect.

    Returns:
        Effect of size ``resistance`` with one state.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> regulator_droop().parameters[0].unit
        'Pa s/kg'
    """

    def transform(at: PortView) -> Expression:
        return at.value - at.p.resistance * at.x.drawn

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        drawn = effect.values["supply.flow"]
        return {"drawn": (drawn - effect.x.drawn) / effect.p.time_constant}

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter(
                "resistance",
                "Pa s/kg",
                1e7,
                "droop over flow",
                resistance,
                0.0,
                1e8,
                "0.1 to 0.4 bar at full flow in the literature",
                fitted=True,
            ),
            Parameter(
                "time_constant",
                "s",
                0.05,
                "response of the regulator",
                time_constant,
                0.005,
                5.0,
                "estimate",
                fitted=True,
            ),
        ),
        states=(State("drawn", "kg/s", 1e-3, "flow that the regulator answers"),),
        rates=rates,
        about=About(
            "p = p0 - R q, dq/dt = (flow_drawn - q) / tau",
            "flow characteristic of a pressure regulator, linearised",
            look_alikes=("supply_droop",),
            separated_by="one long fill: a reservoir runs down, a regulator settles",
        ),
    )
