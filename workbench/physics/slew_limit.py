"""Slew limit: a follower with a largest speed."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression
from workbench.physics.port_units import per


def slew_limit(
    port: str = "valve.command",
    *,
    share: float = 1.0,
    largest_rate: float = 1000.0,
    time_constant: float = 0.001,
    unit: str = "V",
    scale: float = 1.0,
    name: str = "slew_limit",
) -> Effect:
    """Build a follower whose speed saturates, in part or in whole.

    ``dy/dt = r tanh((u - y) / (r tau))``, output ``u + share (y - u)``: a lag of time constant tau
    for small differences, the largest rate r for large ones.

    Args:
        port: Port on which it acts.
        share: Share of the limited signal, a fraction; 1 is the law, 0 its absence.
        largest_rate: Largest speed r, in ``unit`` per s.
        time_constant: Time constant tau of small motions, in s; the fastest rate is its inverse.
        unit: Unit of the port.
        scale: Typical size of the signal, in ``unit``.
        name: Name of the effect.

    Returns:
        Effect of size ``share`` with one state.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> slew_limit(largest_rate=500.0).parameters[1].unit
        'V/s'
    """

    def transform(at: PortView) -> Expression:
        return at.value + at.p.share * (at.x.follower - at.value)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        r, tau = effect.p.largest_rate, effect.p.time_constant
        away = effect.at[port].value - effect.x.follower
        return {"follower": r * ca.tanh(away / (r * tau))}

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {"follower": effect.at[port].value}

    return Effect(
        name,
        (port,),
        transform,
        parameters=(
            Parameter("share", "1", 1.0, "share of the limited signal", share, 0.0, 1.0),
            Parameter(
                "largest_rate",
                per(unit, "s"),
                largest_rate,
                "largest speed",
                largest_rate,
                0.01 * largest_rate,
                10.0 * largest_rate,
                "estimate",
                fitted=True,
            ),
            Parameter(
                "time_constant",
                "s",
                time_constant,
                "time constant of small motions",
                time_constant,
                0.1 * time_constant,
                100.0 * time_constant,
            ),
        ),
        states=(
            State("follower", unit, scale, "signal with limited speed", start_rms=0.05 * scale),
        ),
        rates=rates,
        start=start,
        about=About(
            "dy/dt = r tanh((u - y) / (r tau))",
            "saturated first-order follower; manufacturer: 4 to 5 ms for the full stroke",
            look_alikes=("valve_delay", "spool_bandwidth"),
            separated_by="steps of the command of several sizes: only large ones are slowed",
        ),
    )
