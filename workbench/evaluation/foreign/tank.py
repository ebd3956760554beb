"""A heated tank: pump and heater in, level and temperature out.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.evaluation.foreign.excitation import machine
from workbench.evaluation.foreign.machine import Parameters, State

HEAT, GRAVITY, BOLTZMANN = 4.18e6, 9.81, 5.67e-8
"""Heat capacity of water per volume, gravity, radiation constant."""

COLD, ROOM = 288.0, 293.0
"""Temperatures of the water that is pumped and of the room."""

PUMP_AT_REST = 3.0
"""Voltage of the pump before a recording, in V."""

JUMP = 1300.0
"""When one of the heating elements fails, in s."""


def _rates(t: float, x: State, u: Sequence[float], p: Parameters) -> State:
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
    heat = heater * (1.0 - (p["heater_failure"] if t > JUMP else 0.0))
    heat -= p["loss"] * (temperature - ROOM)
    heat -= p["radiation"] * BOLTZMANN * (temperature**4 - ROOM**4)
    to_wall = 60.0 * (temperature - wall) if p["wall"] > 0.0 else 0.0
    volume = p["area"] * level
    return [
        (inflow - lost) / p["area"],
        (inflow * (COLD - temperature) + (heat - to_wall) / HEAT) / volume,
        to_wall / p["wall"] if p["wall"] > 0.0 else 0.0,
    ]


def _initial(p: Parameters) -> State:
    flow = p["pump"] * PUMP_AT_REST
    through = HEAT * flow
    temperature = (through * COLD + p["loss"] * ROOM) / (through + p["loss"])
    return [(flow / p["hole"]) ** 2 / (2.0 * GRAVITY), temperature, temperature]


TANK = machine("tank", _rates, _initial)
