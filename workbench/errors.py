"""Errors that tell a user what was wrong, the value, the valid range and the usual fix."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

TIMES_S = (1e-15, 1e15)
"""Shortest and longest time that a machine may have, in s; beyond, a unit is wrong."""


class WorkbenchError(Exception):
    """A mistake in what the user asked for; its text is one clear sentence.

    The command line prints the text and exits with status 2. Whatever is public raises it for a
    name that there is not, a value outside its range or in a wrong unit, arguments that do not fit
    together, and a file that cannot be read or written; docstrings say what goes beyond that.
    """


class NumericalError(WorkbenchError):
    """A computation that did not converge, left its validity or became non-finite."""


def missing_package(what: str, package: str, extra: str, otherwise: str = "") -> WorkbenchError:
    """Return the error of something that needs a package of an extra which is not installed.

    Args:
        otherwise: What to do without it.
    """
    return WorkbenchError(
        f"{what} needs {package}, which is not installed; install it with"
        f" pip install 'muscle-arm-workbench[{extra}]'{', or ' if otherwise else ''}{otherwise}"
    )


def check_range(
    name: str, value: float, lower: float, upper: float, unit: str = "", *, fix: str = ""
) -> float:
    """Return ``value`` as a float, in ``unit``, if it is finite and inside ``[lower, upper]``.

    Args:
        name: What the number is, as the user knows it.
        value: The number, in ``unit``.
        lower: Smallest valid value, in ``unit``.
        upper: Largest valid value, in ``unit``.
        unit: Unit printed behind the numbers.

    Example:
        >>> check_range("load", 3, 0, 8, "kg")
        3.0
    """
    suffix = f" {unit}" if unit not in ("", "1") else ""
    tail = f"; {fix}" if fix else ""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise WorkbenchError(
            f"{name} is {str(value)[:60]!r}, which is not a number; give"
            f" {lower:g} to {upper:g}{suffix}{tail}"
        ) from None
    if not math.isfinite(number) or not lower <= number <= upper:
        raise WorkbenchError(
            f"{name} is {number:g}{suffix}; the valid range is {lower:g} to {upper:g}{suffix}{tail}"
        )
    return number


def check_choice(name: str, value: str, choices: Iterable[str], *, listed: str = "") -> str:
    """Return ``value`` if it is one of ``choices``, else raise with the nearest spelling.

    Args:
        name: What the word is, as the user knows it.
        listed: Command that lists the choices, where they are too many for a sentence.

    Example:
        >>> check_choice("plane", "vertical", ("horizontal", "vertical"))
        'vertical'
    """
    known = list(choices)
    if value in known:
        return value
    near = difflib.get_close_matches(str(value), known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    offered = f"those that {listed!r} lists" if listed else ", ".join(known)
    raise WorkbenchError(f"{name} is {value!r}; it must be one of {offered}{hint}")


def check_finite(name: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return ``values`` as a float array, in their own unit, if every element is finite.

    Args:
        name: What the numbers are, as the user knows it.
        values: Numbers of any shape, in any unit.

    Raises:
        WorkbenchError: If they are not numbers or not finite; names the first bad index.

    Example:
        >>> check_finite("time", [0.0, 1.0])
        array([0., 1.])
    """
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise WorkbenchError(f"{name} holds something that is not a number") from None
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise WorkbenchError(
            f"{name} holds {bad.size} value(s) that are not finite, the first at index "
            f"{int(bad[0])}; remove or replace them"
        )
    return array
