"""The way of the command to the spool: quantisation, play and delay.

Units: volt, s.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig.sensors import quantise


@dataclass
class CommandPath:
    """Turns one command per sample into one spool command per integration step."""

    parameters: dict[str, float]
    steps: int
    step: float
    start: float = 5.0
    _queue: deque[float] = field(init=False)
    _play: float = field(init=False)

    def __post_init__(self) -> None:
        self._queue = deque([self.start] * round(self.parameters["valve_delay"] / self.step))
        self._play = self.start

    def quantised(self, volt: float) -> float:
        """Return the command on the grid of the output card, counted from 5 V."""
        return 5.0 + quantise(volt - 5.0, self.parameters["command_step"])

    def __call__(self, volt: float) -> NDArray[np.float64]:
        """Return what the spool is told during the next sample, one value per step."""
        half = self.parameters["valve_play"]
        self._play = min(volt + half, max(volt - half, self._play))
        self._queue.extend([self._play] * self.steps)
        return np.array([self._queue.popleft() for _ in range(self.steps)])
