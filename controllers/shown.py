"""How controllers show themselves: what they read and command, and the numbers that they hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from workbench.display import Rows, Shown


class ShownLaw(Shown):
    """A controller, a dataclass, that lists its numbers; of a matrix it says the size.

    Example:
        >>> from controllers.pid import cascade_pid
        >>> cascade_pid(6e5, 2e6, 1e5, inner=2e-6)
        <cascade PID: angle, pressure_1, pressure_2 -> valve every 2 ms>
    """

    def tables(self) -> tuple[Rows, ...]:
        """Return the numbers by name, in SI."""
        return (Rows("numbers in SI", ("name", "value"), list(_numbers("", self))),)

    def __str__(self) -> str:
        """Return what it reads and commands, and a line for every number."""
        law: Any = self
        ways = f"{', '.join(law.sensors)} -> {', '.join(law.actuators)}"
        head = f"{law.name}: {ways} every {1e3 * law.sample_time:g} ms"
        return "\n".join([head, *(f"  {name:<36} {v}" for name, v in _numbers("", self))])


def _numbers(name: str, value: Any) -> Iterator[tuple[str, object]]:
    dot = f"{name}." if name else ""
    if isinstance(value, (bool, int, float, str, np.number)):
        yield name, value
    elif isinstance(value, np.ndarray):
        yield name, f"array of {' x '.join(map(str, value.shape))}"
    elif is_dataclass(value):
        for field in fields(value):
            yield from _numbers(f"{dot}{field.name}", getattr(value, field.name))
    elif hasattr(value, "_fields"):
        for part in value._fields:
            yield from _numbers(f"{dot}{part}", getattr(value, part))
    elif isinstance(value, tuple) and all(isinstance(v, str) for v in value):
        yield name, ", ".join(value)
    elif isinstance(value, (tuple, list)):
        yield name, f"{len(value)} entries"
