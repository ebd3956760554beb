"""Source, resistor, coil and capacitor in series."""

from __future__ import annotations

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.trace import Equations


def _equations(m: Scope) -> Equations:
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
    current = m.port("current.reading", x.current, unit="A", scale=0.5)
    voltage = m.port("voltage.reading", x.voltage, unit="V", scale=5.0)
    return (
        {"current": coil / p.inductance, "voltage": charging / p.capacitance},
        {"current": current, "voltage": voltage},
    )


def circuit() -> Model:
    """Build the circuit: the source's voltage in, current and capacitor voltage out."""
    return Model(
        "oscillating circuit",
        _equations,
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
