"""Small plants whose motion is known."""

from __future__ import annotations

from workbench.model import Effect, EffectView, Input, Model, Output, Parameter, State
from workbench.plants.servo_axis import servo_axis


def oscillator(frequency: float = 30.0, damping: float = 0.1) -> Model:
    """A mass on a spring, driven by a force: x'' = u - 2 d w x' - w^2 x."""

    def equations(m):  # type: ignore[no-untyped-def]
        rate = m.u.force - 2 * m.p.damping * m.p.frequency * m.x.speed
        return (
            {"position": m.x.speed, "speed": rate - m.p.frequency**2 * m.x.position},
            {"position": m.x.position},
        )

    return Model(
        "oscillator",
        equations,
        states=(State("position", "m", 1e-3), State("speed", "m/s", 0.03)),
        inputs=(Input("force", "N"),),
        outputs=(Output("position", "m"),),
        parameters=(
            Parameter("frequency", "rad/s", value=frequency, lower=0.1),
            Parameter("damping", "1", value=damping, lower=0.0),
        ),
    )


def integrator() -> Model:
    """x' = u."""
    return Model(
        "integrator",
        lambda m: ({"level": m.u.inflow}, {"level": m.x.level}),
        states=(State("level", "m", lower=-1.0, upper=1.0),),
        inputs=(Input("inflow", "m/s", lower=-10.0, upper=10.0),),
        outputs=(Output("level", "m"),),
    )


def explosion() -> Model:
    """x' = x^2: infinite after 1 s from x = 1."""
    return Model(
        "explosion",
        lambda m: ({"level": m.x.level * m.x.level + m.u.inflow}, {"level": m.x.level}),
        states=(State("level", "m", initial=1.0),),
        inputs=(Input("inflow", "m/s"),),
        outputs=(Output("level", "m"),),
    )


def convection() -> Model:
    """E. N. Lorenz's equations of 1963, whose runs part from each other exponentially."""

    def equations(m):  # type: ignore[no-untyped-def]
        a, b, c = m.x.a, m.x.b, m.x.c
        return (
            {"a": 10.0 * (b - a) + m.u.push, "b": a * (28.0 - c) - b, "c": a * b - 8.0 / 3.0 * c},
            {"a": a},
        )

    return Model(
        "convection",
        equations,
        states=tuple(State(n, "1", 10.0, initial=1.0) for n in ("a", "b", "c")),
        inputs=(Input("push", "1"),),
        outputs=(Output("a", "1"),),
    )


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
