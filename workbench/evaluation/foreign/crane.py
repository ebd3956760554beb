"""A cart with a load that hangs from it: a motor voltage in, position and angle out.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.evaluation.foreign.excitation import chirp, pulses, sines, steps
from workbench.evaluation.foreign.machine import (
    Array,
    Channel,
    Concealed,
    Machine,
    Parameters,
    State,
    dry_friction,
)

GRAVITY = 9.81
JUMP = 8.0
"""When the grease runs out, in s."""


def _rates(t: float, x: State, u: Sequence[float], p: Parameters) -> State:
    place, speed, angle, turn = x
    m, length = p["load"], p["length"]
    viscous = p["drag"] * (1.0 + (p["grease"] if t > JUMP else 0.0))
    force = p["gain"] * u[0] - viscous * speed - p["slope"] - p["chain"] * place
    pivot = -p["pivot_drag"] * turn - p["air_drag"] * turn * abs(turn)
    pivot -= dry_friction(turn, 0.0, p["pivot_friction"], inertia=m * length**2, stuck=2e-3)
    # The load pulls at the cart; both accelerations from two linear equations.
    c, s = math.cos(angle), math.sin(angle)
    pulled = pivot / length - m * GRAVITY * s
    mass = p["cart"] + m * (1.0 - c * c)
    pushed = force + m * length * turn**2 * s - c * pulled
    dry = dry_friction(
        speed,
        pushed,
        p["rail_friction"] + 0.4 * p["rail_stribeck"],
        break_away=p["rail_stribeck"],
        fade=0.05,
        inertia=mass,
        stuck=1e-3,
    )
    acceleration = (pushed - dry) / mass
    return [speed, acceleration, turn, (pulled / m - acceleration * c) / length]


def _position_loop(reference: Array, now: Array, last: Array) -> Array:
    speed = (now[0] - last[0]) / 0.02
    volt = 14.0 * (reference[0] - now[0]) - 4.0 * speed
    return np.array([min(7.0, max(-7.0, volt))])


DRIVE, RAIL, PIVOT = ("motor.voltage", "cart.force"), ("cart.force",), ("pivot.torque",)

CRANE = Machine(
    "crane",
    (("voltage", "V"),),
    (Channel("position", "m", 0, 3e-4, 1e-4), Channel("angle", "rad", 2, 1e-3, 5e-4)),
    {
        "gain": (2.0, 0.0),
        "cart": (2.0, 0.1),
        "load": (0.5, 0.05),
        "length": (0.6, 0.05),
        "drag": (5.0, 0.3),
        "pivot_drag": (3e-3, 0.3),
    },
    (
        Concealed("rail_friction", "dry_friction", RAIL, (0.7, 2.0)),
        Concealed("rail_stribeck", "stribeck", RAIL, (0.7, 2.0)),
        Concealed("pivot_friction", "dry_friction", PIVOT, (4e-3, 1.2e-2)),
        Concealed("air_drag", "quadratic_drag", PIVOT, (0.01, 0.04)),
        Concealed("slope", "constant_effort", RAIL, (0.4, 1.5), signed=True),
        Concealed("chain", "spring", RAIL, (2.0, 8.0)),
        Concealed("voltage_delay", "drive_delay", DRIVE, (0.04, 0.12)),
        Concealed("voltage_limit", "drive_limit", DRIVE, (2.5, 4.0)),
        Concealed("angle_offset", "sensor_offset", ("angle.reading",), (0.01, 0.03), signed=True),
        Concealed("grease", "parameter_jump", RAIL, (0.8, 2.0)),
    ),
    _rates,
    lambda p: [0.0, 0.0, 0.0, 0.0],
    {
        "fit_1": steps(-0.5, 0.5, (1.5, 4.0), first=0.0),
        "fit_2": chirp(0.3, 8.0, 1.0),
        "hold_1": sines(0.6, (8.0, 3.0, 1.4)),
        "hold_2": pulses(0.4, (0.5, 2.0)),
    },
    sample_time=0.02,
    steps=10,
    samples=800,
    loop=_position_loop,
)
