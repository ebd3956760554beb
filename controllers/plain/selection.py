"""The best of many laws within limits, by what they answer to steps of references and loads.

The cost of a loop is the sum of the integrals of time by absolute error after a step of each
reference and of each load, what other outputs do counted in their scales, each over the least that
any loop has; a step that overshoots by a percent more than it may counts as a tenth of it more, one
that moves another output by as much as its own as four times, and one that first goes as far the
wrong way as eight times. By a zero at z in the right half plane, one that settles in T goes by
1 / (exp(z T) - 1) of it at least: by 1 / (z T) if it is fast, which is worth less than T by the
third power alone.

Units: SI.

Source:
    Graham and Lathrop, The synthesis of optimum transient response, AIEE Trans. 72, 1953 (time by
    absolute error).
    Middleton, Trade-offs in linear control system design, Automatica 27, 1991 (zeros).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from controllers.linear_law import LinearLaw
from controllers.plain.limits import Judged, LoopLimits, LoopSpecification
from controllers.plain.loop import loop_of
from controllers.plain.many_loops import chosen, closed, log_radii, stacked
from workbench.arrays import Matrix, Vector
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel

C = TypeVar("C")
Place = tuple[tuple[int, ...], Any]
"""A step of a grid for each output, and what else a law is designed for."""

OVERSHOT = 10.0
"""What an overshoot beyond what is allowed, as a fraction of the step, adds to errors, a ratio."""


class Answer(NamedTuple):
    """What loops answer to unit steps of references and loads.

    Args:
        overshoot: Of a step of each reference, shape (n, n_outputs), as fractions of it.
        undershoot: How far it goes the wrong way, the same.
        interaction: Most that such a step moves another output, shape (n, n_outputs), in their
            scales as a fraction of it.
        errors: Integrals of time by absolute error, shape (n, n_steps): after a step of each
            reference, in s2, then of each load, per SI of the command, times s2.
    """

    overshoot: Vector
    undershoot: Vector
    interaction: Vector
    errors: Matrix

    @property
    def least(self) -> Vector:
        """Least errors that any loop has, shape (n_steps,)."""
        return np.asarray(self.errors.min(axis=0, initial=math.inf))

    def cost(
        self, overshoot: float, backwards: float | None = None, *, least: Vector | None = None
    ) -> Vector:
        """Return the errors of loops over the least, of theirs by default, shape (n,), ratios.

        An overshoot, as a fraction of a step, is allowed, and as much the wrong way by default.
        """
        over = np.maximum(self.overshoot.max(axis=1) - overshoot, 0.0)
        wrong = overshoot if backwards is None else backwards
        under = np.maximum(self.undershoot.max(axis=1) - wrong, 0.0)
        penalty = (1.0 + OVERSHOT * over) * (1.0 + under) ** 3
        penalty = penalty * (1.0 + self.interaction.max(axis=1)) ** 2
        errors = self.errors / (self.least if least is None else least)
        return np.asarray(np.sum(errors, axis=1) * penalty)


def steps(limits: LoopLimits, laws: LinearLaw) -> tuple[Vector, Matrix, Matrix]:
    """Return the outputs of loops after unit steps.

    Returns:
        Times, shape (n,), eight to an octave after what is late; outputs, shape (n_loops, n,
        n_outputs, n_steps), for each input of the law behind the measurements and for the load of
        each command; and 1 as long as a loop has not settled, shape (n_loops, n).
    """
    plant = limits.stepped
    over, entry = closed(plant, laws)
    slowest = np.exp(log_radii(over))
    C = plant[2][: limits.outputs]
    left, x, stride = np.arange(len(over)), np.zeros_like(entry), 1
    times, on = [0], np.ones(len(over), dtype=bool)
    parts, going = [np.zeros((len(x), 1, len(C), x.shape[2]))], [on[:, None]]
    while np.any(on := on & (times[-1] * (1.0 - slowest) < 8.0) & (times[-1] < 1e9)):
        # Those that have settled are left as they are.
        left, staying = np.flatnonzero(on), on[left]
        x, over, entry = x[staying], over[staying], entry[staying]
        states = []
        for _ in range(8):
            x = over @ x + entry
            states.append(x[:, : C.shape[1]])
            times.append(times[-1] + stride)
        part = np.tile(parts[-1][:, -1:], (1, 8, 1, 1))
        part[left] = C @ np.stack(states, axis=1)
        parts.append(part)
        going.append(np.tile(on[:, None], 8))
        if times[-1] - limits.passing >= 16 * stride:
            entry, over, stride = over @ entry + entry, over @ over, 2 * stride
    time = np.array(times) * limits.want.sample_time
    return time, np.concatenate(parts, axis=1), np.concatenate(going, axis=1).astype(float)


def answer(time: Vector, seen: Matrix, going: Matrix, scale: Vector) -> Answer:
    """Measure outputs, of some scales, after unit steps; see `steps`."""
    p, k = seen.shape[2:]
    target = np.eye(p, k)
    # What a step of one output does to another counts in their scales.
    weight = np.append(scale, np.ones(k - p)) / scale[:, None]
    counted = np.abs(seen - target) * weight
    others = np.where(target > 0.0, 0.0, counted)[:, :, :, :p].max(axis=2)
    away = time[:, None] * np.sum(counted, axis=2)
    each = 0.5 * (away[:, 1:] + away[:, :-1]) * np.diff(time)[:, None] * going[:, 1:, None]
    own = seen[:, :, np.arange(p), np.arange(p)]
    over, under, moved = ((part * going[:, :, None]).max(axis=1) for part in (own, -own, others))
    return Answer(over - 1.0, under, moved, each.sum(axis=1))


def answered(limits: LoopLimits, laws: LinearLaw) -> Answer:
    """Return what loops answer to steps of references and loads."""
    return answer(*steps(limits, laws), limits.loop.output_scale)


STRIDES = (4, 2, 1)
"""Steps of a grid by which the speed of one output is changed."""


def best_of(
    limits: LoopLimits,
    designed: Callable[[tuple[int, ...], Any], C],
    places: Sequence[Place],
    family: str,
    count: int = 0,
    apart: Sequence[int] = (),
) -> tuple[C, Place]:
    """Return the best law of a grid, and its place there.

    A law is designed for a step of the grid for each output, ``count`` being the number of steps,
    and something else. Those of several outputs that are alike are then tried with one of them some
    steps apart, and the step of each output is changed by itself as long as that makes the law
    better, but not of a single one of a plant that is unstable.
    """
    allowed = limits.want.overshoot

    def tried(places: Iterable[Place]) -> tuple[list[tuple[C, Place]], LinearLaw, Judged]:
        found, reason = [], WorkbenchError("there is nothing to design")
        for place in places:
            try:
                found.append((designed(*place), place))
            except WorkbenchError as error:
                reason = error
        if not found:
            raise reason
        laws = stacked([law for law, _ in found])
        return found, laws, limits.judge(laws)

    def best_among(places: Iterable[Place]) -> tuple[tuple[C, Place], float, Vector, float]:
        found, laws, judged = tried(places)
        held = limits.held(judged, family)
        reached = answered(limits, chosen(laws, held))
        costs = reached.cost(allowed)
        k = int(np.argmin(costs))
        top = max(1.0, float(judged.excess[held].max()))
        return found[held[k]], float(costs[k]), reached.least, top

    def beside(steps: tuple[int, ...], *far: int) -> list[tuple[int, ...]]:
        """Return the places in the grid with one output some steps away."""
        moved = [
            tuple(s + by * (i == j) for j, s in enumerate(steps))
            for i in range(limits.outputs)
            for most in far
            for by in (-most, most)
        ]
        return [one for one in moved if all(0 <= s < count for s in one)]

    (law, place), cost, least, top = best_among(places)
    if apart and limits.outputs > 1:
        alike = sorted({steps for steps, _ in places})[:: apart[0]]
        moved = [one for steps in alike for one in beside(steps, *apart)]
        (law, place), cost, least, top = best_among([place, *((one, place[1]) for one in moved)])
    # A loop of one output that holds what grows keeps the margins that it has.
    changed = count and (limits.outputs > 1 or not limits.growing)
    for stride in STRIDES if changed else ():
        while True:
            steps, other = place
            try:
                found, laws, judged = tried([(one, other) for one in beside(steps, stride)])
            except WorkbenchError:
                break
            held = np.flatnonzero(judged.excess <= top)
            if not len(held):
                break
            costs = answered(limits, chosen(laws, held)).cost(allowed, least=least)
            k = int(np.argmin(costs))
            if costs[k] > 0.98 * cost:
                break
            (law, place), cost = found[held[k]], float(costs[k])
    return law, place


def settled_after(law: Any, linear: LinearModel, sizes: Mapping[str, float]) -> float:
    """Return the time after which steps, by the output, have settled within 2 %; inf if never.

    The law is within its ends on the linear model, and each output steps alone.
    """
    want = LoopSpecification(law.controlled, law.actuators, sample_time=law.sample_time)
    loop = loop_of(linear, law.controlled, law.actuators, law.sensors, law.sample_time)
    limits, laws = LoopLimits(loop, want), stacked([law])
    if log_radii(closed(limits.stepped, laws)[0]).max() > 1e-9:
        return math.inf
    time, seen, _ = steps(limits, laws)
    long, none = 0.0, (math.inf,) * len(law.controlled)
    paces, brakes = (getattr(law, name, ()) or none for name in ("pace", "brake"))
    leaps = getattr(law, "leap", ()) or (0.0,) * len(none)
    each = zip(law.controlled, paces, brakes, leaps, strict=True)
    for i, (name, pace, brake, leap) in enumerate(each):
        away = np.flatnonzero(np.abs(seen[0, :, i, i] - 1.0) > 0.02)
        own = float(time[min(away[-1] + 1, len(time) - 1)]) if len(away) else 0.0
        if sizes.get(name):
            far = abs(sizes[name])
            braked = 2.0 * math.sqrt(far / brake)
            moved = far / pace + min(braked, far / leap if leap else math.inf)
            long = max(long, own + moved * law.sample_time)
    return long
