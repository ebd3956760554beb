"""Volumes and restrictions in the air lines: tubes to the chambers and exhaust silencers."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression
from workbench.physics.flow import orifice_flow
from workbench.physics.gas import AIR

_CRITICAL_RATIO = 0.3


def _volume_parameter(volume: float) -> Parameter:
    return Parameter(
        "volume",
        "m3",
        1e-5,
        value=volume,
        lower=1e-6,
        upper=1e-3,
        fitted=True,
        description="gas volume",
    )


def _conductance_parameter(conductance: float) -> Parameter:
    return Parameter(
        "conductance",
        "m3/(s Pa)",
        1e-8,
        value=conductance,
        lower=1e-9,
        upper=1e-6,
        fitted=True,
        description="sonic conductance",
    )


def _share_parameter(share: float) -> Parameter:
    return Parameter("share", "1", 1.0, "share of the law; 0 is its absence", share, 0.0, 1.0)


def line(
    number: int = 1,
    *,
    volume: float = 1e-5,
    conductance: float = 4e-8,
    share: float = 1.0,
    name: str = "",
) -> Effect:
    """Build the tube between the valve and one chamber: a volume, then a restriction.

    ``dp/dt = gamma R T (flow_valve - flow_chamber) / volume``; the valve sees the pressure of the
    tube, the chamber receives the flow through the restriction. Tube and chamber have the same
    temperature.

    Args:
        number: Chamber 1 or 2.
        volume: Gas volume of the tube, in m^3.
        conductance: Sonic conductance between tube and chamber, in m^3/(s Pa).
        share: Share of the law, a fraction: 1 is the law, 0 its absence. Mass is conserved at
            these two only.
        name: Name of the effect; ``line_1`` or ``line_2`` by default.

    Returns:
        Effect on the ports ``line_N.pressure`` and ``chamber_N.flow``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> line(2).ports
        ('line_2.pressure', 'chamber_2.flow')
    """
    pressure_port, flow_port = f"line_{number}.pressure", f"chamber_{number}.flow"

    def through(at: PortView) -> Expression:
        s = at.signals
        return orifice_flow(
            at.x.pressure,
            s.pressure,
            s.temperature,
            s.temperature,
            at.p.conductance,
            _CRITICAL_RATIO,
            face=at.face,
        )

    def transform(at: PortView) -> Expression:
        passed = at.x.pressure if at.port == pressure_port else through(at)
        return at.value + at.p.share * (passed - at.value)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        at = effect.at[flow_port]
        stiffness = AIR.heat_ratio * AIR.gas_constant * at.signals.temperature / effect.p.volume
        return {"pressure": stiffness * (at.value - through(at))}

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {"pressure": effect.at[pressure_port].value}

    return Effect(
        name or f"line_{number}",
        (pressure_port, flow_port),
        transform,
        parameters=(
            _volume_parameter(volume),
            _conductance_parameter(conductance),
            _share_parameter(share),
        ),
        states=(State("pressure", "Pa", 1e5, "pressure in the tube", initial=4e5, lower=0.0),),
        rates=rates,
        start=start,
        about=About(
            "dp/dt = gamma R T (flow_valve - flow_chamber) / V",
            "lumped volume on every port of the paper's valve; ISO 6358 restriction",
            look_alikes=("spool_bandwidth", "sensor_lag"),
            separated_by="fast valve pulses with a flow meter",
        ),
    )


def silencer(
    number: int = 1,
    *,
    volume: float = 1e-5,
    conductance: float = 6e-8,
    share: float = 1.0,
    name: str = "",
) -> Effect:
    """Build an exhaust silencer: a volume that blows to ambient through a restriction.

    ``dp/dt = gamma R T (flow_exhaust - flow_ambient) / volume``; the valve exhausts into the
    silencer's pressure.

    Args:
        number: Exhaust of chamber 1 or 2.
        volume: Gas volume of the silencer, in m^3.
        conductance: Sonic conductance to ambient, in m^3/(s Pa).
        share: Share of the law, a fraction: 1 is the law, 0 its absence.
        name: Name of the effect; ``silencer_1`` or ``silencer_2`` by default.

    Returns:
        Effect on the port ``exhaust_N.pressure``.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> silencer(2).ports
        ('exhaust_2.pressure',)
    """
    port = f"exhaust_{number}.pressure"

    def transform(at: PortView) -> Expression:
        return at.value + at.p.share * (at.x.pressure - at.value)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        at = effect.at[port]
        temperature = at.signals.temperature
        blown = orifice_flow(
            effect.x.pressure,
            at.value,
            temperature,
            temperature,
            effect.p.conductance,
            _CRITICAL_RATIO,
            face=effect.face,
        )
        stiffness = AIR.heat_ratio * AIR.gas_constant * temperature / effect.p.volume
        return {"pressure": stiffness * (effect.values[f"exhaust_{number}.flow"] - blown)}

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {"pressure": effect.at[port].value}

    return Effect(
        name or f"silencer_{number}",
        (port,),
        transform,
        parameters=(
            _volume_parameter(volume),
            _conductance_parameter(conductance),
            _share_parameter(share),
        ),
        states=(
            State("pressure", "Pa", 1e5, "pressure in the silencer", initial=1.01325e5, lower=0.0),
        ),
        rates=rates,
        start=start,
        about=About(
            "dp/dt = gamma R T (flow_exhaust - flow_ambient) / V",
            "silencers of the paper's valve; ISO 6358 restriction",
            look_alikes=("asymmetric_gain", "edge_gain"),
            separated_by="venting from high pressure against filling",
        ),
    )
