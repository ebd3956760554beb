"""First models of real machines: what one writes before anything is known of their friction."""

from __future__ import annotations

import math

from workbench.model import Input, Model, Output, Parameter, Scope, State
from workbench.model.regularisation import Expression, sqrt
from workbench.model.trace import Equations
from workbench.plants.emps import loop_force
from workbench.plants.servo_pendulum import servo_pendulum

FIBRE_ANGLE = math.radians(25.0)
"""Angle between fibre and axis of a muscle at its nominal length, in rad."""


def _axis(m: Scope, drive: Expression) -> Equations:
    force = m.port(
        "axis.force",
        drive - m.p.drag * m.x.speed,
        unit="N",
        scale=100.0,
        signals={"position": m.x.position, "speed": m.x.speed},
        disturbance=5.0,
    )
    return {"position": m.x.speed, "speed": force / m.p.mass}, {"position": m.x.position}


def _axis_in_loop(m: Scope) -> Equations:
    return _axis(m, loop_force(m))


def axis(*, in_loop: bool = False) -> Model:
    """Build a carriage with mass and viscous friction, driven by a force or by its controller."""
    return Model(
        "axis in its loop" if in_loop else "axis",
        _axis_in_loop if in_loop else lambda m: _axis(m, m.u.force),
        states=(
            State("position", "m", 0.1, start_rms=1e-3),
            State("speed", "m/s", 0.1, start_rms=0.05),
        ),
        inputs=(Input("goal", "m", 0.1), Input("pulse", "V", 5.0))
        if in_loop
        else (Input("force", "N", 100.0),),
        outputs=(Output("position", "m", 0.1, noise_rms=1e-6, display_unit="mm"),),
        parameters=(
            Parameter("mass", "kg", value=90.0, lower=40.0, upper=160.0, fitted=True),
            Parameter("drag", "N s/m", value=250.0, lower=0.0, upper=1000.0, fitted=True),
        ),
    )


def axis_in_loop() -> Model:
    """Build the same carriage in the loop of its controller."""
    return axis(in_loop=True)


def _tanks(m: Scope) -> Equations:
    upper, lower, p = m.x.upper_level, m.x.lower_level, m.p
    levels = {"upper_level": upper, "lower_level": lower}

    def flow(name: str, value: Expression) -> Expression:
        return m.port(name, value, unit="V/s", scale=0.1, signals=levels, disturbance=0.01)

    pumped = flow("upper.inflow", p.pump_gain * m.u.pump)
    drained = flow("upper.outflow", p.upper_drain * sqrt(m.form.ramp(upper, 0.01)))
    gained = flow("lower.inflow", drained)
    left = flow("lower.outflow", p.lower_drain * sqrt(m.form.ramp(lower, 0.01)))
    return {"upper_level": pumped - drained, "lower_level": gained - left}, {"level": lower}


def tanks() -> Model:
    """Build two tanks under each other with Torricelli's outflow; the lower level is read."""
    return Model(
        "two tanks",
        _tanks,
        states=(
            State("upper_level", "V", 5.0, initial=5.0, start_rms=5.0),
            State("lower_level", "V", 5.0, initial=5.0, start_rms=3.0),
        ),
        inputs=(Input("pump", "V", 3.0),),
        outputs=(Output("level", "V", 5.0, noise_rms=0.03, upper=10.0),),
        parameters=(
            Parameter("pump_gain", "1/s", value=0.04, lower=0.005, upper=0.2, fitted=True),
            Parameter("upper_drain", "V/s", value=0.05, lower=0.005, upper=0.2, fitted=True),
            Parameter("lower_drain", "V/s", value=0.05, lower=0.005, upper=0.2, fitted=True),
        ),
    )


def _piston(m: Scope) -> Equations:
    pushed = m.port(
        "piston.force",
        m.u.pressure * m.p.area,
        unit="N",
        scale=100.0,
        signals={"position": m.x.position, "speed": m.u.speed, "pressure": m.u.pressure},
        disturbance=2.0,
    )
    return {"position": m.u.speed, "cell": (pushed - m.x.cell) / 0.02}, {"force": m.x.cell}


def piston() -> Model:
    """Build a cylinder that is stroked from outside: F = p A, read with the lag of a load cell."""
    return Model(
        "cylinder",
        _piston,
        states=(State("position", "m", 0.04), State("cell", "N", 100.0, start_rms=400.0)),
        inputs=(Input("speed", "m/s", 0.01), Input("pressure", "Pa", 5e5)),
        outputs=(Output("force", "N", 100.0, noise_rms=0.03),),
        parameters=(
            Parameter("area", "m2", value=4.9e-4, lower=4.4e-4, upper=5.6e-4, fitted=True),
        ),
    )


def pendulum() -> Model:
    """Build the servo with its pendulum and viscous friction only."""
    return servo_pendulum().without("coulomb_friction", "stribeck_friction", "gear_friction")


def _muscle(m: Scope) -> Equations:
    # Tondu and Lopez 2000, ends not flattened.
    p, strain = m.p, m.u.contraction / m.p.length
    area = math.pi * p.radius**2
    a, b = 3.0 / math.tan(FIBRE_ANGLE) ** 2, 1.0 / math.sin(FIBRE_ANGLE) ** 2
    tension = m.port(
        "muscle.tension",
        area * m.u.pressure * (a * (1.0 - strain) ** 2 - b),
        unit="N",
        scale=500.0,
        role="muscle_tension",
        signals={"contraction": m.u.contraction, "gauge_pressure": m.u.pressure},
        disturbance=20.0,
    )
    pulled = m.form.ramp(tension, 1.0)
    return {"cell": (pulled - m.x.cell) / 0.01}, {"force": m.x.cell}


def muscle(length: float = 0.3, radius: float = 0.01) -> Model:
    """Build a muscle that pulls as an ideal braid does, read with the lag of a load cell.

    Args:
        length: Nominal length, in m.
        radius: Nominal radius, in m.
    """
    return Model(
        "braided muscle",
        _muscle,
        states=(State("cell", "N", 500.0),),
        inputs=(Input("pressure", "Pa", 5e5), Input("contraction", "m", 0.03)),
        outputs=(Output("force", "N", 500.0, noise_rms=2.0),),
        parameters=(
            Parameter("length", "m", value=length, source="data sheet"),
            Parameter(
                "radius", "m", value=radius, lower=0.7 * radius, upper=1.4 * radius, fitted=True
            ),
        ),
    )
