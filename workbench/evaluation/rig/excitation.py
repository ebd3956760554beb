"""Commands in volt and references in degrees, one value per sample.

Units: volt, degrees, s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RATE = 500.0
"""Samples per second of every recording."""


def random_pulses(rng: np.random.Generator, seconds: float) -> Array:
    """Return 5 V with random pulses; a third of the holds returns to 5 V."""
    n = round(seconds * RATE)
    u = np.full(n, 5.0)
    i = round(rng.uniform(0.0, 1.5) * RATE)
    while i < n:
        hold = round(rng.uniform(0.25, 1.1) * RATE)
        if rng.random() < 0.7:
            u[i : i + hold] = 5.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.52, 1.3)
        i += hold
    return u


def random_steps(rng: np.random.Generator, seconds: float) -> Array:
    """Return a reference that jumps between random angles of 15 to 45 degrees."""
    n = round(seconds * RATE)
    r = np.full(n, 30.0)
    i = 0
    while i < n:
        hold = round(rng.uniform(0.7, 4.0) * RATE)
        r[i : i + hold] = rng.uniform(15.0, 45.0)
        i += hold
    return r


def pulse_train(seconds: float) -> Array:
    """Return the pulse train of the open-loop experiment, 5 +- 0.9 V with 4 s period."""
    t = np.arange(round(seconds * RATE)) / RATE
    return 5.0 + np.where(t % 4.0 < 2.0, 0.9, -0.9)


def sines(rng: np.random.Generator, seconds: float) -> Array:
    """Return a reference of three sines about 31 degrees."""
    parts = ((0.12, 0.2, 7.0), (0.25, 0.4, 3.0), (0.5, 0.8, 2.0))
    return _waves(rng, seconds, (29.0, 33.0), 0.6, parts)


def slow_sines(rng: np.random.Generator, seconds: float) -> Array:
    """Return a reference of two slow sines of a few degrees: the arm hardly moves."""
    return _waves(rng, seconds, (28.0, 32.0), 0.7, ((0.08, 0.12, 3.0), (0.15, 0.25, 1.0)))


def _waves(
    rng: np.random.Generator,
    seconds: float,
    middle: tuple[float, float],
    least: float,
    parts: tuple[tuple[float, float, float], ...],
) -> Array:
    """Add sines to a middle: lowest and highest frequency in Hz, and the largest size, of each."""
    t = np.arange(round(seconds * RATE)) / RATE
    r = np.full(t.size, rng.uniform(*middle))
    for low, high, size in parts:
        part = rng.uniform(least, 1.0) * size
        r += part * np.sin(2 * np.pi * (rng.uniform(low, high) * t + rng.random()))
    return r
