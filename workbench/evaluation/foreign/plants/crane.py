"""A cart on a rail with a load that hangs from it."""

from __future__ import annotations

import casadi as ca

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations

GRAVITY = 9.81


def _equations(m: Scope) -> Equations:
    x, p = m.x, m.p
    s, c = ca.sin(x.angle), ca.cos(x.angle)
    voltage = m.port("motor.voltage", m.u.voltage, unit="V", scale=5.0, disturbance=0.1)
    force = m.port(
        "cart.force",
        p.gain * voltage - p.drag * x.speed,
        unit="N",
        scale=10.0,
        signals={"position": x.position, "speed": x.speed},
        disturbance=0.2,
    )
    pivot = m.port(
        "pivot.torque",
        -p.pivot_drag * x.turn - p.load * GRAVITY * p.length * s,
        unit="N m",
        scale=1.0,
        signals={"angle": x.angle, "speed": x.turn},
        disturbance=0.01,
    )
    pushed = force + p.load * p.length * x.turn**2 * s - c * pivot / p.length
    acceleration = pushed / (p.cart + p.load * s**2)
    turning = pivot / (p.load * p.length**2) - acceleration * c / p.length
    rates = {
        "position": x.speed, "speed": acceleration, "angle": x.turn, "turn": turning,
    }  # fmt: skip
    measurements = {
        "position": m.port("position.reading", x.position, unit="m", scale=0.5),
        "angle": m.port("angle.reading", x.angle, unit="rad", scale=0.2),
    }
    return rates, measurements


def crane() -> Model:
    """Build the crane: the motor's voltage in, position of the cart and angle of the load out."""
    return Model(
        "crane",
        _equations,
        states=(
            State("position", "m", 0.5), State("speed", "m/s", 0.5),
            State("angle", "rad", 0.2), State("turn", "rad/s", 1.0),
        ),
        inputs=(Input("voltage", "V", 5.0),),
        outputs=(
            Output("position", "m", 0.5, resolution=1e-4, noise_rms=3e-4),
            Output("angle", "rad", 0.2, resolution=5e-4, noise_rms=1e-3),
        ),
        parameters=(
            Parameter("gain", "N/V", value=2.0, source="data sheet"),
            Parameter("cart", "kg", value=2.0, lower=0.5, upper=6.0, fitted=True),
            Parameter("load", "kg", value=0.5, lower=0.1, upper=2.0, fitted=True),
            Parameter("length", "m", value=0.6, lower=0.3, upper=1.2, fitted=True),
            Parameter("drag", "N s/m", value=5.0, lower=0.0, upper=20.0, fitted=True),
            Parameter("pivot_drag", "N m s/rad", value=3e-3, lower=0.0, upper=0.05, fitted=True),
        ),
    )  # fmt: skip
