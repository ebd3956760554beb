"""What a machine would give: its equations in plain numbers, and columns as recordings or files.

Nothing of the workbench's simulation takes part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from workbench.arrays import Vector
from workbench.recordings.recording import Recording, Signal

Columns = Mapping[str, npt.ArrayLike]
"""Values in SI by a heading as in a file, ``"flow [m3/s]"``."""


def recording(name: str, time: npt.ArrayLike, commands: Columns, read: Columns) -> Recording:
    """Return a recording at some instants, or with a sample every so many, in s."""
    signals = []
    for role, columns in (("command", commands), ("measurement", read)):
        for heading, values in columns.items():
            own, _, unit = heading.partition(" ")
            signals.append(Signal(own, np.asarray(values), unit.strip("[]"), role=role))
    instants = time if np.ndim(time) else time * np.arange(len(signals[0].values))
    return Recording(name, instants, tuple(signals))


def file(path: Path, columns: Columns, digits: int = 9) -> Path:
    """Write columns as a file."""
    rows = np.column_stack([np.asarray(values) for values in columns.values()])
    np.savetxt(path, rows, f"%.{digits}g", ",", header=",".join(columns), comments="")
    return path


def held(
    rates: Callable[..., Sequence[float]],
    x: npt.ArrayLike,
    inputs: Sequence[Vector],
    step: float,
    **known: Any,
) -> Vector:
    """Return states at each sample of ``dx/dt = rates(t, x, *inputs)``, shape (n, n_x), by SciPy.

    Each input is held for a step, in s.
    """
    states = [np.asarray(x, dtype=float)]
    known = {"rtol": 1e-7, "atol": 1e-9} | known
    for k, u in enumerate(zip(*inputs, strict=True)):
        run = solve_ivp(rates, (k * step, k * step + step), states[-1], args=u, **known)
        states.append(run.y[:, -1])
    return np.array(states[:-1])


def by_runge_kutta(
    rates: Callable[[float, Sequence[float], float], Sequence[float]],
    x: Sequence[float],
    inputs: Iterable[float],
    step: float,
    parts: int,
) -> Vector:
    """Return what `held` does beside one input, by the classical method in parts of a step."""
    h, t, states = step / parts, 0.0, []

    def moved(slopes: Sequence[float], by: float) -> list[float]:
        return [a + by * k for a, k in zip(x, slopes, strict=True)]

    for u in inputs:
        states.append(x)
        for _ in range(parts):
            a = rates(t, x, u)
            b = rates(t + 0.5 * h, moved(a, 0.5 * h), u)
            c = rates(t + 0.5 * h, moved(b, 0.5 * h), u)
            d = rates(t + h, moved(c, h), u)
            slopes = [p + 2.0 * q + 2.0 * r + s for p, q, r, s in zip(a, b, c, d, strict=True)]
            x, t = moved(slopes, h / 6.0), t + h
    return np.array(states)
