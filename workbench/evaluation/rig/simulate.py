"""Run the rig sample by sample: command or position loop in, records out.

Parameters that change with time, or with where the rig is, are set once per sample.

Units: SI, recorded columns in volt, degrees and bar.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import plant
from workbench.evaluation.rig.electronics import CommandPath, PositionLoop, Sensors
from workbench.evaluation.rig.excitation import RATE

Array = NDArray[np.float64]
STEP = 1e-4


class Now(NamedTuple):
    """Where the rig is at a sample.

    Args:
        pressure_1: Gauge pressure of muscle 1, in Pa.
    """

    time: float
    angle: float
    speed: float
    pressure_1: float


Change = Callable[[Now], float]

_OF_COULOMB = ("coulomb_drift", "coulomb_asymmetry", "local_friction", "dwell_friction")


def varying(p: dict[str, float]) -> dict[str, Change]:
    """Return the laws of the parameters that change, by the parameter that each sets."""
    p = dict(p)
    laws: dict[str, Change] = {"external_torque": _torque(p)}
    for name, change in p.items():
        if name.startswith("onset_") and change != 0.0:
            own = name.removeprefix("onset_")
            laws[own] = _after(p["onset"], p[own], change)
    if any(p[name] for name in _OF_COULOMB):
        laws["coulomb"] = _coulomb(p, laws.get("coulomb", lambda now: p["coulomb"]))
    if p["viscous_asymmetry"]:
        laws["viscous"] = lambda now: (
            p["viscous"] * (1.0 + p["viscous_asymmetry"] * math.copysign(1.0, now.speed))
        )
    if p["supply_drift"] or p["supply_ripple"] or p["supply_relay"]:
        ripple = 2.0 * math.pi * p["supply_ripple_frequency"]
        laws["supply_pressure"] = lambda now: (
            max(0.0, p["supply_pressure"] + p["supply_drift"] * now.time)
            + p["supply_ripple"] * math.sin(ripple * now.time)
            - p["supply_relay"] * (now.time / p["supply_relay_time"] % 1.0)
        )
    if p["force_fade"]:
        laws["force_gain"] = lambda now: (
            p["force_gain"]
            * (1.0 - p["force_fade"] * (1.0 - math.exp(-now.time / p["force_fade_time"])))
        )
    if p["pressure_drift"]:
        laws["pressure_offset_1"] = lambda now: (
            p["pressure_offset_1"] + p["pressure_drift"] * now.time
        )
    if p["leak_threshold"]:
        laws["leak_1"] = lambda now: p["leak_1"] * (now.pressure_1 > p["leak_threshold"])
    return laws


def _after(time: float, before: float, change: float) -> Change:
    return lambda now: before + change * (now.time >= time)


def _coulomb(p: dict[str, float], base: Change) -> Change:
    moved = 0.0

    def dwelt(now: Now) -> float:
        """Return the part of its last strength that a contact has, by how long it rested."""
        nonlocal moved
        if abs(now.speed) > p["dwell_speed"]:
            moved = now.time
        return 1.0 - math.exp(-(now.time - moved) / p["dwell_time"])

    def law(now: Now) -> float:
        away = (now.angle - p["local_angle"]) / p["local_width"]
        level = max(0.0, base(now) + p["coulomb_drift"] * now.time)
        level *= 1.0 + p["coulomb_asymmetry"] * math.copysign(1.0, now.speed)
        level += p["dwell_friction"] * dwelt(now)
        return level + p["local_friction"] * math.exp(-away * away)

    return law


def _torque(p: dict[str, float]) -> Change:
    def law(now: Now) -> float:
        middle = now.angle - plant.SPAN / 2.0
        low, high = p["pad_reach"] - now.angle, now.angle - (plant.SPAN - p["pad_reach"])
        return (
            p["external_torque"]
            - p["cubic_spring"] * middle**3
            + p["pad_stiffness"] * (max(0.0, low) - max(0.0, high))
            + p["hum_torque"] * math.sin(2.0 * math.pi * p["hum_frequency"] * now.time)
        )

    return law


@dataclass(frozen=True)
class Record:
    """Measured columns of a recording (volt, degrees, bar gauge) and the true states."""

    time: Array
    valve: Array
    angle: Array
    pressure_1: Array
    pressure_2: Array
    states: Array

    def table(self) -> Array:
        """Return the five columns of a recording file."""
        return np.column_stack(
            [self.time, self.valve, self.angle, self.pressure_1, self.pressure_2]
        )


def run(
    parameters: dict[str, float],
    state: Array,
    *,
    command: Array | None = None,
    reference: Array | None = None,
    seed: int = 0,
) -> Record:
    """Simulate one recording, open loop along `command` or closed loop along `reference`."""
    if (command is None) == (reference is None):
        raise ValueError("give either a command or a reference")
    if command is not None:
        return driven(parameters, state, len(command), lambda j, *_: float(command[j]), seed=seed)
    assert reference is not None
    loop = PositionLoop()

    def volt(j: int, angle: float, pressures: tuple[float, float]) -> float:
        return loop(float(reference[j]), angle, (1e-5 * pressures[0], 1e-5 * pressures[1]))

    return driven(parameters, state, len(reference), volt, seed=seed)


def driven(
    parameters: dict[str, float],
    state: Array,
    count: int,
    volt: Callable[[int, float, tuple[float, float]], float],
    *,
    seed: int = 0,
) -> Record:
    """Simulate samples whose command in volt follows from number, angle in deg, pressures in Pa."""
    p = dict(parameters)
    rng = np.random.default_rng(seed)
    sensors, steps = Sensors(p, rng), round(1.0 / RATE / STEP)
    path = CommandPath(p, steps, STEP)
    table, states, x = np.empty((count, 5)), np.empty((count, len(state))), np.array(state, float)
    keep, noise = np.exp(-1.0 / RATE / p["torque_noise_time"]), 0.0
    laws = varying(p)
    for j in range(count):
        states[j] = x
        true = plant.gauge(x, p)
        now = Now(j / RATE, float(x[0]), float(x[1]), true[0])
        for name, law in laws.items():
            p[name] = law(now)
        if p["torque_noise"] > 0.0:
            fresh = np.sqrt(1.0 - keep**2) * p["torque_noise"] * rng.standard_normal()
            noise = keep * noise + fresh
            p["external_torque"] += noise
        angle = sensors.angle(float(np.degrees(x[0])))
        read = (sensors.pressure(0, true), sensors.pressure(1, true))
        told = path.quantised(volt(j, angle, read))
        table[j] = j / RATE, told, angle, read[0] * 1e-5, read[1] * 1e-5
        _, x = plant.run(p, x, path(told), step=STEP, keep=steps)
    return Record(table[:, 0], table[:, 1], table[:, 2], table[:, 3], table[:, 4], states)


class Law(Protocol):
    """What a controller offers."""

    def initial_state(self, measurement: tuple[float, ...]) -> Any:
        """Return the state at the first measurements."""

    def step(self, state: Any, measurement: tuple[float, ...], reference: tuple[float, ...]) -> Any:
        """Return the command, the next state, and what the step tells about itself."""


def follow(
    law: Law, parameters: dict[str, float], state: Array, reference: Array, *, seed: int = 0
) -> Record:
    """Run a controller on the rig, from a state on, along a reference in rad at each sample."""
    inner: list[Any] = []

    def volt(k: int, angle_deg: float, pressures: tuple[float, float]) -> float:
        seen = (float(np.radians(angle_deg)), *pressures)
        before = inner.pop() if inner else law.initial_state(seen)
        command, after, _ = law.step(before, seen, (float(reference[k]),))
        inner.append(after)
        return min(10.0, max(0.0, float(command[0])))

    return driven(parameters, state, len(reference), volt, seed=seed)
