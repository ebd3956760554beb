"""A controller of the workbench on the rig: the rig's sensors, command path and integrator.

The controller is met through its protocol only: measurements in SI, a command in volt.

Units: SI.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import fast, simulate
from workbench.evaluation.rig.electronics import CommandPath, Sensors
from workbench.evaluation.rig.excitation import RATE

Array = NDArray[np.float64]


class Law(Protocol):
    """What a controller offers."""

    def initial_state(self, measurement: tuple[float, ...]) -> Any:
        """Return the state at the first measurements."""

    def step(self, state: Any, measurement: tuple[float, ...], reference: tuple[float, ...]) -> Any:
        """Return the command, the next state, and what the step tells about itself."""


@dataclass(frozen=True)
class ClosedRun:
    """A closed-loop run: time in s, angles in rad, gauge pressures in Pa, command in volt."""

    time: Array
    reference: Array
    angle: Array
    pressures: Array
    valve: Array
    infos: Sequence[dict[str, float]]


def follow(
    law: Law,
    parameters: dict[str, float],
    state: Array,
    reference: Callable[[float], float],
    seconds: float,
    *,
    seed: int = 0,
) -> ClosedRun:
    """Run a controller on the rig along a reference.

    Args:
        parameters: Parameters of the rig.
        state: State of the rig at the start.
        reference: Wanted angle in rad over time in s.
        seconds: Duration.
    """
    rng = np.random.default_rng(seed)
    sensors = Sensors(parameters, rng)
    steps = round(1.0 / RATE / simulate.STEP)
    path = CommandPath(parameters, steps, simulate.STEP)
    n = round(seconds * RATE)
    time = np.arange(n) / RATE
    wanted = np.array([reference(t) for t in time.tolist()])
    angle, pressures, valve = np.empty(n), np.empty((n, 2)), np.empty(n)
    infos: list[dict[str, float]] = []
    x, inner = np.array(state, float), None
    for k in range(n):
        angle[k] = x[0]
        pressures[k] = simulate.gauge(x, parameters)
        read = float(np.radians(sensors.angle(float(np.degrees(x[0])))))
        seen = (read, *(sensors.pressure(i, float(pressures[k, i])) for i in (0, 1)))
        if inner is None:
            inner = law.initial_state(seen)
        command, inner, info = law.step(inner, seen, (float(wanted[k]),))
        infos.append(dict(info))
        valve[k] = path.quantised(min(10.0, max(0.0, float(command[0]))))
        _, x = fast.run(parameters, x, path(float(valve[k])), step=simulate.STEP, keep=steps)
    return ClosedRun(time, wanted, angle, pressures, valve, infos)
