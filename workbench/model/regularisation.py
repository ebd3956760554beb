"""Non-smooth functions in two forms: exact for verification, regularised for derivatives.

Every kinked function of a model goes through a `Form`. The exact form has the kink, the regularised
form replaces it within ``width`` of the kink by a polynomial that joins with continuous second
derivative, so that both are equal outside that neighbourhood.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

Expression = Any
"""A CasADi expression, a float or a NumPy array: the laws of the library accept all three."""


def is_symbolic(*values: Expression) -> bool:
    """Tell whether any of some values, in any unit, is a CasADi matrix or expression."""
    return any(isinstance(v, (ca.SX, ca.MX, ca.DM)) for v in values)


def functions_of(value: Expression) -> Any:
    """Return the module whose functions take a value, in any unit: CasADi or NumPy."""
    return ca if is_symbolic(value) else np


def maximum(a: Expression, b: Expression) -> Expression:
    """Return the larger of two values of one unit, elementwise: numbers, arrays or expressions."""
    return ca.fmax(a, b) if is_symbolic(a, b) else np.maximum(a, b)


def minimum(a: Expression, b: Expression) -> Expression:
    """Return the smaller of two values of one unit, elementwise: numbers, arrays or expressions."""
    return ca.fmin(a, b) if is_symbolic(a, b) else np.minimum(a, b)


def where(condition: Expression, yes: Expression, no: Expression) -> Expression:
    """Return ``yes`` where a condition holds and ``no``, of the same unit, elsewhere.

    Both sides are computed everywhere, so neither may fail where the other one counts.
    """
    if is_symbolic(condition, yes, no):
        return ca.if_else(condition, yes, no)
    return np.where(condition, yes, no)


def sqrt(x: Expression) -> Expression:
    """Return the square root of a number, array or expression x >= 0, in any unit."""
    return functions_of(x).sqrt(x)


@dataclass(frozen=True)
class Form:
    """A set of kinked functions, either with their kink or regularised.

    Their argument x has any unit and shape. ``width`` is the half-width w of the rounded
    neighbourhood of a kink, in the unit of x.

    Example:
        >>> float(EXACT.ramp(0.0, 1.0)), float(REGULARISED.ramp(0.0, 1.0))
        (0.0, 0.1875)
        >>> float(EXACT.ramp(2.0, 1.0)), float(REGULARISED.ramp(2.0, 1.0))
        (2.0, 2.0)
    """

    regularised: bool

    def ramp(self, x: Expression, width: float) -> Expression:
        """Return max(0, x), in the unit of x.

        The regularised form is ``(x + w)^3 (3 w - x) / (16 w^3)`` for ``|x| < w``: value and two
        derivatives join the exact function at ``x = -w`` and ``x = w``.
        """
        if not self.regularised:
            return maximum(x, 0.0)
        c = minimum(maximum(x, -width), width)
        return (c + width) ** 3 * (3 * width - c) / (16 * width**3) + maximum(x - width, 0.0)

    def step(self, x: Expression, width: float) -> Expression:
        """Return 1 for x > 0 and 0 otherwise, a ratio; regularised, the derivative of `ramp`.

        At x = 0 it is 0 on the exact and 1/2 on the regularised form.
        """
        if not self.regularised:
            return where(x > 0, 1.0, 0.0)
        c = minimum(maximum(x, -width), width)
        return (c + width) ** 2 * (2 * width - c) / (4 * width**3)

    def absolute(self, x: Expression, width: float) -> Expression:
        """Return the absolute value of x, in its unit; 3 w / 8 at x = 0 on the regularised form."""
        return self.ramp(x, width) + self.ramp(-x, width) if self.regularised else maximum(x, -x)

    def sign(self, x: Expression, width: float) -> Expression:
        """Return -1, 0 or 1, dimensionless, or the smooth transition between them."""
        return self.step(x, width) - self.step(-x, width)

    def clip(self, x: Expression, lower: float, upper: float, width: float) -> Expression:
        """Return x limited to ``[lower, upper]``, all in one unit.

        The regularised form keeps the limits too, and differs by at most 3 w / 16.
        """
        return lower + self.ramp(x - lower, width) - self.ramp(x - upper, width)

    def table(
        self, x: Expression, points: Sequence[float], values: Sequence[float], width: float
    ) -> Expression:
        """Interpolate a table in the unit of ``values``, constant beyond its ends.

        ``y = y_0 + sum_i (m_i - m_{i-1}) ramp(x - x_i)``, every corner rounded when regularised.

        Args:
            points: Abscissae x_i, shape (n,), increasing, in the unit of ``x``.
            values: Ordinates y_i, shape (n,), in any unit, that of the result.
            x: Argument, in the unit of ``points``.
            width: Half-width of the rounded corners, in the unit of ``x``; no more than half the
                closest spacing.
        """
        x_i, y_i = (tuple(np.asarray(v, dtype=float).tolist()) for v in (points, values))
        if isinstance(x, ca.SX) and x.is_scalar():
            return _table_of(self, x_i, y_i, width)(x)
        return _summed(self, x, x_i, y_i, width)


def _summed(
    form: Form,
    x: Expression,
    points: tuple[float, ...],
    values: tuple[float, ...],
    width: float,
) -> Expression:
    slopes = np.concatenate([[0.0], np.diff(values) / np.diff(points), [0.0]])
    y = values[0] + 0.0 * x
    rounded = 1e-12 * np.abs(slopes).max()
    for point, change in zip(points, np.diff(slopes).tolist(), strict=True):
        if abs(change) > rounded:
            y = y + change * form.ramp(x - point, width)
    return y


@functools.lru_cache(maxsize=64)
def _table_of(
    form: Form, points: tuple[float, ...], values: tuple[float, ...], width: float
) -> ca.Function:
    """Build a table once: a model is written down many times, and most of the arm is its valve."""
    x = ca.SX.sym("x")
    return ca.Function("table", [x], [_summed(form, x, points, values, width)])


EXACT = Form(regularised=False)
REGULARISED = Form(regularised=True)
