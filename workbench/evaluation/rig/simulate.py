"""Run the rig sample by sample: command or position loop in, records out.

Units: SI, recorded columns in volt, degrees and bar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import arm, fast, muscle, plant
from workbench.evaluation.rig.electronics import CommandPath, PositionLoop, Sensors
from workbench.evaluation.rig.excitation import RATE

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


def gauge(state: Array, p: dict[str, float]) -> tuple[float, float]:
    """Return the true gauge pressures in Pa."""
    out = []
    for k, a in enumerate((float(state[0]), arm.SPAN - float(state[0]))):
        s = arm.distance(a) - arm.FITTINGS
        if p["tendon_stiffness"] > 0:
            s = float(state[plant.INDEX["fibre_1"] + k])
        v = p["volume_gain"] * muscle.volume(s) + p["dead_volume"]
        out.append((p["gamma"] - 1) * float(state[3 + 2 * k]) / v - p["ambient_pressure"])
    return out[0], out[1]


def run(
    parameters: dict[str, float],
    state: Array,
    *,
    command: Array | None = None,
    reference: Array | None = None,
    seed: int = 0,
    drift: dict[str, Callable[[float], float]] | None = None,
    step: float = STEP,
) -> Record:
    """Simulate one recording, open loop along `command` or closed loop along `reference`.

    `drift` maps a parameter to its value in SI units as a function of time.
    """
    if (command is None) == (reference is None):
        raise ValueError("give either a command or a reference")
    p = dict(parameters)
    rng = np.random.default_rng(seed)
    sensors, loop = Sensors(p, rng), PositionLoop()
    steps = round(1.0 / RATE / step)
    path = CommandPath(p, steps, step)
    source = command if command is not None else reference
    assert source is not None
    n = len(source)
    table, states, x = np.empty((n, 5)), np.empty((n, len(state))), np.array(state, float)
    keep = np.exp(-1.0 / RATE / p["torque_noise_time"])
    laws = _drifts(p) | (drift or {})
    for j in range(n):
        for name, law in laws.items():
            p[name] = law(j / RATE)
        if p["torque_noise"] > 0.0:
            fresh = np.sqrt(1.0 - keep**2) * p["torque_noise"] * rng.standard_normal()
            p["external_torque"] = keep * p["external_torque"] + fresh
        states[j] = x
        true = gauge(x, p)
        angle = sensors.angle(float(np.degrees(x[0])))
        bars = [sensors.pressure(k, true[k]) * 1e-5 for k in (0, 1)]
        volt = float(source[j])
        if reference is not None:
            volt = loop(volt, angle, (bars[0], bars[1]))
        volt = path.quantised(volt)
        table[j] = j / RATE, volt, angle, *bars
        _, x = fast.run(p, x, path(volt), step=step, keep=steps)
    return Record(table[:, 0], table[:, 1], table[:, 2], table[:, 3], table[:, 4], states)


def _drifts(p: dict[str, float]) -> dict[str, Callable[[float], float]]:
    """Return the laws of the parameters that the rig itself lets drift."""

    def law(first: float, rate: float) -> Callable[[float], float]:
        return lambda time: max(0.0, first + rate * time)

    rates = {"coulomb": p["coulomb_drift"], "supply_pressure": p["supply_drift"]}
    return {name: law(p[name], rate) for name, rate in rates.items() if rate != 0.0}
