"""The static curve of a command: what a plant answers to all of it, where that bends.

Power goes with the square of a voltage, thrust with that of a speed, and a valve opens little at
first. A controller that sends its command through the inverse of the curve is left with a plant
whose answer is straight: the linear model at rest then holds for large commands too. The curve is
read off the equations, at the command or behind the lag of its actuator:

    v(u) = sum_i w_i (f_i(u) - f_i(u0)) / b_i,     sum_i w_i = 1

is the change of a command that does as much by the slopes b_i = df_i/du at rest as all of u does to
the rates f_i; rates count by what they are moved by, over the scales of their states.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.model import EXACT
from workbench.operating_point import Derivatives, OperatingPoint, derivatives_of

Flags = npt.NDArray[np.bool_]

POINTS = 24
"""Points of a curve to each side of rest, closer near it."""

BENT = 0.1
"""What a curve leaves a straight line by that is worth an inverse, as a fraction of it."""

AMONG = 0.5
"""Part of its bend that a curve may change by with states and with other inputs."""

HARDLY = 0.01
"""Answer of a rate, over the largest, in their scales, of which nobody asks how it bends."""

ASIDE = 0.1
"""Part of its scale by which a state is moved to see whether the curve changes."""


class CommandCurve(NamedTuple):
    """A static curve, as changes of a command from rest and those that do as much by the slopes.

    Args:
        command: Increasing changes of the command, shape (n,), in SI, 0 among them.
        straight: Increasing changes that do as much, shape (n,), in SI.
        rate: Slowest rate of what lags before the curve, in rad/s; infinite for nothing.
        lags: Number of states that do.
    """

    command: Vector
    straight: Vector
    rate: float = np.inf
    lags: int = 0

    @property
    def sides(self) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
        """Tables of both below rest and above it, as distances from it, in SI."""
        found = []
        for sign in (-1.0, 1.0):
            both = (self.command, self.straight)
            by, to = (np.sort(sign * part[sign * self.command >= 0.0]) for part in both)
            found.append((tuple(by.tolist()), tuple(to.tolist())))
        return found


def command_curves(point: OperatingPoint) -> tuple[CommandCurve | None, ...]:
    """Return the curve of each command, or None where it is straight or not static."""
    at = derivatives_of(point.model, EXACT)
    return tuple(_curve(point, at, k) for k in range(len(point.model.inputs)))


def _curve(point: OperatingPoint, at: Derivatives, k: int) -> CommandCurve | None:
    model, quantity, n = point.model, point.model.inputs[k], len(point.x)
    room = np.array([quantity.lower, quantity.upper]) - point.u[k]
    ended = np.all(np.isfinite(room)) and room[0] < 0.0 < room[1]
    if not (ended and quantity.commanded and quantity.slew == np.inf):
        return None
    share = np.linspace(0.0, 1.0, POINTS)[1:] ** 2
    changes = np.concatenate([room[0] * share[::-1], room[1] * share])
    size = np.array([q.scale for q in model.states])
    jacobian = at(point.x, point.u, model.values)[1]
    for signal in _signals(point, at, k, room):
        place, gain, rows, rate = signal
        along = np.zeros(n + len(point.u))
        along[place] = gain
        slope = (jacobian[:n] @ along / size)[rows]
        if not np.any(slope):
            return None
        weight = slope / (slope @ slope)

        def moved(x: Vector, u: Vector, rows: Flags = rows, along: Vector = along) -> Vector:
            ends = np.concatenate([x, u]) + np.append(0.0, changes)[:, None] * along
            values = np.array([at.values(one[:n], one[n:], model.values)[:n] for one in ends])
            return np.asarray((values[1:] - values[0])[:, rows] / size[rows])

        table = moved(point.x, point.u)
        straight = table @ weight
        bend = np.abs(straight / changes - 1.0)
        if np.max(bend, initial=0.0, where=np.isfinite(bend)) > BENT:
            break
    else:
        return None
    others = [moved(x, u) @ weight for x, u in _elsewhere(point, k, size)]
    # Rates that are moved at all, each to its side of a kink.
    others += [
        np.where(sign * changes > 0.0, row * (straight @ row) / (row @ row), straight)
        for sign in (-1.0, 1.0)
        for row in np.where(sign * changes > 0.0, table.T, 0.0)
        if np.abs(row).max() > HARDLY * np.abs(table).max()
    ]
    sure = np.all(np.isfinite([straight, *others]), axis=0)
    if not np.any(sure):
        return None
    own, line, *each = (part[sure] / np.ptp(part[sure]) for part in (straight, changes, *others))
    if np.max(np.abs(np.array(each) - own)) > AMONG * np.max(np.abs(own - line)):
        return None
    found = _rising(changes, straight)
    return found and CommandCurve(*found, rate, int(_seen(point).sum() - rows.sum()))


def _rising(changes: Vector, straight: Vector) -> tuple[Vector, Vector] | None:
    """Return what of a curve rises without a break around rest."""
    found = []
    for side in (-1.0, 1.0):
        own = side * changes > 0.0
        by, to = (np.append(0.0, side * part[own][:: int(side)]) for part in (changes, straight))
        end = int(np.argmin(np.append(np.diff(to) >= 0.0, False)))
        kept = np.append(True, np.diff(to[: end + 1]) > 0.0)
        found.append((side * by[: end + 1][kept], side * to[: end + 1][kept]))
    (by, to), (by_up, to_up) = found
    if min(len(by), len(by_up)) < 2:
        return None
    return np.append(by[:0:-1], by_up), np.append(to[:0:-1], to_up)


def _elsewhere(point: OperatingPoint, k: int, size: Vector) -> Iterator[tuple[Vector, Vector]]:
    """Yield states and inputs beside the point, one of them moved, the input itself never."""
    for i, by in enumerate(ASIDE * size):
        for sign in (-1.0, 1.0):
            yield point.x + sign * by * np.eye(len(size))[i], point.u
    for i, q in enumerate(point.model.inputs):
        for end in (q.lower, q.upper):
            if i != k and np.isfinite(end):
                u = point.u.copy()
                u[i] = 0.5 * (u[i] + end)
                yield point.x, u


def _written(point: OperatingPoint) -> tuple[Flags, Flags]:
    """Tell on what states and inputs rates and measurements depend, as they are written."""
    traced = point.model.form(EXACT)
    by = ca.vertcat(traced.x, traced.u)
    rates, outputs = (
        ca.DM(ca.jacobian_sparsity(part, by), 1.0).full() != 0.0
        for part in (traced.rates, traced.outputs)
    )
    return rates, outputs


def _seen(point: OperatingPoint) -> Flags:
    """Tell which states a measurement depends on, now or later, shape (n_x,)."""
    rates, outputs = _written(point)
    n = len(rates)
    seen = np.any(outputs[:, :n], axis=0)
    for _ in range(n):
        seen = seen | np.any(rates[seen, :n], axis=0)
    return np.asarray(seen)


def _signals(
    point: OperatingPoint, at: Derivatives, k: int, room: Vector
) -> Iterator[tuple[int, float, Flags, float]]:
    """Yield the signals in which a command reaches the plant: itself, and what lags behind it.

    Returns:
        Place among states and inputs, its change at rest over that of the command, the states
        whose rates count, shape (n_x,), and the slowest rate of the others, in rad/s.
    """
    written, _ = _written(point)
    values = point.model.values
    slopes = at(point.x, point.u, values)[1]
    n = len(written)
    place, gain, rows, rate = n + k, 1.0, _seen(point), np.inf
    while True:
        yield place, gain, rows, rate
        # What follows the signal by itself: a lag, or several that depend on one another.
        own = written[:, place] & rows
        while np.any(more := np.any(written[own, :n], axis=0) & rows & ~own):
            own = own | more
        strange = np.ones(len(written[0]), dtype=bool)
        strange[:n], strange[place] = ~own, False
        rest = rows & ~own
        (out,) = np.nonzero(own & np.any(written[rest, :n], axis=0))
        if not rest.any() or len(out) != 1 or np.any(written[own][:, strange]):
            return
        places = np.flatnonzero(own)
        lag, enters = slopes[np.ix_(places, places)], slopes[places, place] * gain
        rate = min(rate, float(np.min(-np.linalg.eigvals(lag).real)))
        if rate <= 0.0:
            return
        along = np.zeros(len(written[0]))
        along[place], along[places] = gain, -np.linalg.solve(lag, enters)
        # Where it follows, it rests, however far.
        for far in room:
            x, u = np.split(np.concatenate([point.x, point.u]) + far * along, [n])
            left = at.values(x, u, values)[places] - at.values(point.x, point.u, values)[places]
            if not np.all(np.abs(left) <= BENT * np.abs(far * enters).max()):
                return
        gain, place, rows = float(along[out[0]]), int(out[0]), rest
