"""The pace of references that suits steps beyond the ends of commands; the loop is the same.

The linear plant is run through steps of each output, up and down, of half of what the commands are
just enough for, and of up to ten times that, as far as they can hold it there; commands that change
slowly do so. Of paces and brakes (`controllers.reference.paced`), the best is that whose
errors and overshoots are least.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar, cast

import casadi as ca
import numpy as np

from controllers.arithmetic import SYMBOLS
from controllers.named_state import flat, restored
from controllers.plain.limits import LoopLimits
from controllers.plain.many_loops import stacked
from controllers.plain.plain_law import PlainLaw
from controllers.plain.selection import OVERSHOT, answered
from controllers.reference.paced import paced
from workbench.arrays import Matrix, Vector
from workbench.computing.buffered import Buffered
from workbench.linearisation.time_scales import reach_of

L = TypeVar("L", bound=PlainLaw)
P = TypeVar("P")


def at_pace(limits: LoopLimits, law: P) -> P:
    """Return the law with the best pace and brake of each reference."""
    found = np.array([_pace(limits, law, i) for i in range(limits.outputs)])
    if np.all(found == FREE):
        return law
    pace, brake, leap = (tuple(part.tolist()) for part in found.T)
    return cast(P, replace(cast(Any, law), pace=pace, brake=brake, leap=leap))


def best_at_pace(limits: LoopLimits, laws: Sequence[L]) -> L:
    """Return the law, at its pace, whose steps are the best, the loops being the same.

    Small steps and those as far as an output goes count alike; overshoots of these by their third
    power: what is no faster for them is no better.
    """
    small = answered(limits, stacked(laws)).cost(limits.want.overshoot)
    tried = [at_pace(limits, law) for law in laws]
    large = np.zeros(len(laws))
    for i, name in enumerate(limits.loop.measured):
        room = next((found for law in laws if len(found := _large(limits, law, i)[0])), None)
        if room is None:
            continue
        far = reach_of(limits.loop.linear, name) * np.array([-1.0, -0.25, 0.25, 1.0])
        size = np.clip(far, room.min(), room.max())
        own = [np.array([_of(law, i)]) for law in tried]
        each = [_paced(limits, law, i, size, at) for law, at in zip(tried, own, strict=True)]
        large += _cost(np.concatenate(each, axis=1))
    return tried[int(np.argmin(small * large if large.any() else small))]


def _of(law: PlainLaw, i: int) -> tuple[float, float, float]:
    """Return pace, brake and leap of a reference."""
    return (law.pace[i], law.brake[i], law.leap[i]) if law.pace else FREE


def swing(limits: LoopLimits, law: Any) -> float:
    """Return the largest swing of a command after a step of an output, over scales, a ratio."""
    loop, m = limits.loop, len(limits.loop.actuators)
    swings = [np.abs(_freely(limits, law, i)[1][:, :m]) for i in range(limits.outputs)]
    each = [own.max(axis=0) / loop.command_scale for own in swings]
    return float(np.max(np.array(each) * loop.output_scale[:, None]))


FREE = (math.inf, math.inf, 0.0)
"""Pace, brake and leap of a reference that none of them holds back."""


def _pace(limits: LoopLimits, law: Any, i: int) -> tuple[float, float, float]:
    """Return the best pace, brake and leap of a reference."""
    size, paces = _large(limits, law, i)
    if not len(size):
        return FREE
    if not isinstance(law, PlainLaw):
        # Of those that solve something, most need no pace.
        _, penalty, left = _paced(limits, law, i, size, paces[:1])[:, 0]
        if np.all(penalty < 1.1):
            return FREE
        # What is only slow, at the ends of commands, no pace makes any faster.
        size = size[(left < SETTLED) | (penalty >= 1.1)]
    found = _paced(limits, law, i, size, paces)
    even, braked = (np.isfinite(paces[:, k]) for k in range(2))
    if even.any() and braked.any():
        # The pace that suits best is slow for large steps: beyond it, they may brake.
        leap = paces[even][np.argmin(_cost(found)[even]), 0]
        more = np.array([(math.inf, brake, leap) for brake in paces[braked, 1]])
        paces = np.vstack([paces, more])
        found = np.concatenate([found, _paced(limits, law, i, size, more)], axis=1)
    total = _cost(found)
    best = int(np.argmin(total))
    pace, brake, leap = paces[best if total[best] < 0.9 * total[0] else 0].tolist()
    return pace, brake, leap


LARGE = (0.5, 3.0, 10.0)
"""Steps of which the reference's pace is chosen, over that which the command is just enough for."""

BEYOND = 10.0
"""Steps of a sliding mode that are tried too, over the reach of an output, where commands hold it:
beyond its layer it is another law than within."""

PACES = (3.0, 1.5, 0.75, 0.4)
"""Paces that are tried: what the command is just enough for, up or down, in the time of a small
step's rise."""

SLOW = (4.0, 2.0, 1.0)
"""Paces that are tried over that which the commands' slews let them follow."""

BRAKES = (8.0, 4.0, 2.0, 1.0, 0.5)
"""Brakes that are tried, over that which takes what the command is just enough for in the time of a
small step's rise."""

LEFT = 0.8
"""Part of the commands' room that large steps are tried with: far from rest a plant takes more."""


def _large(limits: LoopLimits, law: Any, i: int) -> tuple[Vector, Matrix]:
    """Return steps of an output beyond the commands' ends, and what is tried, shape (n, 3).

    There are none where nothing ends, or only small steps can be held.
    """
    loop, solved = limits.loop, not isinstance(law, PlainLaw)
    (low, _), (high, _) = _moving(limits)
    none = np.full(len(low), math.inf)
    fixed = np.array([loop.lower, loop.upper]) - loop.linear.u0
    ends = np.hstack([fixed, [low, none], [-none, high]]) * (1.0 if solved else LEFT)
    y, asked = _freely(limits, law, i)
    peak, held = asked[np.argmax(np.abs(asked), axis=0), np.arange(asked.shape[1])], asked[-1]
    if not (np.isfinite(ends).any() and np.all(np.isfinite(peak)) and np.any(peak)):
        return np.zeros(0), np.zeros((0, 3))
    sizes, enough, reach = set(), set(), reach_of(loop.linear, loop.measured[i])
    # What ends alike on both sides answers alike to both.
    signs = (1.0,) if np.array_equal(ends[0], -ends[1]) else (-1.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        for sign in signs:
            least, most = (
                float(np.nanmin(np.abs(np.where(sign * u > 0.0, *ends[::-1]) / u)))
                for u in (peak, held)
            )
            if 0.0 < least < 0.9 * most:
                large = [share * least for share in LARGE]
                large += [far for far in (0.25 * reach, reach) if far > large[-1]]
                slides = getattr(law, "reach", 0.0) > 0.0
                large += [BEYOND * reach] if slides and BEYOND * reach < 0.9 * most else []
                sizes |= {sign * min(far, 0.9 * most) for far in large}
                enough.add(least)
    # A ramp moves the commands as fast as a step of its pace moves them far.
    far = np.maximum(np.abs(peak[: len(low)]), 1e-300)
    slow = limits.want.sample_time * float(np.min(loop.slew / far))
    if slow < math.inf:
        sizes |= set() if sizes else {sign * loop.output_scale[i] for sign in signs}
    if not sizes:
        return np.zeros(0), np.zeros((0, 3))
    size, arrived = np.array(sorted(sizes)), max(int(np.argmax(y > 0.63)), 1)
    tried = {share * least / arrived for least in enough for share in PACES}
    tried |= {share * slow for share in SLOW if slow < math.inf}
    paces = [(pace, math.inf, 0.0) for pace in (math.inf, *sorted(tried, reverse=True))]
    brakes = [least / arrived**2 for least in enough]
    brakes += [slow / arrived] if slow < math.inf else []
    paces += [(math.inf, share * brake, 0.0) for brake in brakes for share in BRAKES]
    return size, np.array(paces)


def _cost(found: Matrix) -> Vector:
    """Return what steps come to, as of `_paced`, overshoots by their third power."""
    errors, penalty, _ = found
    return np.asarray(np.sum(errors / errors.min(axis=0) * penalty**3, axis=1))


def _paced(limits: LoopLimits, law: Any, i: int, size: Vector, paces: Matrix) -> Matrix:
    """Return errors of steps in samples squared, penalties for too much, and what is left.

    That is in the end, as a fraction of the step; all by pace and size, shape (3, n, n_sizes).
    """
    step, pace = np.tile(size, len(paces)), np.repeat(paces.T, len(size), axis=1)
    run = _run if isinstance(law, PlainLaw) else _solved
    with np.errstate(over="ignore", invalid="ignore"):
        seen = run(limits, law, i, step, pace) / step
    own, scale = np.arange(limits.outputs) == i, limits.loop.output_scale
    # What runs away is too much, whatever it comes to.
    away = np.clip(np.nan_to_num(seen - own[:, None], nan=1e9), -1e9, 1e9)
    counted = np.abs(away) * (scale[i] / scale)[:, None]
    errors = np.tensordot(np.arange(len(away)), counted.sum(axis=1), 1)
    over = np.maximum(away[:, i].max(axis=0) - limits.want.overshoot, 0.0)
    under = np.maximum(-1.0 - away[:, i].min(axis=0) - limits.want.overshoot, 0.0)
    moved = np.where(own[:, None], 0.0, counted).max(axis=(0, 1))
    penalty = (1.0 + OVERSHOT * over) * (1.0 + under) * (1.0 + moved)
    left = np.abs(away[-1, i])
    return np.array([errors, penalty, left]).reshape(3, len(paces), -1)


MOST_SAMPLES = 2000, 20000
"""Samples for which large steps are looked at, of what settles soon and of what takes longest."""

AS_LONG = 10
"""As many times as long as a small step takes to settle."""

LOOKED_AT, SOLVED_AT, SETTLED = 100, 50, 0.01
"""Samples after which a step, also of a law that solves something, has settled if it is as near as
this to where it goes in all of them, as a fraction of it."""


def _freely(limits: LoopLimits, law: Any, i: int) -> tuple[Vector, Matrix]:
    """Return an output, shape (n,), until its unit step has settled, and what is held against ends.

    That is, shape (n, 3 m), the commands, and the same over what their lower ends and their upper
    ends move by.
    """
    (A, B, C), (F, G, H, J) = limits.plants[0], law.around_rest()
    p, entry = limits.sensors, [limits.sensors + i]
    # The reference, which stays, is the last state.
    command = np.hstack([J[:, :p] @ C, H, J[:, entry]])
    over = np.vstack([B @ command, np.hstack([G[:, :p] @ C, F, G[:, entry]])])
    over[: len(A), : len(A)] += A
    over = np.vstack([over, np.eye(1, over.shape[1], len(over))])
    states = np.eye(len(over))[:, -1:]
    while states.shape[1] < MOST_SAMPLES[1]:
        states, over = np.hstack([states, over @ states]), over @ over
    states = states[:, : MOST_SAMPLES[1]]
    x = states[: len(A)]
    u, y = command @ states, C[i] @ x
    asked = np.vstack([u, *(u - slopes @ x for _, slopes in _moving(limits))])
    near = np.all(np.abs(y.reshape(-1, LOOKED_AT) - 1.0) < SETTLED, axis=1)
    end = LOOKED_AT * (int(np.argmax(near)) + 1) if near.any() else MOST_SAMPLES[1]
    return y[:end], asked[:, :end].T


def _moving(limits: LoopLimits) -> list[tuple[Vector, Matrix]]:
    """Return the lower and upper ends of commands that move with states: from rest, and slopes."""
    n, own = len(limits.plants[0][0]), limits.loop.linear
    if own.ends is None:
        far = np.full(own.B.shape[1], math.inf)
        return [(sign * far, np.zeros((len(far), n))) for sign in (-1.0, 1.0)]
    # States count in their scales, and commands on their way are states too.
    slopes = own.ends[..., 1:] * own.state_scales
    slopes = np.pad(slopes, ((0, 0), (0, 0), (0, n - len(own.A))))
    return list(zip(own.ends[..., 0], slopes, strict=True))


def _run(limits: LoopLimits, law: PlainLaw, i: int, step: Vector, pace: Matrix) -> Matrix:
    """Return outputs, shape (n_samples, n_outputs, n), after steps of an output from rest.

    The pace, shape (3, n), is that, the brake and the leap.
    """
    loop, (A, B, C), p = limits.loop, limits.plants[0], limits.outputs
    law = replace(
        law,
        rest=(0.0,) * len(law.rest),
        rest_output=(0.0,) * limits.sensors,
        lower=tuple((LEFT * (loop.lower - loop.linear.u0)).tolist()),
        upper=tuple((LEFT * (loop.upper - loop.linear.u0)).tolist()),
        curves=(),
        fading=(),
        pace=(),
        brake=(),
        leap=(),
    )
    example = law.initial_state((0.0,) * limits.sensors)
    x, z, r, v = (ca.SX.sym("", n) for n in (len(A), len(flat(example)), 1, 1))
    to, most, brake, leap = (ca.SX.sym("", 1) for _ in range(4))
    moved = paced(to - r, v, most, brake, leap, SYMBOLS)
    y, now = ca.mtimes(C, x), r + moved
    asked = tuple(now if j == i else 0.0 for j in range(p))
    seen = tuple(ca.vertsplit(y))
    u, following, _ = law.law(restored(example, ca.vertsplit(z)), seen, asked, SYMBOLS)
    low, high = (LEFT * end + ca.mtimes(slopes, x) for end, slopes in _moving(limits))
    u = ca.fmin(ca.fmax(ca.vcat(u), low), high)
    after = ca.vertcat(ca.mtimes(A, x) + ca.mtimes(B, u), *flat(following), now, moved)
    entering = [ca.vertcat(x, z, r, v), ca.vertcat(to, most, brake, leap)]
    leaving, count = [ca.densify(after), ca.densify(y[:p])], len(step)
    sample = Buffered(ca.Function("sample", entering, leaving).map(count).expand())
    # What has no end takes long to reach one.
    told = np.array([step, *np.minimum(pace, 1e9 * np.abs(step))])
    most = int(np.clip(AS_LONG * len(_freely(limits, law, i)[0]), *MOST_SAMPLES))
    state, outputs = np.zeros((after.numel(), count)), np.zeros((most, p, count))
    for k in range(most):
        state, outputs[k] = sample(state, told)
        block = outputs[max(0, k + 1 - LOOKED_AT) : k + 1, i]
        if (k + 1) % LOOKED_AT == 0 and np.all(np.abs(block / step - 1.0) < SETTLED):
            break
    return outputs[: k + 1]


def _solved(limits: LoopLimits, law: Any, i: int, step: Vector, pace: Matrix) -> Matrix:
    """Return the same of an MPC, whose programs of all steps are solved sample by sample."""
    loop, (A, B, C), count = limits.loop, limits.plants[0], len(step)
    rest, own = loop.shown.y0[:, None], np.eye(limits.outputs)[:, [i]]
    asked, paces = rest[: limits.outputs] + own * step, np.where(own > 0.0, pace[0], math.inf)
    law = replace(law, pace=(math.inf,) * limits.outputs)
    brakes, leaps = np.where(own > 0.0, pace[1], math.inf), np.where(own > 0.0, pace[2], 0.0)
    start = law.initial_state(tuple(rest[:, 0].tolist()))
    state = type(start)(*(np.tile(part[:, None], count) for part in start))
    x, left = np.zeros((len(A), count)), np.arange(count)
    full = np.array([[1.0 / curve.gain_at_rest] for curve in law.curves])
    moving = _moving(limits)
    outputs = np.zeros((MOST_SAMPLES[0], limits.outputs, count))
    for k in range(MOST_SAMPLES[0]):
        y = C @ x
        outputs[k][:, left] = y[: limits.outputs]
        now = [tuple(part[:, left]) for part in (paces, brakes, leaps)]
        law = replace(law, **dict(zip(("pace", "brake", "leap"), now, strict=True)))
        _, state = law.stepped(state, rest + y, asked[:, left])
        low, high = (end[:, None] + slopes @ x for end, slopes in moving)
        x = A @ x + B @ np.clip(full * state.opening, low, high)
        if k % SOLVED_AT == SOLVED_AT - 1:
            late = outputs[k + 1 - SOLVED_AT : k + 1, i] / step
            on = np.any(np.abs(late[:, left] - 1.0) >= SETTLED, axis=0)
            # What has settled stays as it is.
            outputs[k + 1 :, :, left[~on]] = outputs[k][:, left[~on]]
            left, x = left[on], x[:, on]
            state = type(state)(*(part[:, on] for part in state))
            if not len(left):
                break
    return outputs[: k + 1]
