"""Every number of the rig, and the hidden effects: which of them, at what size, switch each on.

Units: as in the table.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
    return _changed({name: value for name, (value, _, _) in PARAMETERS.items()}, changes or {})


def _changed(values: dict[str, float], changes: Mapping[str, float]) -> dict[str, float]:
    for name, value in changes.items():
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


@dataclass(frozen=True)
class Size:
    """How an effect grows.

    Args:
        main: The parameter of the rig by which its size is stated.
        inverse: Whether the effect grows as that parameter falls.
        others: Parameters that grow with it.
    """

    main: str
    inverse: bool = False
    others: Sequence[str] = ()


@dataclass(frozen=True)
class Effect:
    """One physical effect: the port where it acts, the parameters it sets, and how it grows."""

    where: str
    words: str
    parameters: dict[str, float]
    size: Size | None = None


EFFECTS = {
    name: Effect(where, words, parameters, Size(**size[0]) if size else None)
    for name, (where, words, parameters, *size) in tomllib.loads(
        Path(__file__).with_name("effects.toml").read_text(encoding="utf-8")
    ).items()
}
"""Every effect by name, as ``effects.toml`` has it."""

EFFECTS["hysteresis_maxwell"].parameters.update(elements(0.2e-3, 4e-3, 8))


def switch_on(
    parameters: dict[str, float], names: list[str], sizes: dict[str, float] | None = None
) -> dict[str, float]:
    """Return the parameters with effects switched on; `sizes` overrides single parameters."""
    values = dict(parameters)
    for name in names:
        if name not in EFFECTS:
            raise KeyError(f"unknown effect {name!r}; known: {', '.join(EFFECTS)}")
        values.update(EFFECTS[name].parameters)
    return _changed(values, sizes or {})
