"""No control: commands that were written down before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Scripted:
    """Commands of one actuator, in SI, over and over, and a record of what was seen."""

    commands: tuple[float, ...]
    sensors: tuple[str, ...] = ()
    controlled: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0
    sample_time: float = 0.002
    name: str = "scripted"

    def initial_state(self, measurement: tuple[float, ...]) -> int:
        return 0

    def step(self, state: int, measurement: Any, reference: Any) -> Any:
        seen = {"seen": measurement, "wanted": reference}
        return (self.commands[state % len(self.commands)],), state + 1, seen

    def linear_command(self, command: tuple[float, ...]) -> tuple[float, ...]:
        return command
