"""A load that is not rigidly attached: it swings on a spring and a damper."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.model import About, Effect, EffectView, Names, Parameter, PortView, State
from workbench.model.face import Expression


def loose_load(
    ports: tuple[str, str] = ("joint.inertia", "joint.torque"),
    *,
    share: float = 1.0,
    frequency: float = 40.0,
    damping: float = 0.1,
    radius: float = 0.3698,
    name: str = "loose_load",
) -> Effect:
    """Build a load coupled to the arm by a spring and a damper, in part or in whole.

    With J_l = load radius^2 and the load's own angle phi: ``T_c = J_l [w^2 (theta - phi) +
    2 d w (omega - dphi/dt)]``, ``J_l d2phi/dt2 = T_c``, ``T = T - share T_c``,
    ``J = J - share J_l``.

    Args:
        ports: Port of the inertia, with the local signal ``load``, and port of the torque, with
            ``angle``, ``speed`` and ``load``.
        share: Part of the load that is loose, a fraction.
        frequency: Natural frequency w of the loose load with the arm held, in rad/s.
        damping: Damping ratio d of it, dimensionless.
        radius: Radius of gyration of the load about the joint, in m.
        name: Name of the effect.

    Returns:
        Effect of size ``share`` with two states.

    Raises:
        WorkbenchError: If a value is outside its bounds.

    Example:
        >>> [state.name for state in loose_load().states]
        ['angle', 'speed']
    """
    inertia_port, torque_port = ports

    def acceleration(p: Names, x: Names, signals: Names) -> Expression:
        spring = p.frequency * p.frequency * (signals.angle - x.angle)
        return spring + 2.0 * p.damping * p.frequency * (signals.speed - x.speed)

    def transform(at: PortView) -> Expression:
        loose = at.p.share * at.signals.load * radius**2
        if at.port == inertia_port:
            return at.value - loose
        return at.value - loose * acceleration(at.p, at.x, at.signals)

    def rates(effect: EffectView) -> Mapping[str, Expression]:
        signals = effect.at[torque_port].signals
        return {"angle": effect.x.speed, "speed": acceleration(effect.p, effect.x, signals)}

    def start(effect: EffectView) -> Mapping[str, Expression]:
        signals = effect.at[torque_port].signals
        return {"angle": signals.angle, "speed": signals.speed}

    return Effect(
        name,
        ports,
        transform,
        parameters=(
            Parameter(
                "share", "1", 1.0, "part of the load that is loose", share, 0.0, 1.0, fitted=True
            ),
            Parameter(
                "frequency",
                "rad/s",
                40.0,
                "natural frequency with the arm held",
                frequency,
                5.0,
                300.0,
                "estimate",
                fitted=True,
            ),
            Parameter(
                "damping",
                "1",
                0.1,
                "damping ratio",
                damping,
                0.0,
                2.0,
                "estimate",
                fitted=True,
            ),
        ),
        states=(
            State("angle", "rad", 1.0, "angle of the loose load", 0.5),
            State("speed", "rad/s", 1.0, "speed of the loose load"),
        ),
        rates=rates,
        start=start,
        about=About(
            "J_l d2phi/dt2 = T_c = J_l [w^2 (theta - phi) + 2 d w (omega - dphi/dt)]",
            "two-mass oscillator",
            look_alikes=("load_error", "viscous_friction"),
            separated_by="a sweep through the loose load's frequency, or an accelerometer on it",
        ),
    )
