"""Delays: a signal that arrives late but unchanged, as rational functions of finite order."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Names, Parameter, PortView, State
from workbench.model.face import Expression

FLOOR = 0.002
"""Time, in s, that keeps a delay regular at zero size: the fastest rate is 870 1/s."""


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

    ``Y / U = [1 + (b - D) s + (b^2/3 - b D + D^2/2) s^2] / [1 + b s + b^2 s^2 / 3]`` with
    b = D/2 + f: the second-order Pade function of exp(-D s) for floor f = 0, exactly the identity
    for D = 0, and equal to exp(-D s) up to s^2 in between. Down to -2 f it is a lead, so that a
    fit may pass through zero. Steps come through at once in part: for a command that jumps use
    `lag_chain`.

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
        Effect of size ``time`` with two states per port.

    Raises:
        WorkbenchError: If the time is outside its bounds.

    Example:
        >>> [state.name for state in delay().states]
        ['late_1', 'slope_1']
    """
    own_units = units or (unit,) * len(ports)
    own_scales = scales or (1.0,) * len(ports)

    def remainder(at: PortView | int, value: Expression, x: Names) -> Expression:
        number = at if isinstance(at, int) else at.index + 1
        return value - x[f"late_{number}"] - x[f"slope_{number}"]

    def transform(at: PortView) -> Expression:
        b = 0.5 * at.p.time + FLOOR
        r = at.p.time / b
        late, slope = at.x[f"late_{at.index + 1}"], at.x[f"slope_{at.index + 1}"]
        rest = remainder(at, at.value, at.x)
        return late + (1.0 - r) * slope + (1.0 - 3.0 * r + 1.5 * r * r) * rest

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        b = 0.5 * effect.p.time + FLOOR
        result = {}
        for at in effect.at.values():
            number = at.index + 1
            # the slope is b times the rate, so that both states have the unit of the signal
            result[f"late_{number}"] = effect.x[f"slope_{number}"] / b
            result[f"slope_{number}"] = 3.0 / b * remainder(number, at.value, effect.x)
        return result

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {f"late_{at.index + 1}": at.value for at in effect.at.values()}

    return Effect(
        name,
        ports,
        transform,
        parameters=(_time(time, -FLOOR, upper, typical),),
        states=tuple(
            State(
                f"{kind}_{i + 1}", own_units[i], own_scales[i], text, start_rms=0.05 * own_scales[i]
            )
            for i in range(len(ports))
            for kind, text in (("late", "filtered signal"), ("slope", "its rate times b"))
        ),
        rates=rates,
        start=start,
        about=About(
            "Y / U = exp(-D s), second-order Pade",
            "H. Pade 1892",
            look_alikes,
            separated_by,
        ),
    )


def lag_chain(
    port: str = "valve.command",
    *,
    time: float = 0.005,
    stages: int = 3,
    unit: str = "V",
    scale: float = 1.0,
    upper: float = 0.1,
    typical: float = 0.005,
    look_alikes: tuple[str, ...] = ("spool_bandwidth", "slew_limit"),
    separated_by: str = "steps of the command beside a fast spool or flow sensor",
    name: str = "lag_chain",
) -> Effect:
    """Build a delay of a command that may jump, as a chain of equal lags.

    ``Y / U = [(1 + f s) / (1 + (D/n + f) s)]^n`` with f = 1 ms: exactly the identity for D = 0, and
    an Erlang-distributed delay with mean D and spread D / sqrt(n) for D >> n f.

    Args:
        port: Port on which it acts.
        time: Delay D, in s.
        stages: Number n of lags.
        unit: Unit of the port.
        scale: Typical size of the signal, in ``unit``.
        upper: Largest plausible delay, in s.
        typical: Usual delay, in s; scales the fit.
        look_alikes: Names of effects that the same data may not separate.
        separated_by: The experiment that tells it from them.
        name: Name of the effect.

    Returns:
        Effect of size ``time`` with one state per stage.

    Raises:
        WorkbenchError: If the time is outside its bounds.

    Example:
        >>> len(lag_chain().states)
        3
    """
    floor = 0.5 * FLOOR

    def stage_values(value: Expression, p: Names, x: Names) -> list[Expression]:
        """Return the signal before each stage and after the last."""
        each = p.time / stages
        values = [value]
        for i in range(stages):
            before = values[-1]
            values.append(before - each / (each + floor) * (before - x[f"stage_{i + 1}"]))
        return values

    def transform(at: PortView) -> Expression:
        return stage_values(at.value, at.p, at.x)[-1]

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        values = stage_values(effect.at[port].value, effect.p, effect.x)
        constant = effect.p.time / stages + floor
        return {
            f"stage_{i + 1}": (values[i] - effect.x[f"stage_{i + 1}"]) / constant
            for i in range(stages)
        }

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {f"stage_{i + 1}": effect.at[port].value for i in range(stages)}

    return Effect(
        name,
        (port,),
        transform,
        parameters=(_time(time, 0.0, upper, typical),),
        states=tuple(
            State(
                f"stage_{i + 1}", unit, scale, f"signal after lag {i + 1}", start_rms=0.05 * scale
            )
            for i in range(stages)
        ),
        rates=rates,
        start=start,
        about=About(
            "Y / U = [(1 + f s) / (1 + (D/n + f) s)]^n",
            "A. K. Erlang; chain of lags",
            look_alikes,
            separated_by,
        ),
    )
