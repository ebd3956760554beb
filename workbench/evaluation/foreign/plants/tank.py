"""A tank that a pump fills, a hole empties and a heater warms."""

from __future__ import annotations

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.regularisation import sqrt
from workbench.model.trace import Equations

HEAT, COLD, ROOM = 4.18e6, 288.0, 293.0


def _equations(m: Scope) -> Equations:
    level, temperature, p = m.x.level, m.x.temperature, m.p
    signals = {"level": level, "temperature": temperature}
    pump = m.port("pump.voltage", m.u.pump, unit="V", scale=5.0, disturbance=0.1)
    inflow = m.port(
        "tank.inflow", p.pump * pump, unit="m3/s", scale=1e-5, signals=signals, disturbance=2e-7
    )
    outflow = m.port(
        "tank.outflow",
        p.hole * sqrt(2 * 9.81 * m.form.ramp(level, 1e-3)),
        unit="m3/s",
        scale=1e-5,
        signals=signals,
        disturbance=2e-7,
    )
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
    measurements = {
        "level": m.port("level.reading", level, unit="m", scale=0.2),
        "temperature": m.port("temperature.reading", temperature, unit="K", scale=20.0),
    }
    return rates, measurements


def tank() -> Model:
    """Build the tank: pump and heater in, level and temperature out."""
    return Model(
        "heated tank",
        _equations,
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
