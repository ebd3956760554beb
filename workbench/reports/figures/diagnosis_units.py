"""Units in which the pictures of a diagnosis are read."""

from __future__ import annotations

import math

_READABLE: dict[str, tuple[str, float]] = {
    "rad": ("°", 180.0 / math.pi),
    "rad/s": ("°/s", 180.0 / math.pi),
    "Pa": ("bar", 1e-5),
    "kg/s": ("g/s", 1e3),
    "m3": ("cm³", 1e6),
    "Pa/s": ("bar/s", 1e-5),
    "m": ("mm", 1e3),
    "m/s": ("mm/s", 1e3),
}


def readable(unit: str) -> tuple[str, float]:
    """Return the unit in which people read a quantity, and its factor.

    Args:
        unit: SI unit.

    Returns:
        The unit to write, and the factor from the SI unit to it.

    Example:
        >>> readable("Pa"), readable("N m")
        (('bar', 1e-05), ('N m', 1.0))
    """
    return _READABLE.get(unit, (unit, 1.0))


def titled(name: str, unit: str) -> str:
    """Write a quantity with its readable unit as the label of an axis.

    Args:
        unit: SI unit.
    """
    shown = readable(unit)[0]
    plain = name.replace("_", " ")
    return plain if shown == "1" else f"{plain} in {shown}"
