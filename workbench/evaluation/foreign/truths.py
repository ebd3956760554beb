"""The truths of the foreign machines: a two-mass drive, a circuit, a heated tank and a crane.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.evaluation.foreign.machine import (
    Array,
    Parameters,
    State,
    dead_zone,
    dry_friction,
    machine,
)

GRAVITY = 9.81


def _drive(_: float, x: State, u: Sequence[float], p: Parameters) -> State:
    """Motor, elastic shaft, load: a voltage in, two tachometers out."""
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


DRIVE = machine("drive", _drive, lambda p: [0.0, 0.0, 0.0])

KNEE = 5e-3
"""Current at which the contact drop begins to saturate, in A."""


def _circuit(_: float, x: State, u: Sequence[float], p: Parameters) -> State:
    """Source, resistor, coil with a core, capacitor; shunt and probe are read."""
    current, voltage = x
    # Two diodes back to back: the drop grows as the inverse hyperbolic sine of the current.
    drop = p["contact_drop"] * math.asinh(current / KNEE) / math.asinh(0.5 / KNEE)
    # Froelich: the inductance falls to a fifth as the core saturates.
    core = 0.2 + 0.8 / (1.0 + (p["core_saturation"] * current) ** 2)
    across = u[0] - p["resistance"] * current - p["hot_wire"] * current**3 - drop - voltage
    kept = 1.0 / (1.0 + p["ceramic"] * voltage**2)
    into = current - p["capacitor_leak"] * voltage
    return [across / (p["inductance"] * core), into / (p["capacitance"] * kept)]


CIRCUIT = machine("circuit", _circuit, lambda p: [0.0, 0.0])

HEAT, BOLTZMANN = 4.18e6, 5.67e-8
"""Heat capacity of water per volume, radiation constant."""

COLD, ROOM = 288.0, 293.0
"""Temperatures of the water that is pumped and of the room."""

PUMP_AT_REST = 3.0
"""Voltage of the pump before a recording, in V."""

ELEMENT_FAILS = 1300.0
"""When one of the heating elements fails, in s."""


def _tank(t: float, x: State, u: Sequence[float], p: Parameters) -> State:
    """Pump and heater in, level and temperature out."""
    level, temperature, wall = max(0.01, x[0]), x[1], x[2]
    pump, heater = u
    inflow = p["pump"] * max(0.0, pump)
    head = math.sqrt(level + p["outlet_pipe"])
    capillary = p["capillary"]
    outflow = (
        p["hole"]
        * math.sqrt(2.0 * GRAVITY)
        * ((1.0 - capillary) * head + capillary * level / math.sqrt(0.3))
    )
    spilled = p["rim_overflow"] * max(0.0, level - p.get("rim", math.inf))
    lost = p["draw_off"] + outflow + spilled
    heat = heater * (1.0 - (p["heater_failure"] if t > ELEMENT_FAILS else 0.0))
    heat -= p["loss"] * (temperature - ROOM)
    heat -= p["radiation"] * BOLTZMANN * (temperature**4 - ROOM**4)
    to_wall = 60.0 * (temperature - wall) if p["wall"] > 0.0 else 0.0
    volume = p["area"] * level
    return [
        (inflow - lost) / p["area"],
        (inflow * (COLD - temperature) + (heat - to_wall) / HEAT) / volume,
        to_wall / p["wall"] if p["wall"] > 0.0 else 0.0,
    ]


def _tank_at_rest(p: Parameters) -> State:
    flow = p["pump"] * PUMP_AT_REST
    through = HEAT * flow
    temperature = (through * COLD + p["loss"] * ROOM) / (through + p["loss"])
    return [(flow / p["hole"]) ** 2 / (2.0 * GRAVITY), temperature, temperature]


TANK = machine("tank", _tank, _tank_at_rest)

GREASE_OUT = 8.0
"""When the grease runs out, in s."""


def _crane(t: float, x: State, u: Sequence[float], p: Parameters) -> State:
    """Cart with a load that hangs from it: a motor voltage in, position and angle out."""
    place, speed, angle, turn = x
    m, length = p["load"], p["length"]
    viscous = p["drag"] * (1.0 + (p["grease"] if t > GREASE_OUT else 0.0))
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


CRANE = machine("crane", _crane, lambda p: [0.0, 0.0, 0.0, 0.0], _position_loop)
