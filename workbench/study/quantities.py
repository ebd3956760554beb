"""Values of a study file: a number in SI, or text with a unit such as "5 bar"."""

from __future__ import annotations

import math
import re

from workbench.errors import WorkbenchError
from workbench.model.units import parse_unit, same_dimension, to_si

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")


def si_value(name: str, given: object, unit: str) -> float:
    """Read a value as a number in SI.

    Args:
        name: What the value is, as the user knows it.
        given: A number in SI, or text of a number and a unit.
        unit: SI unit of the quantity.

    Returns:
        The value, in ``unit``.

    Raises:
        WorkbenchError: If it is no finite number, or its unit is unknown or measures something
            else.

    Example:
        >>> si_value("supply pressure", "5 bar", "Pa"), si_value("load", 3, "kg")
        (500000.0, 3.0)
    """
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        if not math.isfinite(given):
            raise WorkbenchError(f"{name} is {given}, which is not a finite number")
        return float(given)
    match = _NUMBER.fullmatch(given) if isinstance(given, str) else None
    if match is None:
        raise WorkbenchError(
            f"{name} is {given!r}, which is not a value; give a number in {unit}, or text with a"
            f' unit such as "1 {unit}"'
        )
    value = float(match[1])
    if not match[2]:
        return value
    parse_unit(match[2])
    if not same_dimension(match[2], unit):
        raise WorkbenchError(
            f"{name} is {given!r}, whose unit {match[2]!r} does not measure it; give {unit} or a"
            " unit of the same kind"
        )
    return float(f"{to_si(value, match[2]):.12g}")
