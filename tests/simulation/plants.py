"""Small plants whose motion is known."""

from __future__ import annotations

from tests.machines import machine
from workbench.model import Effect, EffectView, Model, Parameter, State
from workbench.plants.servo_axis import servo_axis


def oscillator(frequency: float = 30.0, damping: float = 0.1) -> Model:
    """A mass on a spring, driven by a force: x'' = u - 2 d w x' - w^2 x."""

    def equations(m):  # type: ignore[no-untyped-def]
        rate = m.u.force - 2 * m.p.damping * m.p.frequency * m.x.speed
        return {"position": m.x.speed, "speed": rate - m.p.frequency**2 * m.x.position}

    return machine(
        equations,
        "position m scale=1e-3, speed m/s scale=0.03",
        "force N",
        "position m",
        f"frequency rad/s {frequency} 0.1, damping 1 {damping} 0",
    )


def integrator() -> Model:
    """x' = u."""
    return machine(
        lambda m: {"level": m.u.inflow}, "level m lower=-1 upper=1", "inflow m/s -10 10", "level m"
    )


def explosion() -> Model:
    """x' = x^2: infinite after 1 s from x = 1."""
    return machine(
        lambda m: {"level": m.x.level * m.x.level + m.u.inflow},
        "level m 1",
        "inflow m/s",
        "level m",
    )


def convection() -> Model:
    """E. N. Lorenz's equations of 1963, whose runs part from each other exponentially."""

    def equations(m):  # type: ignore[no-untyped-def]
        a, b, c = m.x.a, m.x.b, m.x.c
        return (
            {"a": 10.0 * (b - a) + m.u.push, "b": a * (28.0 - c) - b, "c": a * b - 8.0 / 3.0 * c},
            {"a": a},
        )

    states = ", ".join(f"{n} 1 1 scale=10" for n in ("a", "b", "c"))
    return machine(equations, states, "push 1", "a 1")


def bristles(stiffness: float, level: float = 20.0) -> Effect:
    """LuGre friction without the viscous parts: stiff, because the bristles are."""

    def rates(effect: EffectView):  # type: ignore[no-untyped-def]
        at = effect.at["axis.force"]
        v = at.signals.speed
        z = effect.x.deflection
        return {"deflection": v - effect.p.stiffness * at.form.absolute(v, 1e-6) * z / level}

    return Effect(
        "bristles",
        ("axis.force",),
        lambda at: at.value - at.p.stiffness * at.x.deflection,
        parameters=(Parameter("stiffness", "N/m", value=stiffness, lower=1.0),),
        states=(State("deflection", "m", 1e-5),),
        rates=rates,
    )


def bristled_axis(stiffness: float) -> Model:
    """The servo axis with LuGre in place of Coulomb friction."""
    return servo_axis().without("coulomb_friction").with_effect(bristles(stiffness))
