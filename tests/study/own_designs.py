"""Designs of a user's own: one that fails in the middle of a run, one that cannot be designed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from workbench.errors import WorkbenchError


@dataclass(frozen=True)
class Fails:
    """Works for some samples, then raises."""

    sample_time: float = 0.002
    name: str = "fails"
    sensors: tuple[str, ...] = ("angle",)
    controlled: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0

    def initial_state(self, measurement: tuple[float, ...]) -> int:
        return 0

    def step(self, state: int, measurement: Any, reference: Any) -> tuple[Any, int, Any]:
        if state > 200:
            raise ZeroDivisionError("gain is zero")
        return (5.0,), state + 1, {}

    def linear_command(self, command: tuple[float, ...]) -> tuple[float, ...]:
        return command


def fails(linear: Any, specification: Any) -> Fails:
    """Return a controller that fails after 200 samples."""
    return Fails()


def impossible(linear: Any, specification: Any) -> Fails:
    """Refuse every specification."""
    raise WorkbenchError("no gain meets the specification")
