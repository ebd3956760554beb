"""Creep: part of a signal arrives late, over seconds or minutes."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Parameter, PortView, State
from workbench.model.face import Expression


def creep(
    ports: tuple[str, ...] = ("muscle_1.force", "muscle_2.force"),
    *,
    share: float = 0.02,
    slow_part: float = 0.5,
    time_constant: float = 1.0,
    slow_time_constant: float = 30.0,
    unit: str = "N",
    scale: float = 100.0,
    name: str = "creep",
) -> Effect:
    """Build a signal part of which follows with two time constants.

    ``y = u - share [(1 - slow_part) (u - m_1) + slow_part (u - m_2)]``, ``dm_i/dt = (u - m_i) /
    tau_i``: a standard linear solid. After a step the signal is 1 - share of its final value at
    once and creeps to it.

    Args:
        ports: Ports on which the same law acts, each with memories of its own.
        share: Part of the signal that arrives late, a fraction of it.
        slow_part: Part of the share that follows with the slow time constant, a fraction.
        time_constant: Fast time constant, in s.
        slow_time_constant: Slow time constant, in s.
        unit: Unit of the ports.
        scale: Typical size of the signal, in ``unit``.
        name: Name of the effect.

    Returns:
        Effect of size ``share`` with two states per port.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> [state.name for state in creep(("muscle.force",)).states]
        ['fast_1', 'slow_1']
    """

    def transform(at: PortView) -> Expression:
        fast, slow = at.x[f"fast_{at.index + 1}"], at.x[f"slow_{at.index + 1}"]
        late = (1.0 - at.p.slow_part) * (at.value - fast) + at.p.slow_part * (at.value - slow)
        return at.value - at.p.share * late

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        result = {}
        for at in effect.at.values():
            for kind, tau in (
                ("fast", effect.p.time_constant),
                ("slow", effect.p.slow_time_constant),
            ):
                key = f"{kind}_{at.index + 1}"
                result[key] = (at.value - effect.x[key]) / tau
        return result

    def start(effect: EffectView) -> Mapping[str, Expression]:
        return {
            f"{kind}_{at.index + 1}": at.value
            for at in effect.at.values()
            for kind in ("fast", "slow")
        }

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter("share", "1", 0.02, "part that arrives late", share, -0.2, 0.2, fitted=True),
            Parameter(
                "slow_part",
                "1",
                0.5,
                "part of the share with the slow time constant",
                slow_part,
                0.0,
                1.0,
                "estimate",
                fitted=True,
            ),
            Parameter(
                "time_constant",
                "s",
                time_constant,
                "fast time constant",
                time_constant,
                0.1 * time_constant,
                10.0 * time_constant,
                "estimate",
                fitted=True,
            ),
            Parameter(
                "slow_time_constant",
                "s",
                slow_time_constant,
                "slow time constant",
                slow_time_constant,
                0.1 * slow_time_constant,
                10.0 * slow_time_constant,
                "estimate",
            ),
        ),
        states=tuple(
            State(f"{kind}_{i + 1}", unit, scale, f"{kind} memory of port {i + 1}")
            for i in range(len(ports))
            for kind in ("fast", "slow")
        ),
        rates=rates,
        start=start,
        about=About(
            "y = u - share [(1 - s)(u - m1) + s (u - m2)], dm/dt = (u - m) / tau",
            "standard linear solid, C. Zener 1948; creep of rubber tubes in braided muscles",
            look_alikes=("maxwell_slip_hysteresis", "chamber_leakage", "sensor_drift"),
            separated_by="hold valve and angle for a minute after a step of pressure",
        ),
    )
