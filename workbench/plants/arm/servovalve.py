"""The servovalve as a component: second-order spool, four metering edges, two exhausts.

A spool voltage above the centre opens supply to chamber 1 and chamber 2 to exhaust; below the
centre, the other two edges. The opening of an edge over the distance from the centre is very flat
near the centre (soft overlap), and steep from 1 V on.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.regularisation import EXACT, Expression, Form
from workbench.model.trace import Equations
from workbench.physics.flow import orifice_flow
from workbench.physics.leakage import centre_leakage

OPENING_V: tuple[float, ...] = (
    0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0,
    1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0,
)  # fmt: skip
"""Distance from the centre, V."""

OPENING_FRACTION: tuple[float, ...] = (
    0.0, 0.002, 0.005, 0.008, 0.012, 0.017, 0.023, 0.030, 0.041, 0.056, 0.071,
    0.107, 0.17, 0.24, 0.30, 0.36, 0.49, 0.64, 0.75, 0.86, 0.97, 1.0,
)  # fmt: skip
"""Fraction of the full conductance: manufacturer's curve of the MPYE-5-1/8-HF, type average."""

VOLTAGE_WIDTH = 0.04
"""Half-width over which the regularised form rounds the corners of the curve, V."""


@dataclass(frozen=True)
class ValveCurve:
    """Hold the curve of one metering edge; straight lines run between its points.

    Args:
        voltage: Increasing distances from the centre, V, starting at 0.
        fraction: Increasing fractions of the full conductance, starting at 0.

    Source:
        Manufacturer's flow curve; straight lines between its points are part of the nominal plant.
    """

    voltage: tuple[float, ...] = OPENING_V
    fraction: tuple[float, ...] = OPENING_FRACTION


MPYE = ValveCurve()
"""Curve of the MPYE-5-1/8-HF."""

LINEAR = ValveCurve(voltage=(0.0, 5.0), fraction=(0.0, 1.0))
"""A valve whose opening is proportional to the voltage, for comparison."""


def opening(
    voltage_from_centre: Expression, *, curve: ValveCurve = MPYE, form: Form = EXACT
) -> Expression:
    """Return the opening, a fraction, of the edge that a positive voltage opens, without leakage.

    Args:
        voltage_from_centre: Spool voltage minus the centre voltage, V; any shape. Negative
            voltages keep the edge shut, voltages beyond the curve's end leave it fully open.
        form: Exact, or regularised with corners rounded within 0.04 V.

    Source:
        Manufacturer's flow curve.
    """
    return form.table(voltage_from_centre, curve.voltage, curve.fraction, VOLTAGE_WIDTH)


STATES = (
    State("spool", "V", 1.0, "spool position, as a voltage from the centre"),
    State("spool_speed", "V/s", 600.0, "speed of the spool", start_rms=1.0),
)

COMMAND = Input(
    "valve", "V", 1.0, "valve voltage; above the centre fills muscle 1 and vents muscle 2",
    5.0, 0.0, 10.0, 10.0 / 4096,
)  # fmt: skip

PARAMETERS = (
    # Name, unit, scale (0 for that of the value), meaning, value, bounds, source.
    Parameter("valve_centre", "V", 1.0, "voltage of the middle position", 5.0, 4.0, 6.0, "paper"),
    Parameter("valve_conductance", "m3/(s Pa)", 0.0, "sonic conductance of a fully open edge",
              2.9e-8, 2.4e-8, 3.4e-8, "computed from the manufacturer's 700 l/min, 6 to 5 bar",
              fitted=True),
    Parameter("critical_ratio", "1", 0.0, "critical pressure ratio of the edges", 0.23, 0.15, 0.4,
              "computed from the manufacturer's flow"),
    Parameter("spool_frequency", "rad/s", 0.0, "natural frequency of the spool",
              2 * ca.pi * 95.0, 2 * ca.pi * 80.0, 2 * ca.pi * 130.0,
              "manufacturer, 95 Hz at full stroke"),
    Parameter("spool_damping", "1", 0.0, "damping ratio of the spool", 0.7, 0.3, 1.5, "estimate"),
    Parameter("supply_pressure", "Pa", 0.0, "supply pressure, gauge", 6e5, 2e5, 1e6, "paper",
              setting=1e5),
    Parameter("ambient_pressure", "Pa", 0.0, "ambient pressure, absolute", 1.01325e5, 7e4, 1.1e5,
              "standard atmosphere"),
    Parameter("ambient_temperature", "K", 0.0, "temperature of the surroundings and of the supply",
              293.15, 250.0, 330.0, "paper"),
)  # fmt: skip


Edges = tuple[tuple[Expression, Expression], tuple[Expression, Expression]]
"""Spool that meters each chamber, and the same with the sign that fills it, in V."""


def one_valve(m: Scope) -> tuple[Edges, dict[str, Expression]]:
    """Write down the spool of a valve that fills one muscle while it vents the other.

    A positive spool opens supply to 1 and 2 to exhaust.

    Returns:
        Edges, in V, and the rates of the states by name, in SI per second.
    """
    spool, rates = spool_position(m)
    return ((spool, spool), (spool, -spool)), rates


def spool_position(m: Scope, suffix: str = "") -> tuple[Expression, dict[str, Expression]]:
    """Write down the spool of a valve, of second order on the command from the centre.

    Args:
        m: Scope with the names of `STATES`, `COMMAND` and `PARAMETERS`, which end in ``suffix``.

    Returns:
        Position that meters, as a voltage from the centre in V, and the rates of the states by
        name, in SI per second.

    Source:
        Manufacturer's bandwidth.
    """
    p = m.p
    position, speed = m.x[f"spool{suffix}"], m.x[f"spool_speed{suffix}"]
    command = m.port(
        f"valve{suffix}.command",
        m.u[f"valve{suffix}"],
        unit="V",
        scale=1.0,
        role="valve_command",
        description="voltage that reaches the valve",
        signals={"centre": p.valve_centre, "spool": position},
    )
    frequency = p.spool_frequency
    acceleration = frequency * frequency * (command - p.valve_centre - position) - (
        2 * p.spool_damping * frequency * speed
    )
    spool = m.port(
        f"valve{suffix}.spool",
        position,
        unit="V",
        scale=1.0,
        role="spool",
        description="spool position that meters, as a voltage from the centre",
        signals={"speed": speed, "command": command},
    )
    return spool, {f"spool{suffix}": speed, f"spool_speed{suffix}": acceleration}


def metered_flows(
    m: Scope,
    *,
    edges: Edges,
    pressures: tuple[Expression, Expression],
    temperatures: tuple[Expression, Expression],
    curve: ValveCurve,
) -> tuple[Expression, Expression]:
    """Write down the net mass flows towards both chambers, in kg/s.

    Each of the four edges is an ISO 6358 restriction with a share of the full conductance.

    Args:
        m: Scope with the names of `PARAMETERS`.
        edges: As `Edges` has them, in V.
        pressures: Absolute pressures that the valve sees, in Pa.
        temperatures: Temperatures of the gas there, in K.

    Source:
        ISO 6358-1; manufacturer's flow curve.
    """
    p, ambient = m.p, m.p.ambient_temperature

    def pressure_port(
        name: str, value: Expression, temperature: Expression, what: str
    ) -> Expression:
        return m.port(
            f"{name}.pressure",
            value,
            unit="Pa",
            role=f"{name.rstrip('_12')}_pressure",
            scale=1e5,
            description=f"absolute pressure {what}",
            signals={"temperature": temperature},
        )

    def edge(name: str, position: Expression, spool: Expression, way: str) -> Expression:
        return m.port(
            f"valve.{name}",
            opening(position, curve=curve, form=m.form),
            unit="1",
            role="edge",
            scale=0.1,
            description=f"opening from {way}, of full conductance",
            signals={"spool": spool},
        )

    supply = pressure_port(
        "supply", p.supply_pressure + p.ambient_pressure, ambient, "at the valve's inlet"
    )
    net, drawn = [], 0.0
    for i, (spool, fill), pressure, temperature in zip(
        (1, 2), edges, pressures, temperatures, strict=True
    ):
        filling_share = edge(f"supply_{i}", fill, spool, f"supply to {i}")
        venting_share = edge(f"exhaust_{i}", -fill, spool, f"{i} to exhaust")
        exhaust = pressure_port(
            f"exhaust_{i}", p.ambient_pressure, ambient, "behind the exhausting edge"
        )
        seen = pressure_port(f"line_{i}", pressure, temperature, "that the valve sees")
        seen_temperature = m.port(
            f"line_{i}.temperature",
            temperature,
            unit="K",
            role="line_temperature",
            scale=300.0,
            description="temperature of the gas that the valve sees",
            signals={"ambient_temperature": ambient},
        )
        conductance, ratio = p.valve_conductance, p.critical_ratio
        filling = orifice_flow(
            supply, seen, ambient, seen_temperature, filling_share * conductance, ratio, form=m.form
        )
        venting = orifice_flow(
            seen, exhaust, seen_temperature, ambient, venting_share * conductance, ratio,
            form=m.form,
        )  # fmt: skip
        m.publish(f"exhaust_{i}.flow", venting, unit="kg/s")
        drawn = drawn + filling
        net.append(filling - venting)
    m.publish("supply.flow", drawn, unit="kg/s")
    return net[0], net[1]


def _alone(m: Scope) -> Equations:
    temperature = m.p.ambient_temperature
    edges, rates = one_valve(m)
    pressures, temperatures = (m.u.pressure_1, m.u.pressure_2), (temperature, temperature)
    flows = metered_flows(
        m, edges=edges, pressures=pressures, temperatures=temperatures, curve=MPYE
    )
    return rates, {"flow_1": flows[0], "flow_2": flows[1]}


def servovalve() -> Model:
    """Build the servovalve alone, blowing against prescribed pressures.

    Returns:
        Model with the inputs ``valve`` (V), ``pressure_1`` and ``pressure_2`` (Pa, absolute) and
        the outputs ``flow_1`` and ``flow_2`` (kg/s, towards the muscles).
    """
    pressures = tuple(
        Input(f"pressure_{i}", "Pa", 1e5, "absolute", nominal=4e5, lower=0.0, upper=2e6)
        for i in (1, 2)
    )
    return Model(
        "servovalve",
        _alone,
        states=STATES,
        inputs=(COMMAND, *pressures),
        outputs=(Output("flow_1", "kg/s", 1e-3), Output("flow_2", "kg/s", 1e-3)),
        parameters=PARAMETERS,
        description="MPYE-5-1/8-HF proportional valve",
    ).with_effect(centre_leakage())
