"""A two-mass drive: motor, elastic shaft, load; a voltage in, two tachometers out.

Units: SI.
"""

from __future__ import annotations

from collections.abc import Sequence

from workbench.evaluation.foreign.excitation import chirp, pulses, sines, steps
from workbench.evaluation.foreign.machine import (
    Channel,
    Concealed,
    Machine,
    Parameters,
    State,
    dead_zone,
    dry_friction,
)


def _rates(_: float, x: State, u: Sequence[float], p: Parameters) -> State:
    twist, motor, load = x
    left = dead_zone(twist, p["backlash"])
    # Out of contact the shaft does not damp either.
    damped = p["shaft_damping"] * (motor - load) if left != 0.0 or p["backlash"] == 0.0 else 0.0
    shaft = p["stiffness"] * left + p["shaft_cubic"] * left**3 + damped
    at_motor = p["gain"] * u[0] - p["motor_drag"] * motor - shaft
    at_load = shaft - p["load_drag"] * load - p["fan"] * load * abs(load) - p["constant_load"]
    dry_motor = dry_friction(
        motor, at_motor, p["motor_coulomb"], inertia=p["motor_inertia"], stuck=0.02
    )
    dry_load = dry_friction(
        load,
        at_load,
        0.4 * p["load_stribeck"],
        break_away=p["load_stribeck"],
        fade=3.0,
        inertia=p["load_inertia"],
        stuck=0.02,
    )
    return [
        motor - load,
        (at_motor - dry_motor) / p["motor_inertia"],
        (at_load - dry_load) / p["load_inertia"],
    ]


MOTOR, SHAFT, LOAD = ("motor.torque",), ("shaft.torque",), ("load.torque",)
PLACES = (*LOAD, *MOTOR, "motor.voltage")
"""Where a constant torque may be found: with inertias unknown, on either side."""

DRIVE = Machine(
    "drive",
    (("voltage", "V"),),
    (
        Channel("motor_speed", "rad/s", 1, 0.05, 0.01),
        Channel("load_speed", "rad/s", 2, 0.05, 0.01),
    ),
    {
        "gain": (0.2, 0.0),
        "motor_inertia": (0.01, 0.1),
        "load_inertia": (0.03, 0.15),
        "stiffness": (8.0, 0.15),
        "shaft_damping": (0.03, 0.3),
        "motor_drag": (0.02, 0.3),
        "load_drag": (0.02, 0.3),
    },
    (
        Concealed("motor_coulomb", "dry_friction", MOTOR, (0.08, 0.25)),
        Concealed("load_stribeck", "stribeck", LOAD, (0.08, 0.25)),
        Concealed("fan", "quadratic_drag", LOAD, (3e-4, 1.2e-3)),
        Concealed("backlash", "backlash", SHAFT, (0.015, 0.05)),
        Concealed("shaft_cubic", "hardening", SHAFT, (150.0, 500.0)),
        Concealed("constant_load", "constant_effort", PLACES, (0.08, 0.25), signed=True),
        Concealed("voltage_delay", "drive_delay", ("motor.voltage", *MOTOR), (0.02, 0.05)),
        Concealed("voltage_dead_zone", "dead_zone", ("motor.voltage", *MOTOR), (0.3, 1.0)),
        Concealed("load_speed_lag", "sensor_lag", ("load_speed.reading",), (0.02, 0.06)),
        Concealed(
            "motor_speed_gain", "sensor_gain",
            ("motor_speed.reading", "load_speed.reading"), (0.03, 0.08), signed=True,
        ),
    ),
    _rates,
    lambda p: [0.0, 0.0, 0.0],
    {
        "fit_1": pulses(7.0, (0.2, 1.0)),
        "fit_2": chirp(6.0, 4.0, 0.25),
        "hold_1": steps(-6.0, 6.0, (0.4, 1.6), first=0.0),
        "hold_2": sines(7.0, (3.0, 0.9, 0.35)),
    },
    sample_time=0.01,
    steps=10,
    samples=1000,
)  # fmt: skip
