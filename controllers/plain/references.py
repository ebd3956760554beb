"""How references enter a law: behind lags, past modes of its loop, or so that outputs follow lags.

The loop is the same, whichever it is, and with it what it does about loads.

Units: SI.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from controllers.linear_law import LinearLaw
from controllers.plain.limits import LoopLimits
from controllers.plain.many_loops import chosen, closed, stacked
from controllers.plain.selection import Answer, answered, steps
from workbench.arrays import Matrix

C = TypeVar("C")
D = TypeVar("D")

LAGS = (4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25)
"""Factors by which the speed of lags of the reference is changed."""


def lags(limits: LoopLimits, speeds: Sequence[float]) -> list[tuple[float, ...]]:
    """Return speeds of lags of references that are tried, of about these, in rad/s."""
    top = min(0.5 / limits.want.sample_time, limits.surest)
    return [tuple(min(k * w, top) for w in speeds) for k in LAGS]


def led(
    limits: LoopLimits, entered: Callable[[tuple[D, ...]], C], tried: Sequence[tuple[D, ...]]
) -> C:
    """Return the best of a law's ways in which references enter, one for each output.

    They change what a loop does after steps of the references, each of its own.
    """
    p = limits.outputs
    reached = answered(limits, stacked([entered(each) for each in tried]))
    best = []
    for i in range(p):
        own = [i, *range(p, reached.errors.shape[1])]
        alone = Answer(
            reached.overshoot[:, [i]],
            reached.undershoot[:, [i]],
            reached.interaction[:, [i]],
            reached.errors[:, own],
        )
        costs = alone.cost(limits.want.overshoot)
        best.append(tried[int(np.argmin(costs))][i])
    return entered(tuple(best))


def better(limits: LoopLimits, laws: Sequence[C]) -> C:
    """Return the law whose steps of the references are the best, the loops being the same."""
    costs = answered(limits, stacked(laws)).cost(limits.want.overshoot)
    return laws[int(np.argmin(costs))]


MOST_SLOW = 4
"""Slowest modes of a loop that a reference may leave alone."""

SWINGS = 2.0
"""Frequency over rate of decay of a mode that swings on: a twenty-fifth is left after a period."""


def unexcited(limits: LoopLimits, own: LinearLaw) -> list[tuple[Matrix, Matrix]]:
    """Return ways, Br and Dr, by which references leave as many modes alone as the law has states.

    With references entering by E = [B Dr; Br], a mode of left eigenvector w stays at rest if
    w E = 0; what is left free makes the outputs arrive at the references. Those that stay are the
    slowest few and else the fastest: a step shows no tail of what else the loop is for, and no
    swing of an observer.

    Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, section 5.2 (observer
    polynomial).
    """
    (A, B, C), p = limits.plants[0], limits.outputs
    n, k, m = len(A), len(own.F), B.shape[1]
    if m > 1 or not k or limits.growing:
        # Of several outputs, what is fast for one reference is not for another.
        return []
    over = closed(limits.plants[0], chosen(own, None))[0][0]
    poles, left = np.linalg.eig(over.T)
    order = np.argsort(-np.abs(poles), kind="stable")
    # What the references' gains (Dr, then Br) do to states, and to outputs at rest.
    enter = np.block([[B, np.zeros((n, k))], [np.zeros((k, m)), np.eye(k)]])
    seen = np.hstack([C[:p], np.zeros((p, k))])
    at_rest = seen @ np.linalg.solve(np.eye(n + k) - over, enter)
    found = []
    for slow in range(min(k, MOST_SLOW) + 1):
        still = np.concatenate([order[:slow], order[len(order) - k + slow :]])
        rates = np.log(poles[order[:slow]].astype(complex))
        swings = np.any(np.abs(rates.imag) > SWINGS * np.abs(rates.real))
        # Half of a pair is no mode, and what swings is not left to swing by itself.
        if abs(np.sum(poles[still].imag)) > 1e-9 or swings:
            continue
        modes = left[:, still].T @ enter
        table = np.vstack([modes.real, modes.imag, at_rest])
        size = np.maximum(np.linalg.norm(table, axis=1, keepdims=True), 1e-300)
        aim = np.vstack([np.zeros((2 * k, p)), np.eye(p)]) / size
        gains, _, rank, _ = np.linalg.lstsq(table / size, aim, rcond=1e-12)
        if rank == k + m and np.linalg.cond(gains[:m]) < 1e9:
            found.append((gains[m:], gains[:m]))
    return found


def entering(
    limits: LoopLimits, own: LinearLaw
) -> Callable[[Sequence[float], float], tuple[Matrix, Matrix]]:
    """Return what tells how references enter a law so that outputs answer them as lags do.

    After a unit step of a reference, its output is as near as can be to that of two lags of a
    speed, in rad/s, and the others stay, in the mean square of time by error; all arrive. The
    answer to what enters at each state and each command adds up to it, so that no mode of the loop
    is in the way. What it costs to enter otherwise than by the error of the output is a ratio.

    Returns:
        A function of a speed for each output, in rad/s, and that ratio, which returns Br, shape
        (n, p), and Dr, shape (m, p).

    Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, section 5.3 (model following).
    """
    F, G, H, J = own
    k, m, p, y = len(F), len(H), limits.outputs, limits.sensors
    each = np.vstack([np.eye(m, m + k), np.eye(k, m + k, m)])
    law = LinearLaw(F, np.hstack([G[:, :y], each[m:]]), H, np.hstack([J[:, :y], each[:m]]))
    time, seen, _ = steps(limits, chosen(law, None))
    size, weight = limits.loop.output_scale, np.sqrt(np.gradient(time) * time)
    seen = seen[0, :, :, : m + k] / size[:, None]
    by_error = np.vstack([J[:, y : y + p], G[:, y : y + p]])
    weighed = weight[:, None, None] * seen
    column = np.maximum(np.linalg.norm(weighed, axis=(0, 1)), 1e-300)
    table, last = weighed.reshape(-1, m + k) / column, seen[-1] / column
    arriving, free = np.linalg.pinv(last), np.linalg.svd(last)[2][p:].T

    def entered(speeds: Sequence[float], reluctance: float) -> tuple[Matrix, Matrix]:
        entry = by_error.copy()
        for i, speed in enumerate(speeds):
            asked = np.zeros((len(time), p))
            asked[:, i] = (1.0 - (1.0 + speed * time) * np.exp(-speed * time)) / size[i]
            missing = asked - seen @ by_error[:, i]
            begun = arriving @ (np.eye(p)[i] / size[i] - seen[-1] @ by_error[:, i])
            left = (weight[:, None] * missing).ravel() - table @ begun
            within = np.vstack([table @ free, reluctance * free])
            more = np.linalg.lstsq(within, np.append(left, -reluctance * begun), rcond=None)[0]
            entry[:, i] += (begun + free @ more) / column
        return entry[m:], entry[:m]

    return entered
