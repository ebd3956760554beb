"""Values on the command line: a number with or without its unit."""

from __future__ import annotations

import math
import re

from workbench.errors import WorkbenchError
from workbench.model.units import convert, parse_unit, same_dimension

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*$")


def quantity(name: str, text: str, unit: str) -> float:
    """Read a value such as ``30``, ``30deg`` or ``0.5 rad``.

    Args:
        name: What the value is, as the user knows it.
        text: What the user wrote; without a unit, ``unit`` is meant.
        unit: Unit of the result.

    Returns:
        The value, in ``unit``.

    Raises:
        WorkbenchError: If it is not a finite number, or its unit is unknown or measures something
            else.

    Example:
        >>> quantity("mean pressure", "300kPa", "bar")
        3.0
        >>> quantity("angle", "30", "deg")
        30.0
    """
    example = f"give a number with or without a unit, such as '{_EXAMPLES.get(unit, '1')}{unit}'"
    match = _NUMBER.fullmatch(text)
    if match is None:
        finite = text.strip().lower().lstrip("+-") not in ("nan", "inf", "infinity")
        what = "is not a number" if finite else "is not a finite number"
        raise WorkbenchError(f"{name} {text!r} {what}; {example}")
    value = float(match[1])
    if not math.isfinite(value):
        raise WorkbenchError(f"{name} {text!r} is not a finite number; {example}")
    if not match[2]:
        return value
    parse_unit(match[2])
    if not same_dimension(match[2], unit):
        raise WorkbenchError(
            f"{name} {text!r} has the unit {match[2]!r}, which does not measure it; {example}"
        )
    # Through decimal text, so that 300 kPa becomes 3 bar and not 3 bar less a rounding.
    return float(f"{convert(value, match[2], unit):.12g}")


_EXAMPLES = {"deg": "30", "kg": "3", "bar": "3", "s": "5", "V": "5.5"}
