"""Motor, elastic shaft and load."""

from __future__ import annotations

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations


def _equations(m: Scope) -> Equations:
    x, p = m.x, m.p
    voltage = m.port("motor.voltage", m.u.voltage, unit="V", scale=5.0, disturbance=0.2)
    shaft = m.port(
        "shaft.torque",
        p.stiffness * x.twist + p.shaft_damping * (x.motor_speed - x.load_speed),
        unit="N m",
        signals={"twist": x.twist, "speed": x.motor_speed - x.load_speed},
        disturbance=0.05,
    )
    motor = m.port(
        "motor.torque",
        p.gain * voltage - p.motor_drag * x.motor_speed - shaft,
        unit="N m",
        signals={"speed": x.motor_speed},
        disturbance=0.05,
    )
    load = m.port(
        "load.torque",
        shaft - p.load_drag * x.load_speed,
        unit="N m",
        signals={"speed": x.load_speed},
        disturbance=0.05,
    )
    rates = {
        "twist": x.motor_speed - x.load_speed,
        "motor_speed": motor / p.motor_inertia,
        "load_speed": load / p.load_inertia,
    }
    measurements = {
        name: m.port(f"{name}.reading", x[name], unit="rad/s", scale=20.0)
        for name in ("motor_speed", "load_speed")
    }
    return rates, measurements


def drive() -> Model:
    """Build the drive: a voltage in, the speeds of motor and load out."""
    return Model(
        "two-mass drive",
        _equations,
        states=(
            State("twist", "rad", 0.1),
            State("motor_speed", "rad/s", 20.0),
            State("load_speed", "rad/s", 20.0),
        ),
        inputs=(Input("voltage", "V", 5.0),),
        outputs=(
            Output("motor_speed", "rad/s", 20.0, resolution=0.01, noise_rms=0.05),
            Output("load_speed", "rad/s", 20.0, resolution=0.01, noise_rms=0.05),
        ),
        parameters=(
            Parameter("gain", "N m/V", value=0.2, source="data sheet"),
            Parameter("motor_inertia", "kg m2", value=0.01, lower=3e-3, upper=0.03, fitted=True),
            Parameter("load_inertia", "kg m2", value=0.03, lower=0.01, upper=0.1, fitted=True),
            Parameter("stiffness", "N m/rad", value=8.0, lower=2.0, upper=30.0, fitted=True),
            Parameter("shaft_damping", "N m s/rad", value=0.03, lower=0.0, upper=0.2, fitted=True),
            Parameter("motor_drag", "N m s/rad", value=0.02, lower=0.0, upper=0.1, fitted=True),
            Parameter("load_drag", "N m s/rad", value=0.02, lower=0.0, upper=0.1, fitted=True),
        ),
    )
