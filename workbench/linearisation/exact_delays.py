"""Linear systems behind Pade functions of delays, with the delays in their place.

The functions are those of `late_by`, and stand between commands and what is left of the system.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from workbench.arrays import Matrix
from workbench.linearisation.zero_order_hold import zero_order_hold
from workbench.model.linear_system import PADE_BELOW, LinearEquations, Parts, late_by
from workbench.model.model import Model

SAME = 1e-9
"""Difference of two numbers that are the same but for rounding, as a fraction."""

_PADE_RATE = float(PADE_BELOW[0])
"""Rate of the first state of `late_by` for a delay of 1 s, in 1/s."""


class Channels(NamedTuple):
    """A system whose commands act after delays.

    Args:
        A: State matrix of what is left, shape (n, n), in SI.
        B: What each command does at each delay, shape (n, n_channels), in SI.
        C: Shape (p, n), in SI.
        D: Shape (p, n_channels), in SI.
        commands: Number of the command of each channel.
        delays: Delay of each channel, in s.
        kept: Numbers of the states that are left.
        stood_in: Times of the Pade functions, in s.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    commands: tuple[int, ...]
    delays: tuple[float, ...]
    kept: tuple[int, ...]
    stood_in: tuple[float, ...]

    def later(self, delay: float) -> Channels:
        """Return the system whose commands act later by a time in s, sooner by a negative one."""
        return self._replace(delays=tuple(t + delay for t in self.delays))

    def at_once(self, commands: int) -> Parts:
        """Return the system without its delays, of so many commands."""
        sent: Matrix = np.eye(commands)[list(self.commands)]
        return self.A, self.B @ sent, self.C, self.D @ sent


def channels_of(plant: Any) -> Channels | None:
    """Return a linear system whose delays are known, with these; None of any other.

    Args:
        plant: A `Model` or a `LinearModel`.
    """
    model = plant if isinstance(plant, Model) else plant.operating_point.model
    own = model.equations
    if not isinstance(own, LinearEquations) or not own.delays or model.effects or model.parameters:
        return None
    return without_pade(own.matrices if plant is model else (plant.A, plant.B, plant.C, plant.D))


def without_pade(system: Parts) -> Channels | None:
    """Return a system with delays in the place of their Pade functions; None if it has none."""
    A, B, C, D = system
    n, m = B.shape
    first = [f for f in range(n - 2) if _is_pade(A, B, f)]
    states = {f + i for f in first for i in range(3)}
    kept = [i for i in range(n) if i not in states]
    late = {f: -_PADE_RATE / float(A[f, f]) for f in first}
    if not first or np.any(A[np.ix_(first, kept)]):
        return None

    @cache
    def passed(f: int) -> dict[tuple[int, float], float]:
        """Return what comes out of a delay: commands after delays, and how much of each."""
        t = late[f]
        found = {(j, t): float(B[f, j]) * t / _PADE_RATE for j in range(m) if B[f, j]}
        for (j, before), share, part in taken(A[f], f):
            key = j, before + t
            found[key] = found.get(key, 0.0) + share * t / _PADE_RATE * part
        return found

    def taken(row: Matrix, own: int = -1) -> Iterator[tuple[tuple[int, float], float, float]]:
        """Yield what a row takes of delays: a command after one, of what share it is what part."""
        for f in first:
            if f != own and row[f + 2]:
                yield from ((key, row[f + 2], part) for key, part in passed(f).items())

    columns = sorted({(j, 0.0) for j in range(m)} | {key for f in first for key in passed(f)})

    def acting(rows: Matrix, direct: Matrix) -> Matrix:
        found = np.zeros((len(rows), len(columns)))
        found[:, [columns.index((j, 0.0)) for j in range(m)]] = direct
        for i, row in enumerate(rows):
            for key, share, part in taken(row):
                found[i, columns.index(key)] += share * part
        return found

    b, d = acting(A[kept], B[kept]), acting(C, D)
    used = [k for k in range(len(columns)) if np.any(b[:, k]) or np.any(d[:, k])]
    commands, delays = zip(*(columns[k] for k in used), strict=True) if used else ((), ())
    a = A[np.ix_(kept, kept)]
    times = tuple(late.values())
    return Channels(a, b[:, used], C[:, kept], d[:, used], commands, delays, tuple(kept), times)


def _is_pade(A: Matrix, B: Matrix, f: int) -> bool:
    """Tell whether three states are the Pade function of a delay."""
    if not A[f, f] < 0.0:
        return False
    a, _, _, _ = late_by((-_PADE_RATE / A[f, f],))
    own = slice(f, f + 3)
    others = np.delete(A[f + 1 : f + 3], own, axis=1)
    same = np.allclose(A[own, own], a, rtol=SAME, atol=SAME * np.abs(a).max())
    return bool(same and not np.any(others) and not np.any(B[f + 1 : f + 3]))


def held(channels: Channels, commands: int, sample_time: float) -> Parts:
    """Return the system sample by sample, for commands that are held over each.

    Args:
        commands: Number of the commands, m.
        sample_time: Time between samples, in s.

    Returns:
        F, G, C and what a command does to the outputs at once, none. The states are those that are
        left, and the commands before, the last one first, all of a sample together.

    Source: Åström and Wittenmark, Computer-Controlled Systems, 1997, section 2.3 (time delay).
    """
    own, h, m = channels, sample_time, commands
    n = len(own.A)
    counts = [math.ceil(t / h - SAME) for t in own.delays]
    long = max(counts, default=0) + 1
    F, G = np.zeros((n + m * long, n + m * long)), np.zeros((n + m * long, m))
    C = np.hstack([own.C, np.zeros((len(own.C), m * long))])
    F[:n, :n] = zero_order_hold(own.A, np.zeros((n, 1)), h)[0]
    G[n : n + m] = np.eye(m)
    F[n + m :, n : n + m * (long - 1)] = np.eye(m * (long - 1))

    def add(count: int, j: int, what: Matrix) -> None:
        # What was sent a number of samples before now, which is 0 of the command of now.
        if count:
            F[:n, n + m * (count - 1) + j] += what
        else:
            G[:n, j] += what

    for k, (j, count) in enumerate(zip(own.commands, counts, strict=True)):
        b = own.B[:, [k]]
        part = own.delays[k] - (count - 1) * h if count else 0.0
        # The older command holds on for a part of the sample, the one after it takes the rest.
        rest, after = zero_order_hold(own.A, b, h - part)
        if count:
            add(count, j, (rest @ zero_order_hold(own.A, b, part)[1])[:, 0])
        add(max(count - 1, 0), j, after[:, 0])
        # An output is read just before the commands change.
        whole = not count or part > (1.0 - SAME) * h
        C[:, n + m * (count if whole else count - 1) + j] += own.D[:, k]
    return F, G, C, np.zeros((len(own.C), m))


def foretold(F: Matrix, G: Matrix, samples: int, places: int) -> Matrix:
    """Return what the states x[k+1] = F x[k] + G u[k] are when commands on their way have acted.

    Args:
        samples: Commands that are on their way.
        places: States in front of them, n of which there are in all.

    Returns:
        Rows on the first states, the commands, the last one first, and the other states, shape
        (n, n + samples m): x[k+s] = F^s x[k] + the sum of F^i G u[k+s-1-i].
    """
    ahead, sent = np.eye(len(F)), []
    for _ in range(samples):
        sent.append(ahead @ G)
        ahead = ahead @ F
    return np.hstack([ahead[:, :places], *sent, ahead[:, places:]])
