"""What a newcomer drives a machine with: random pulses, random steps, sines, a chirp.

Units: of the command or reference.
"""

from __future__ import annotations

import numpy as np

from workbench.evaluation.foreign.machine import Array, Excitation


def pulses(largest: float, hold: tuple[float, float]) -> Excitation:
    """Return random pulses about zero, each held for a time in s; a quarter returns to it."""

    def excitation(rng: np.random.Generator, n: int, dt: float) -> Array:
        u, i = np.zeros(n), round(0.5 * hold[1] / dt)
        while i < n:
            length = max(1, round(rng.uniform(*hold) / dt))
            if rng.random() >= 0.25:
                u[i : i + length] += rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.0) * largest
            i += length
        return u[:, None]

    return excitation


def steps(low: float, high: float, hold: tuple[float, float], *, first: float) -> Excitation:
    """Return random levels between two ends, after a first one."""

    def excitation(rng: np.random.Generator, n: int, dt: float) -> Array:
        u, i = np.full(n, first), round(0.5 * hold[1] / dt)
        while i < n:
            length = max(1, round(rng.uniform(*hold) / dt))
            u[i : i + length] = rng.uniform(low, high)
            i += length
        return u[:, None]

    return excitation


def sines(largest: float, periods: tuple[float, ...]) -> Excitation:
    """Return a sum of sines of about the given periods in s, growing from rest in one period."""

    def excitation(rng: np.random.Generator, n: int, dt: float) -> Array:
        t = np.arange(n) * dt
        u = np.zeros(n)
        for period in periods:
            f = rng.uniform(0.85, 1.15) / period
            size = rng.uniform(0.7, 1.0) * largest / len(periods)
            u += size * np.sin(2 * np.pi * (f * t + rng.random()))
        grown = u * np.minimum(1.0, t / max(periods))
        return np.asarray(grown[:, None], dtype=float)

    return excitation


def chirp(largest: float, longest: float, shortest: float) -> Excitation:
    """Return a sine whose period falls from the longest to the shortest, in s."""

    def excitation(rng: np.random.Generator, n: int, dt: float) -> Array:
        t = np.arange(n) * dt
        rate = np.log(longest / shortest) / t[-1]
        turns = (np.exp(rate * t) - 1.0) / (longest * rate)
        u = rng.uniform(0.8, 1.0) * largest * np.sin(2 * np.pi * turns)
        return np.asarray(u[:, None], dtype=float)

    return excitation


def together(*parts: Excitation) -> Excitation:
    """Return several commands side by side."""

    def excitation(rng: np.random.Generator, n: int, dt: float) -> Array:
        return np.hstack([part(rng, n, dt) for part in parts])

    return excitation
