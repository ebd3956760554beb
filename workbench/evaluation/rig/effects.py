"""Hidden effects: where each acts and which parameters, at what size, switch it on.

Units: SI.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from workbench.evaluation.rig.parameters import elements


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


def _effects() -> dict[str, Effect]:
    text = Path(__file__).with_name("effects.toml").read_text(encoding="utf-8")
    return {
        name: Effect(where, words, parameters, Size(**size[0]) if size else None)
        for name, (where, words, parameters, *size) in tomllib.loads(text).items()
    }


EFFECTS = _effects()
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
    for name, value in (sizes or {}).items():
        if name not in values:
            raise KeyError(f"unknown rig parameter {name!r}")
        values[name] = value
    return values
