"""A heated tank: pump and heater in, level and temperature out.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.evaluation.foreign.excitation import steps, together
from workbench.evaluation.foreign.machine import Channel, Concealed, Machine, Parameters, State

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


OUT, WATER = ("tank.outflow", "tank.inflow"), ("water.heat",)

TANK = Machine(
    "tank",
    (("pump", "V"), ("heater", "W")),
    (Channel("level", "m", 0, 5e-4, 2e-4), Channel("temperature", "K", 1, 0.05, 0.02)),
    {
        "area": (8e-3, 0.0),
        "pump": (4e-6, 0.1),
        "hole": (6e-6, 0.1),
        "loss": (6.0, 0.3),
    },
    (
        Concealed("capillary", "outflow_law", OUT, (0.4, 1.0)),
        Concealed("outlet_pipe", "outflow_law", OUT, (0.02, 0.08)),
        Concealed("draw_off", "constant_flow", OUT, (7e-7, 2e-6)),
        Concealed("rim_overflow", "overflow", OUT, (5e-5, 2e-4), {"rim": 0.33}),
        Concealed("radiation", "growing_heat_loss", WATER, (0.6, 1.5)),
        Concealed("wall", "second_store", WATER, (1500.0, 4000.0)),
        Concealed("heater_failure", "parameter_jump", ("heater.power", *WATER), (0.15, 0.35)),
        Concealed("level_top", "sensor_clipping", ("level.reading",), (0.36, 0.42)),
        Concealed("temperature_lag", "sensor_lag", ("temperature.reading",), (20.0, 60.0)),
        Concealed("pump_dead_zone", "dead_zone", ("pump.voltage", "tank.inflow"), (0.3, 0.8)),
    ),
    _rates,
    _initial,
    {
        "fit_1": together(steps(2.5, 5.5, (150, 500), first=PUMP_AT_REST),
                          steps(0.0, 2500.0, (100, 400), first=0.0)),
        "fit_2": together(steps(3.0, 5.0, (80, 250), first=PUMP_AT_REST),
                          steps(500.0, 2500.0, (200, 600), first=0.0)),
        "hold_1": together(steps(2.5, 5.5, (200, 700), first=PUMP_AT_REST),
                           steps(0.0, 2500.0, (150, 700), first=0.0)),
        "hold_2": together(steps(2.8, 5.2, (100, 300), first=PUMP_AT_REST),
                           steps(0.0, 1800.0, (100, 300), first=0.0)),
    },
    sample_time=4.0,
    steps=4,
    samples=700,
)  # fmt: skip
