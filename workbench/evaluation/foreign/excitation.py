"""Machines as ``machines.toml`` describes them, with what a newcomer drives them with.

Commands are random pulses, random steps, sines or a chirp, in the units of the commands or
references; times are in s.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from workbench.evaluation.foreign.machine import (
    Array,
    Channel,
    Concealed,
    Loop,
    Machine,
    Rates,
    Start,
)


def _pulses(
    rng: np.random.Generator, n: int, dt: float, *, largest: float, hold: tuple[float, float]
) -> Array:
    """Return random pulses about zero, each held for a time; a quarter returns to it."""
    u, i = np.zeros(n), round(0.5 * hold[1] / dt)
    while i < n:
        length = max(1, round(rng.uniform(*hold) / dt))
        if rng.random() >= 0.25:
            u[i : i + length] += rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.0) * largest
        i += length
    return u


def _steps(
    rng: np.random.Generator,
    n: int,
    dt: float,
    *,
    low: float,
    high: float,
    hold: tuple[float, float],
    first: float,
) -> Array:
    """Return random levels between two ends, after a first one."""
    u, i = np.full(n, first), round(0.5 * hold[1] / dt)
    while i < n:
        length = max(1, round(rng.uniform(*hold) / dt))
        u[i : i + length] = rng.uniform(low, high)
        i += length
    return u


def _sines(
    rng: np.random.Generator, n: int, dt: float, *, largest: float, periods: Sequence[float]
) -> Array:
    """Return a sum of sines of about the given periods, growing from rest in one period."""
    t, u = np.arange(n) * dt, np.zeros(n)
    for period in periods:
        f = rng.uniform(0.85, 1.15) / period
        size = rng.uniform(0.7, 1.0) * largest / len(periods)
        u += size * np.sin(2 * np.pi * (f * t + rng.random()))
    return np.asarray(u * np.minimum(1.0, t / max(periods)))


def _chirp(
    rng: np.random.Generator, n: int, dt: float, *, largest: float, longest: float, shortest: float
) -> Array:
    """Return a sine whose period falls from the longest to the shortest."""
    t = np.arange(n) * dt
    rate = np.log(longest / shortest) / t[-1]
    turns = (np.exp(rate * t) - 1.0) / (longest * rate)
    return np.asarray(rng.uniform(0.8, 1.0) * largest * np.sin(2 * np.pi * turns))


_KINDS: Mapping[str, Callable[..., Array]] = {
    "pulses": _pulses,
    "steps": _steps,
    "sines": _sines,
    "chirp": _chirp,
}


def _driven(
    commands: Sequence[Mapping[str, Any]], rng: np.random.Generator, n: int, dt: float
) -> Array:
    made = []
    for command in commands:
        own = dict(command)
        made.append(_KINDS[own.pop("kind")](rng, n, dt, **own))
    return np.column_stack(made)


@cache
def _table() -> dict[str, dict[str, Any]]:
    return tomllib.loads(Path(__file__).with_name("machines.toml").read_text(encoding="utf-8"))


def machine(name: str, rates: Rates, initial: Start, loop: Loop | None = None) -> Machine:
    """Return a machine of the table with its equations."""
    entry = dict(_table()[name])
    excitations = {key: partial(_driven, own) for key, own in entry.pop("excitations").items()}
    return Machine(
        name,
        tuple(map(tuple, entry.pop("inputs"))),
        tuple(Channel(*channel) for channel in entry.pop("channels")),
        entry.pop("background"),
        tuple(Concealed(key, **own) for key, own in entry.pop("concealed").items()),
        rates,
        initial,
        excitations,
        loop=loop,
        **entry,
    )
