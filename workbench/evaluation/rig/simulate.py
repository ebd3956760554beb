"""Run the rig sample by sample: command or position loop in, records out.

Units: SI, recorded columns in volt, degrees and bar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import plant
from workbench.evaluation.rig.electronics import CommandPath, PositionLoop, Sensors
from workbench.evaluation.rig.excitation import RATE
from workbench.evaluation.rig.varying import Now, varying

Array = NDArray[np.float64]
STEP = 1e-4


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
