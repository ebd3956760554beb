"""The few operations of a control law beyond + - * /, on floats and on CasADi expressions.

A law written with an `Arithmetic` runs fast on plain floats and can be written out as C code from
CasADi symbols, from the same text.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Any, Protocol

import casadi as ca

Number = Any
"""A float or a CasADi scalar expression."""


class Arithmetic(Protocol):
    """Operations of a control law.

    Example:
        >>> FLOATS.clip(3.0, -1.0, 1.0), SYMBOLS.clip(ca.SX(3.0), -1.0, 1.0)
        (1.0, SX(1))
    """

    def clip(self, x: Number, lower: Number, upper: Number) -> Number:
        """Return x limited to [lower, upper].

        Args:
            x: The value.
            lower: Lower limit.
            upper: Upper limit.
        """

    def table(self, x: Number, points: tuple[float, ...], values: tuple[float, ...]) -> Number:
        """Interpolate by straight lines an odd table given for x >= 0, constant beyond its end.

        Args:
            x: The value, in the unit of ``points``.
            points: Increasing abscissae in any unit, starting at 0.
            values: Ordinates in any unit, starting at 0.
        """


class _Floats:
    def clip(self, x: float, lower: float, upper: float) -> float:
        return lower if x < lower else upper if x > upper else x

    def table(self, x: float, points: tuple[float, ...], values: tuple[float, ...]) -> float:
        size = -x if x < 0.0 else x
        if size >= points[-1]:
            y = values[-1]
        else:
            i = bisect_right(points, size)
            a, c = points[i - 1], values[i - 1]
            y = c + (size - a) * (values[i] - c) / (points[i] - a)
        return -y if x < 0.0 else y


class _Symbols:
    def clip(self, x: ca.SX, lower: Number, upper: Number) -> ca.SX:
        return ca.fmin(ca.fmax(x, lower), upper)

    def table(self, x: ca.SX, points: tuple[float, ...], values: tuple[float, ...]) -> ca.SX:
        size = ca.fmin(ca.fabs(x), points[-1])
        y = ca.pw_lin(size, ca.DM(list(points)), ca.DM(list(values)))
        return ca.if_else(x < 0, -y, y)


FLOATS: Arithmetic = _Floats()
"""On plain floats."""

SYMBOLS: Arithmetic = _Symbols()
"""On CasADi SX expressions."""
