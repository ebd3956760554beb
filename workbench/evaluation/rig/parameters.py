"""Names, units, nominal values and meaning of every number of the rig.

Units: as in the table.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

ELEMENTS = 12
"""Number of Maxwell-slip elements a muscle can have."""


PARAMETERS: dict[str, tuple[float, str, str]] = {
    name: (value, unit, meaning)
    for name, (value, unit, meaning) in tomllib.loads(
        Path(__file__).with_name("parameters.toml").read_text(encoding="utf-8")
    ).items()
}
PARAMETERS |= {f"hyst_d{i + 1}": (1.0, "m", "break-away distance") for i in range(ELEMENTS)}
PARAMETERS |= {f"hyst_w{i + 1}": (0.0, "-", "share of the half width") for i in range(ELEMENTS)}
"""Nominal value, unit and meaning of every parameter by name, as ``parameters.toml`` has them; the
last are those of Maxwell-slip elements."""


def nominal(changes: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the nominal parameters with some of them changed; unknown names are refused."""
    values = {name: value for name, (value, _, _) in PARAMETERS.items()}
    for name, value in (changes or {}).items():
        if name not in values:
            raise KeyError(f"unknown rig parameter {name!r}")
        values[name] = float(value)
    return values


def elements(smallest: float, largest: float, count: int = ELEMENTS) -> dict[str, float]:
    """Return parameters of equal Maxwell-slip elements, break-aways between two ends in m."""
    spread = np.geomspace(smallest, largest, count).tolist()
    values: dict[str, float] = {}
    for i in range(ELEMENTS):
        values[f"hyst_d{i + 1}"] = spread[i] if i < count else 1.0
        values[f"hyst_w{i + 1}"] = 1.0 / count if i < count else 0.0
    return values
