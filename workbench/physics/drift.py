"""Drift of a sensor: its zero moves while it warms up."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression


def drift(
    ports: tuple[str, ...] = ("pressure_1.reading",),
    *,
    amount: float = 5e3,
    time_constant: float = 60.0,
    unit: str = "Pa",
    upper: float = 5e4,
    typical: float = 5e3,
    look_alikes: tuple[str, ...] = ("sensor_offset", "creep", "chamber_leakage"),
    separated_by: str = "the same holding position at the start and at the end of a recording",
    name: str = "drift",
) -> Effect:
    """Build a zero error that approaches its final value exponentially from the start of a run.

    ``y = u + amount w``, ``dw/dt = (1 - w) / time_constant``, w = 0 at the start; with a time
    constant beyond the length of the run it is a ramp.

    Args:
        ports: Ports that drift alike.
        amount: Final drift, in ``unit``.
        time_constant: Time constant of warming up, in s.
        unit: Unit of the ports.
        upper: Largest plausible magnitude, in ``unit``.
        typical: Usual magnitude, in ``unit``; scales the fit.
        look_alikes: Names of effects that the same data may not separate.
        separated_by: The experiment that tells it from them.
        name: Name of the effect.

    Returns:
        Effect of size ``amount`` with one state.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> drift().states[0].name
        'warm'
    """

    def transform(at: PortView) -> Expression:
        return at.value + at.p.amount * at.x.warm

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        return {"warm": (1.0 - effect.x.warm) / effect.p.time_constant}

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("amount", unit, typical, "final drift", amount, -upper, upper, fitted=True),
            Parameter(
                "time_constant",
                "s",
                time_constant,
                "time constant of warming up",
                time_constant,
                0.05 * time_constant,
                100.0 * time_constant,
            ),
        ),
        states=(State("warm", "1", 1.0, "share of the final drift reached", start_rms=1e-3),),
        rates=rates,
        about=About(
            "y = u + amount w, dw/dt = (1 - w) / tau",
            "thermal zero drift of a bridge",
            look_alikes,
            separated_by,
        ),
    )
