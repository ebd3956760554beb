"""The error that even the true model would make: a free run from a start that is read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import plant, simulate

Array = NDArray[np.float64]
_FIRST = 3
"""Measurements averaged for the start."""


def limited_errors(folder: Path) -> dict[str, float]:
    """Return the rms errors of the rig itself on held-out recordings, by output, in rad and Pa.

    The rig runs with its true parameters and without noise, from the true start except that the
    angle and the pressures are those read: what is left is the noise of the measurements and what
    it does to the start.

    Args:
        folder: A case as `workbench.evaluation.rig.cases.make_case` makes it, with its truth.
    """
    truth = json.loads((folder / "truth.json").read_text())
    quiet = {"pressure_noise": 0.0, "pressure_step": 0.0, "angle_step": 0.0, "torque_noise": 0.0}
    quiet |= {"pressure_burst": 0.0, "angle_dropout": 0.0}
    p = truth["parameters"] | quiet
    squares = []
    for path in sorted(folder.glob("validate_*.csv")):
        data = np.loadtxt(path, delimiter=",", skiprows=1)
        start = _read_start(np.array(truth["starts"][path.stem]), data, truth["parameters"])
        run = simulate.run(p, start, command=data[:, 1], seed=0).table()
        squares.append(np.mean((run[:, 2:] - data[:, 2:]) ** 2, axis=0))
    angle, first, second = np.sqrt(np.mean(squares, axis=0))
    return {
        "angle": float(np.radians(angle)),
        "pressure_1": float(1e5 * first),
        "pressure_2": float(1e5 * second),
    }


def _read_start(state: Array, data: Array, p: dict[str, float]) -> Array:
    """Move a true start to what the first measurements say, as they stand beside what is true."""
    seen = data[:_FIRST].mean(axis=0)
    # The recording without noise from the true start says what the sensors make of it.
    quiet = p | {"pressure_noise": 0.0, "pressure_step": 0.0, "angle_step": 0.0}
    exact = simulate.run(quiet, state, command=data[:_FIRST, 1], seed=0).table().mean(axis=0)
    moved = state.copy()
    moved[0] += np.radians(seen[2] - exact[2])
    for k in (0, 1):
        before = plant.gauge(state, p)[k] + p["ambient_pressure"]
        gain = p[f"pressure_gain_{k + 1}"]
        factor = 1.0 + 1e5 * (seen[3 + k] - exact[3 + k]) / gain / before
        # The temperature stays as it was.
        for name in (f"mass_{k + 1}", f"energy_{k + 1}"):
            moved[plant.INDEX[name]] *= factor
    return moved
