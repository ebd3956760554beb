"""Units in which the pictures of a diagnosis are read."""

from __future__ import annotations

from workbench.model.units import readable


def titled(name: str, unit: str) -> str:
    """Write a quantity with its readable unit as the label of an axis.

    Args:
        unit: SI unit.
    """
    shown = readable(unit)[0]
    plain = name.replace("_", " ")
    return plain if shown == "1" else f"{plain} in {shown}"
