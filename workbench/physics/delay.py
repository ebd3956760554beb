"""Delays: a signal that arrives late but unchanged, as rational functions of finite order."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Names, Parameter, PortView, State
from workbench.model.face import Expression

FLOOR = 0.002
"""Time f, in s, that keeps a delay regular at zero size: the fastest rate is 1220 1/s."""


def _spare(time: Expression) -> Expression:
    """Time g = f^2 / (D + f), in s: f at zero delay, nothing beside a long one."""
    return FLOOR * FLOOR / (time + FLOOR)


def _time(time: float, lower: float, upper: float, typical: float) -> Parameter:
    return Parameter("time", "s", typical, "delay", time, lower, upper, fitted=True)


def delay(
    ports: tuple[str, ...] = ("angle.reading",),
    *,
    time: float = 0.01,
    unit: str = "rad",
    units: tuple[str, ...] = (),
    scales: tuple[float, ...] = (),
    upper: float = 0.2,
    typical: float = 0.01,
    look_alikes: tuple[str, ...] = ("sensor_lag",),
    separated_by: str = "sines of two frequencies: the phase of a delay is proportional to both",
    name: str = "delay",
) -> Effect:
    """Build a delay of continuous signals that vanishes at zero time.

    ``Y / U = E(g s) / E((D + g) s)`` with E(x) = 1 + x + x^2 / 2 + x^3 / 6 and g = f^2 / (D + f):
    exactly the identity for D = 0, and exp(-D s) up to s^3 for all D. Its zeros are stable, so that
    a filter can tell the signal from the reading; the error of its amplitude is (w D)^4 / 24 at the
    frequency w. Down to -f / 2 it is a lead, so that a fit may pass through zero. Steps overshoot:
    for a command that jumps use `command_delay`.

    Args:
        ports: Ports that are all late by the same time.
        time: Delay D, in s.
        unit: Unit of the ports.
        units: Unit of each port, where they differ.
        scales: Typical size of each port's signal, in its unit; 1 by default.
        upper: Largest plausible delay, in s.
        typical: Usual delay, in s; scales the fit.
        look_alikes: Names of effects that the same data may not separate.
        separated_by: The experiment that tells it from them.
        name: Name of the effect.

    Returns:
        Effect of size ``time`` with three states per port.

    Raises:
        WorkbenchError: If the time is outside its bounds.

    Example:
        >>> [state.name for state in delay().states]
        ['late_1', 'slope_1', 'bend_1']
    """
    own_units = units or (unit,) * len(ports)
    own_scales = scales or (1.0,) * len(ports)

    def rest(at: PortView, x: Names) -> Expression:
        number = at.index + 1
        return at.value - x[f"late_{number}"] - x[f"slope_{number}"] - 0.5 * x[f"bend_{number}"]

    def transform(at: PortView) -> Expression:
        spare, number = _spare(at.p.time), at.index + 1
        share = spare / (at.p.time + spare)
        slope, bend = at.x[f"slope_{number}"], at.x[f"bend_{number}"]
        smooth = at.x[f"late_{number}"] + share * (slope + 0.5 * share * bend)
        return smooth + share * share * share * rest(at, at.x)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        whole = effect.p.time + _spare(effect.p.time)
        result = {}
        for at in effect.at.values():
            number = at.index + 1
            # Derivatives times powers of the time constant, so that all have the signal's unit.
            result[f"late_{number}"] = effect.x[f"slope_{number}"] / whole
            result[f"slope_{number}"] = effect.x[f"bend_{number}"] / whole
            result[f"bend_{number}"] = 6.0 / whole * rest(at, effect.x)
        return result

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {f"late_{at.index + 1}": at.value for at in effect.at.values()}

    return Effect(
        name,
        ports,
        transform,
        parameters=(_time(time, -0.5 * FLOOR, upper, typical),),
        states=tuple(
            State(
                f"{kind}_{i + 1}", own_units[i], own_scales[i], text, start_rms=0.05 * own_scales[i]
            )
            for i in range(len(ports))
            for kind, text in (
                ("late", "filtered signal"),
                ("slope", "its rate times D + g"),
                ("bend", "the rate of that times D + g"),
            )
        ),
        rates=rates,
        start=start,
        about=About(
            "Y / U = exp(-D s), to third order",
            "B. Taylor 1715, of the inverse",
            look_alikes,
            separated_by,
        ),
    )


def command_delay(
    port: str = "valve.command",
    *,
    time: float = 0.005,
    unit: str = "V",
    scale: float = 1.0,
    upper: float = 0.1,
    typical: float = 0.005,
    look_alikes: tuple[str, ...] = ("clock_shift", "spool_bandwidth", "slew_limit"),
    separated_by: str = "steps of the command beside a fast spool or flow sensor",
    name: str = "command_delay",
) -> Effect:
    """Build a delay of a command that may jump.

    ``Y / U = [1 + (2 b/3 - D) s + (b^2/6 - 2 b D/3 + D^2/2) s^2] / [1 + 2 b s/3 + b^2 s^2 / 6]``
    with b = D + g and g = f^2 / (D + f): exactly the identity for D = 0, exp(-D s) up to s^2
    between, and the Pade function of first over second order for D >> f, of which no part of a jump
    comes through at once.

    Args:
        port: Port on which it acts.
        time: Delay D, in s.
        unit: Unit of the port.
        scale: Typical size of the signal, in ``unit``.
        upper: Largest plausible delay, in s.
        typical: Usual delay, in s; scales the fit.
        look_alikes: Names of effects that the same data may not separate.
        separated_by: The experiment that tells it from them.
        name: Name of the effect.

    Returns:
        Effect of size ``time`` with two states.

    Raises:
        WorkbenchError: If the time is outside its bounds.

    Example:
        >>> [state.name for state in command_delay().states]
        ['late', 'slope']
    """

    def rest(value: Expression, x: Names) -> Expression:
        return value - x.late - 2.0 / 3.0 * x.slope

    def transform(at: PortView) -> Expression:
        r = at.p.time / (at.p.time + _spare(at.p.time))
        smooth = at.x.late + (2.0 / 3.0 - r) * at.x.slope
        return smooth + (1.0 - 4.0 * r + 3.0 * r * r) * rest(at.value, at.x)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        b = effect.p.time + _spare(effect.p.time)
        # The slope is b times the rate, so that both states have the unit of the signal.
        return {
            "late": effect.x.slope / b,
            "slope": 6.0 / b * rest(effect.at[port].value, effect.x),
        }

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {"late": effect.at[port].value}

    return Effect(
        name,
        (port,),
        transform,
        parameters=(_time(time, 0.0, upper, typical),),
        states=(
            State("late", unit, scale, "filtered signal", start_rms=0.05 * scale),
            State("slope", unit, scale, "its rate times b", start_rms=0.05 * scale),
        ),
        rates=rates,
        start=start,
        about=About(
            "Y / U = exp(-D s), Pade function of first over second order",
            "H. Pade 1892",
            look_alikes,
            separated_by,
        ),
    )
