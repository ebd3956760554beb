"""The few operations of a control law beyond + - * /, on floats and on CasADi expressions.

A law written with an `Arithmetic` runs fast on plain floats and can be written out as C code from
CasADi symbols, from the same text.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from functools import reduce
from typing import Any, Protocol

import casadi as ca
import numpy as np

Number = Any
"""A float or a CasADi scalar expression."""

Numbers = tuple[Number, ...]
"""Several of them: measurements, references or commands, in SI."""

Rows = tuple[tuple[float, ...], ...]
"""A matrix of numbers."""

Told = dict[str, Number]
"""What a law tells about a step, by name, in SI."""


class Arithmetic(Protocol):
    """Operations of a control law.

    Example:
        >>> FLOATS.clip(3.0, -1.0, 1.0), SYMBOLS.clip(ca.SX(3.0), -1.0, 1.0)
        (1.0, SX(1))
    """

    def clip(self, x: Number, lower: Number, upper: Number) -> Number:
        """Return x limited to [lower, upper]."""

    def table(self, x: Number, points: tuple[float, ...], values: tuple[float, ...]) -> Number:
        """Interpolate by straight lines an odd table given for x >= 0, constant beyond its end.

        Points, in the unit of x, and values, in any unit, increase and start at 0.
        """

    def place(self, x: Number, first: float, spacing: float, count: int) -> tuple[Number, Number]:
        """Find x, in the unit of the grid, on an even grid of ``count`` points.

        Returns:
            Index of the interval, and the fraction within it, below 0 or above 1 outside the grid.
        """

    def between(self, place: tuple[Number, Number], values: tuple[float, ...]) -> Number:
        """Interpolate values of any unit at the grid's points, straight on beyond its ends."""

    def where(self, condition: Any, yes: Number, no: Number) -> Number:
        """Return ``yes`` where the condition holds, else ``no``, of any unit; both are computed."""

    def largest(self, *values: Number) -> Number:
        """Return the largest value."""

    def root(self, x: Number) -> Number:
        """Return the square root of x >= 0."""

    def cube_root(self, x: Number) -> Number:
        """Return the cube root of x >= 0."""


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

    def place(self, x: float, first: float, spacing: float, count: int) -> tuple[int, float]:
        steps = (x - first) / spacing
        i = min(max(math.floor(steps), 0), count - 2)
        return i, steps - i

    def between(self, place: tuple[int, float], values: tuple[float, ...]) -> float:
        i, fraction = place
        return values[i] + fraction * (values[i + 1] - values[i])

    def where(self, condition: bool, yes: float, no: float) -> float:
        return yes if condition else no

    def largest(self, *values: float) -> float:
        return max(values)

    def root(self, x: float) -> float:
        return math.sqrt(x)

    def cube_root(self, x: float) -> float:
        return math.pow(x, 1.0 / 3.0)


class _Symbols:
    def clip(self, x: ca.SX, lower: Number, upper: Number) -> ca.SX:
        return ca.fmin(ca.fmax(x, lower), upper)

    def table(self, x: ca.SX, points: tuple[float, ...], values: tuple[float, ...]) -> ca.SX:
        size = ca.fmin(ca.fabs(x), points[-1])
        y = ca.pw_lin(size, ca.DM(list(points)), ca.DM(list(values)))
        return ca.if_else(x < 0, -y, y)

    def place(
        self, x: ca.SX, first: float, spacing: float, count: int
    ) -> tuple[tuple[ca.SX, ...], ca.SX]:
        steps = (x - first) / spacing
        i = ca.fmin(ca.fmax(ca.floor(steps), 0), count - 2)
        # The interval as one switch each: shared by every table that is read at this place.
        return tuple(i == k for k in range(count - 1)), steps - i

    def between(self, place: tuple[tuple[ca.SX, ...], ca.SX], values: tuple[float, ...]) -> ca.SX:
        switches, fraction = place
        low = sum(s * v for s, v in zip(switches, values, strict=False))
        rise = sum(s * (b - a) for s, a, b in zip(switches, values, values[1:], strict=False))
        return low + fraction * rise

    def where(self, condition: ca.SX, yes: Number, no: Number) -> ca.SX:
        return ca.if_else(condition, yes, no)

    def largest(self, *values: Number) -> ca.SX:
        found = values[0]
        for value in values[1:]:
            found = ca.fmax(found, value)
        return found

    def root(self, x: ca.SX) -> ca.SX:
        return ca.sqrt(x)

    def cube_root(self, x: ca.SX) -> ca.SX:
        return x ** (1.0 / 3.0)


class _Arrays(_Floats):
    def clip(self, x: Any, lower: Any, upper: Any) -> Any:
        # NumPy's own clip takes longer for a few numbers.
        return np.minimum(np.maximum(x, lower), upper)

    def where(self, condition: Any, yes: Any, no: Any) -> Any:
        return np.where(condition, yes, no)

    def largest(self, *values: Any) -> Any:
        return reduce(np.maximum, values)

    def root(self, x: Any) -> Any:
        return np.sqrt(x)


FLOATS: Arithmetic = _Floats()
"""On plain floats."""

ARRAYS = _Arrays()
"""On arrays, each number by itself; without tables."""

SYMBOLS: Arithmetic = _Symbols()
"""On CasADi SX expressions."""


def total(start: Number, factors: tuple[float, ...], values: Numbers) -> Number:
    """Return start + sum of factors times values (in any units), in their order, without zeros."""
    for factor, value in zip(factors, values, strict=True):
        if factor:
            start = start + factor * value
    return start


def product(matrix: Rows, values: Numbers, start: Numbers = ()) -> Numbers:
    """Return start, by default nothing, + matrix times values (in any units), in their order."""
    return tuple(total(start[i] if start else 0.0, row, values) for i, row in enumerate(matrix))


def rows(matrix: Any) -> Rows:
    """Return a matrix, in any units, as a tuple of rows."""
    return tuple(tuple(row) for row in np.atleast_2d(np.asarray(matrix, dtype=float)).tolist())
