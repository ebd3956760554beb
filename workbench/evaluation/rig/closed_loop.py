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

from workbench.evaluation.rig import simulate
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
    """A closed-loop run: time in s, angles in rad, command in volt."""

    time: Array
    reference: Array
    angle: Array
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
    """Run a controller on the rig, from a state on, along a reference in rad over time in s."""
    time = np.arange(round(seconds * RATE)) / RATE
    wanted = np.array([reference(t) for t in time.tolist()])
    infos: list[dict[str, float]] = []
    inner: list[Any] = []

    def volt(k: int, angle_deg: float, pressures: tuple[float, float]) -> float:
        seen = (float(np.radians(angle_deg)), *pressures)
        before = inner.pop() if inner else law.initial_state(seen)
        command, after, info = law.step(before, seen, (float(wanted[k]),))
        inner.append(after)
        infos.append(dict(info))
        return min(10.0, max(0.0, float(command[0])))

    run = simulate.driven(parameters, state, len(time), volt, seed=seed)
    return ClosedRun(time, wanted, run.states[:, 0], run.valve, infos)
