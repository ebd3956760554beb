"""What a study may say about the tolerance of a metric, and how each entry is read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.study.quantities import si_value


def _better(value: Any, _unit: str) -> str:
    return check_choice("better", value, ("less", "more", "neither"))


def _gates(value: Any, _unit: str) -> bool:
    if not isinstance(value, bool):
        raise WorkbenchError(f"gates is {value!r}; give true or false")
    return value


TOLERANCE_KEYS: dict[str, Callable[[Any, str], Any]] = {
    "absolute": lambda value, unit: check_range(
        "tolerance", si_value("tolerance", value, unit), 0.0, 1e12, unit
    ),
    "relative": lambda value, unit: check_range(
        "tolerance", si_value("tolerance", value, "1"), 0.0, 10.0
    ),
    "better": _better,
    "gates": _gates,
}
"""Reader by key, called with the value and the unit of the metric."""
