"""Kinks at or next to an operating point, and the matrices on both sides of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.arrays import Vector
from workbench.linearisation.linear_model import LinearModel
from workbench.model import Model, Quantity
from workbench.model.units import rate_unit, with_unit
from workbench.operating_point import Derivatives, OperatingPoint

_AT_ONCE = 1e-7
_REACH = 0.05
_JUMP = 0.05
_BEND = 0.1
_BISECTIONS = 16
_MINOR = 0.2
"""Share of the largest slope of a row below which a slope is too small to matter."""


@dataclass(frozen=True)
class Kink:
    """A place where the slopes of a plant jump, and the linear models on both sides.

    Args:
        name: State or input across which the slopes jump.
        distance: Where the kink is, from the operating point, in ``unit``; 0 for on the kink.
        of: Rate or measurement whose slope jumps most.
        slope_below: Its slope below the kink, in SI.
        slope_above: Its slope above the kink, in SI.
        slope_read: Unit in which people read the slopes, and its size from SI.
        read: Unit in which people read the distance, and its size from SI.
    """

    name: str
    unit: str
    distance: float
    below: LinearModel
    above: LinearModel
    of: str
    slope_below: float
    slope_above: float
    slope_read: tuple[str, float]
    read: tuple[str, float]

    @property
    def factor(self) -> float:
        """Larger over smaller of the two slopes, dimensionless."""
        small, large = sorted((abs(self.slope_below), abs(self.slope_above)))
        return large / small if small else float("inf")

    @property
    def mean(self) -> float:
        """Mean of both slopes, in SI."""
        return 0.5 * (self.slope_below + self.slope_above)

    def __str__(self) -> str:
        """Return one line: where, and both slopes."""
        unit, factor = self.slope_read
        below, above = (factor * slope for slope in (self.slope_below, self.slope_above))
        away = f"{self.distance * self.read[1]:+.3g}"
        where = f"{with_unit(away, self.read[0])} away" if self.distance else "at the point"
        return (
            f"kink in {self.name}, {where}: slope of {self.of} {below:.4g} {unit} below,"
            f" {above:.4g} above (factor {self.factor:.3g})"
        )


def slope_read(model: Model, row: str, row_unit: str, by: Quantity) -> tuple[str, float]:
    """Return the unit in which people read a slope, and its factor from SI.

    Args:
        row: Output, or ``"rate of"`` a state.
        row_unit: Its SI unit.
    """
    (top, rise), (bottom, run) = model.reading(row_unit, row), model.reading(by.unit, by.name)
    return f"{top} per {bottom}", rise / run


def find_kinks(
    at: Derivatives,
    point: OperatingPoint,
    build: Callable[[Vector], LinearModel],
    matrix: Vector,
    jacobian: Vector,
) -> tuple[Kink, ...]:
    """Find kinks across each state and input, at the point or up to 5 % of a scale away.

    Args:
        build: Makes a linear model of derivatives, shape (n_x + n_y, n_x + n_u), in SI.
        matrix: Derivatives that the linear model uses, shape (n_x + n_y, n_x + n_u), in SI.
        jacobian: Derivatives at the point, same shape, in SI.

    Returns:
        The kinks, those at the point first, then by the size of the jump.
    """
    model = point.model
    quantities = [*model.states, *model.inputs]
    rows = [f"d {q.name}/dt" for q in model.states] + [q.name for q in model.outputs]
    names = [f"rate of {q.name}" for q in model.states] + [q.name for q in model.outputs]
    units = [rate_unit(q.unit) for q in model.states] + [q.unit for q in model.outputs]
    columns = np.array([q.scale for q in quantities])
    sizes = np.array([q.scale for q in (*model.states, *model.outputs)])
    norm = columns / sizes[:, None]
    z = np.concatenate([point.x, point.u])
    p = model.values
    n = len(point.x)

    def slopes(index: int, by: float) -> Vector:
        moved = z.copy()
        moved[index] += by * columns[index]
        return at(moved[:n], moved[n:], p)[1]

    around = np.array(
        [[slopes(i, by) for by in (-_REACH, -_AT_ONCE, _AT_ONCE, _REACH)] for i in range(len(z))]
    )
    bends = _bends(around[:, :-1], around[:, 1:], norm)

    # What an oscillation has replaced stays replaced on both sides.
    swung = matrix != jacobian
    found = []
    for i, quantity in enumerate(quantities):
        if bends[i, 1] > _JUMP:
            jumps = [(0.0, around[i, 1], around[i, 2])]
        else:
            # A slope that was taken over an oscillation has crossed what is near.
            near = () if swung[:, i].any() else (-1, 1)
            jumps = [
                jump
                for side in near
                if bends[i, 1 + side] > _BEND
                and (jump := _nearest(slopes, i, side, around[i], bends[i, 1 + side], norm))
            ]
        for distance, below, above in jumps:
            change = np.abs(_relative(below, above, norm))
            # Of equal jumps the first is named: pressures stand before temperatures.
            first = int(np.argmax(change.ravel() > 0.9 * change.max()))
            row, column = np.unravel_index(first, change.shape)
            sided = [build(np.where(swung, matrix, side)) for side in (below, above)]
            found.append(
                Kink(
                    quantity.name,
                    quantity.unit,
                    distance * quantity.scale,
                    sided[0],
                    sided[1],
                    f"{rows[row]} by {quantities[column].name}",
                    float(below[row, column]),
                    float(above[row, column]),
                    slope_read(model, names[row], units[row], quantities[column]),
                    model.reading(quantity.unit, quantity.name),
                )
            )
    return tuple(sorted(found, key=lambda kink: (kink.distance != 0.0, -kink.factor)))


def _nearest(
    slopes: Callable[[int, float], Vector],
    i: int,
    side: int,
    around: Vector,
    total: float,
    norm: Vector,
) -> tuple[float, Vector, Vector] | None:
    """Bisect towards a jump on one side; return distance, slopes below and slopes above."""
    here, there = (around[2], around[3]) if side > 0 else (around[1], around[0])
    near, beyond, before = _AT_ONCE, _REACH, here
    for _ in range(_BISECTIONS):
        middle = 0.5 * (near + beyond)
        slope = slopes(i, side * middle)
        if _bends(here, slope, norm) > 0.5 * total:
            beyond, there = middle, slope
        else:
            near, before = middle, slope
    # A bend that is spread out, as that of a rounded kink, is none.
    if _bends(before, there, norm) <= _JUMP:
        return None
    return side * beyond, *((before, there) if side > 0 else (there, before))


def _bends(a: Vector, b: Vector, norm: Vector) -> Vector:
    """Return the largest relative change of a slope, over the last two axes."""
    return np.asarray(np.abs(_relative(a, b, norm)).max(axis=(-2, -1)))


def _relative(a: Vector, b: Vector, norm: Vector) -> Vector:
    """Return the change of each slope relative to itself, minor slopes relative to their row."""
    scaled_a, scaled_b = a * norm, b * norm
    size = np.maximum(np.abs(scaled_a), np.abs(scaled_b))
    row = size.max(axis=-1, keepdims=True)
    return np.asarray((scaled_b - scaled_a) / (size + _MINOR * row + 1e-12))
