"""First-order lag of a signal: a slow sensor, a filter, a slow amplifier."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression

FLOOR = 0.001
"""Time, in s, that keeps a lag regular at zero size: the fastest rate is 1000 1/s."""


def _constant(time: Expression) -> Expression:
    """Time constant with what keeps it regular, in s: f at zero time, nothing beside a long one."""
    return time + FLOOR * FLOOR / (time + FLOOR)


def lag(
    ports: tuple[str, ...] = ("pressure_1.reading", "pressure_2.reading"),
    *,
    time: float = 0.02,
    unit: str = "Pa",
    scale: float = 1e5,
    upper: float = 0.5,
    typical: float = 0.02,
    look_alikes: tuple[str, ...] = ("sensor_delay",),
    separated_by: str = "steps faster than the lag, beside a fast reference sensor",
    name: str = "lag",
) -> Effect:
    """Build a first-order lag that vanishes at zero time.

    ``Y / U = (1 + g s) / (1 + (time + g) s)`` with g = f^2 / (time + f) and f = 1 ms: exactly the
    identity at zero time, and a lag of that time for time >> f. Written as
    ``dm/dt = (u - m) / (time + g)``, ``y = u - time / (time + g) (u - m)``.

    Args:
        ports: Ports on which the same law acts, each with a memory of its own.
        time: Time constant, in s.
        unit: Unit of the ports.
        scale: Typical size of the signal, in ``unit``.
        upper: Largest plausible time, in s.
        typical: Usual time, in s; scales the fit.
        look_alikes: Names of effects that the same data may not separate.
        separated_by: The experiment that tells it from them.
        name: Name of the effect.

    Returns:
        Effect of size ``time`` with one state per port.

    Raises:
        WorkbenchError: If the time is outside its bounds.

    Example:
        >>> [state.name for state in lag().states]
        ['memory_1', 'memory_2']
    """

    def transform(at: PortView) -> Expression:
        late = at.value - at.x[f"memory_{at.index + 1}"]
        return at.value - at.p.time / _constant(at.p.time) * late

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        result = {}
        for at in effect.at.values():
            key = f"memory_{at.index + 1}"
            result[key] = (at.value - effect.x[key]) / _constant(effect.p.time)
        return result

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {f"memory_{at.index + 1}": at.value for at in effect.at.values()}

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("time", "s", typical, "time constant", time, 0.0, upper, fitted=True),
        ),
        states=tuple(
            State(
                f"memory_{i + 1}",
                unit,
                scale,
                f"lagging signal of port {i + 1}",
                start_rms=0.05 * scale,
            )
            for i in range(len(ports))
        ),
        rates=rates,
        start=start,
        about=About(
            "Y / U = (1 + g s) / (1 + (time + g) s)",
            "first-order lag",
            look_alikes,
            separated_by,
        ),
    )
