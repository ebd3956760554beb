"""First models of the foreign machines, as a newcomer would write them."""

from __future__ import annotations

import casadi as ca

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.regularisation import Expression, sqrt
from workbench.model.trace import Equations


def _drive(m: Scope) -> Equations:
    x, p = m.x, m.p
    twisting = x.motor_speed - x.load_speed

    def torque(name: str, value: Expression, **signals: Expression) -> Expression:
        return m.port(name, value, unit="N m", signals=signals, disturbance=0.05)

    voltage = m.port("motor.voltage", m.u.voltage, unit="V", scale=5.0, disturbance=0.2)
    wound = p.stiffness * x.twist + p.shaft_damping * twisting
    shaft = torque("shaft.torque", wound, twist=x.twist, speed=twisting)
    driven = p.gain * voltage - p.motor_drag * x.motor_speed - shaft
    motor = torque("motor.torque", driven, speed=x.motor_speed)
    load = torque("load.torque", shaft - p.load_drag * x.load_speed, speed=x.load_speed)
    rates = {
        "twist": twisting,
        "motor_speed": motor / p.motor_inertia,
        "load_speed": load / p.load_inertia,
    }
    return rates, {"motor_speed": x.motor_speed, "load_speed": x.load_speed}


def drive() -> Model:
    """Build the drive: a voltage in, the speeds of motor and load out."""
    return Model(
        "two-mass drive",
        _drive,
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


def _circuit(m: Scope) -> Equations:
    x, p = m.x, m.p
    source = m.port("source.voltage", m.u.source, unit="V", scale=5.0, disturbance=0.1)
    coil = m.port(
        "coil.voltage",
        source - p.resistance * x.current - x.voltage,
        unit="V",
        scale=5.0,
        signals={"current": x.current},
        disturbance=0.2,
    )
    charging = m.port(
        "capacitor.current",
        x.current,
        unit="A",
        scale=0.5,
        signals={"voltage": x.voltage},
        disturbance=0.01,
    )
    rates = {"current": coil / p.inductance, "voltage": charging / p.capacitance}
    return rates, {"current": x.current, "voltage": x.voltage}


def circuit() -> Model:
    """Build the circuit: the source's voltage in, current and capacitor voltage out."""
    return Model(
        "oscillating circuit",
        _circuit,
        states=(State("current", "A", 0.5), State("voltage", "V", 5.0)),
        inputs=(Input("source", "V", 5.0),),
        outputs=(
            Output("current", "A", 0.5, resolution=1e-3, noise_rms=3e-3),
            Output("voltage", "V", 5.0, resolution=5e-3, noise_rms=0.02),
        ),
        parameters=(
            Parameter("resistance", "Ohm", value=6.0, lower=1.0, upper=20.0, fitted=True),
            Parameter("inductance", "H", value=0.4, lower=0.1, upper=1.0, fitted=True),
            Parameter("capacitance", "F", value=1.5e-3, lower=5e-4, upper=5e-3, fitted=True),
        ),
    )


GRAVITY = 9.81
HEAT, COLD, ROOM = 4.18e6, 288.0, 293.0


def _tank(m: Scope) -> Equations:
    level, temperature, p = m.x.level, m.x.temperature, m.p
    signals = {"level": level, "temperature": temperature}

    def flow(name: str, value: Expression) -> Expression:
        return m.port(name, value, unit="m3/s", scale=1e-5, signals=signals, disturbance=2e-7)

    pump = m.port("pump.voltage", m.u.pump, unit="V", scale=5.0, disturbance=0.1)
    inflow = flow("tank.inflow", p.pump * pump)
    outflow = flow("tank.outflow", p.hole * sqrt(2 * GRAVITY * m.form.ramp(level, 1e-3)))
    power = m.port("heater.power", m.u.heater, unit="W", scale=1000.0, disturbance=20.0)
    heat = m.port(
        "water.heat",
        power + HEAT * inflow * (COLD - temperature) - p.loss * (temperature - ROOM),
        unit="W",
        scale=1000.0,
        signals=signals,
        disturbance=20.0,
    )
    rates = {
        "level": (inflow - outflow) / p.area,
        "temperature": heat / (HEAT * p.area * m.form.ramp(level, 1e-3)),
    }
    return rates, {"level": level, "temperature": temperature}


def tank() -> Model:
    """Build the tank: pump and heater in, level and temperature out."""
    return Model(
        "heated tank",
        _tank,
        states=(
            State("level", "m", 0.2, initial=0.2, start_rms=0.1),
            State("temperature", "K", 20.0, initial=COLD, start_rms=3.0),
        ),
        inputs=(Input("pump", "V", 5.0), Input("heater", "W", 1000.0)),
        outputs=(
            Output("level", "m", 0.2, resolution=2e-4, noise_rms=5e-4),
            Output("temperature", "K", 20.0, resolution=0.02, noise_rms=0.05),
        ),
        parameters=(
            Parameter("area", "m2", value=8e-3, source="measured"),
            Parameter("pump", "m3/(s V)", value=4e-6, lower=1e-6, upper=1e-5, fitted=True),
            Parameter("hole", "m2", value=6e-6, lower=2e-6, upper=2e-5, fitted=True),
            Parameter("loss", "W/K", value=6.0, lower=0.0, upper=30.0, fitted=True),
        ),
    )


def _crane(m: Scope) -> Equations:
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
    rates = {"position": x.speed, "speed": acceleration, "angle": x.turn, "turn": turning}
    return rates, {"position": x.position, "angle": x.angle}


def crane() -> Model:
    """Build the crane: the motor's voltage in, position of the cart and angle of the load out."""
    return Model(
        "crane",
        _crane,
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
