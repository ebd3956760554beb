"""A servo axis with friction: a mass driven by a force, in some 30 lines of the model language."""

from __future__ import annotations

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.regularisation import Expression
from workbench.model.trace import Equations
from workbench.physics.friction import coulomb_friction, viscous_friction
from workbench.plants.plant import Plant


def carriage(m: Scope, drive: Expression, *, disturbance: float = 2.0) -> Equations:
    """Return the equations of a mass on a drive, in N, with the ports of both."""
    force = m.port(
        "axis.force",
        drive,
        unit="N",
        scale=100.0,
        description="force on the carriage, positive with the position",
        signals={"position": m.x.position, "speed": m.x.speed},
        disturbance=disturbance,
    )
    measurement = m.port("position.reading", m.x.position, unit="m", signals={"speed": m.x.speed})
    return {"position": m.x.speed, "speed": force / m.p.mass}, {"position": measurement}


def _equations(m: Scope) -> Equations:
    return carriage(m, m.u.force + m.p.offset)


def servo_axis() -> Model:
    """Build a linear servo axis: mass, viscous and Coulomb friction, force offset.

    The model has the input ``force`` (N), the output ``position`` (m) and the port ``axis.force``.
    """
    return Model(
        "servo axis",
        _equations,
        states=(State("position", "m", 0.1), State("speed", "m/s", 0.1)),
        inputs=(Input("force", "N", 100.0, lower=-350.0, upper=350.0),),
        outputs=(Output("position", "m", 0.1, resolution=1e-6, display_unit="mm"),),
        parameters=(
            Parameter("mass", "kg", value=95.0, lower=50.0, upper=150.0, fitted=True),
            Parameter("offset", "N", 1.0, value=0.0, lower=-20.0, upper=20.0, fitted=True),
        ),
        description="carriage on a ball screw, driven by a force",
    ).with_effect(
        viscous_friction("axis.force", coefficient=200.0, upper=1e4),
        coulomb_friction("axis.force", level=20.0, transition_speed=1e-3, upper=100.0),
    )


SERVO_AXIS = Plant("servo-axis", servo_axis, "carriage on a ball screw, driven by a force")
