"""A servo axis whose recordings come from an integrator of their own.

The truth is integrated here with fixed steps of the classical Runge-Kutta method in plain numbers;
nothing of the workbench's simulation takes part.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tests.once import once
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.stages import Diagnosis
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording, Signal

Vector = npt.NDArray[np.float64]

SAMPLE_TIME = 0.005
BREAK_AWAY_N = 45.0
COULOMB_N = 20.0
STRIBECK_SPEED = 0.03


def excitation(n: int, seed: int, *, largest: float = 120.0) -> Vector:
    """Random levels of force, held for random times."""
    rng = np.random.default_rng(seed)
    force = np.zeros(n)
    k = 0
    while k < n:
        hold = int(rng.integers(30, 120))
        force[k : k + hold] = rng.uniform(-largest, largest)
        k += hold
    return force


def stribeck(speed: float) -> float:
    """Friction above the Coulomb level that decays with the speed."""
    return (
        (BREAK_AWAY_N - COULOMB_N)
        * math.exp(-((speed / STRIBECK_SPEED) ** 2))
        * math.tanh(speed / 1e-3)
    )


def positions(
    force: Vector, *, hidden: bool, mass: float = 100.0, substeps: int = 10
) -> tuple[Vector, Vector]:
    """Integrate the axis and return position and speed at every sample."""
    h = SAMPLE_TIME / substeps
    x = v = 0.0
    seen = np.empty((len(force), 2))

    def rate(speed: float, push: float) -> float:
        friction = 200.0 * speed + COULOMB_N * math.tanh(speed / 1e-3)
        return (push - friction - (stribeck(speed) if hidden else 0.0)) / mass

    for k, push in enumerate(force.tolist()):
        seen[k] = x, v
        for _ in range(substeps):
            k1 = rate(v, push)
            k2 = rate(v + 0.5 * h * k1, push)
            k3 = rate(v + 0.5 * h * k2, push)
            k4 = rate(v + h * k3, push)
            x += h * v + h * h / 6 * (k1 + k2 + k3)
            v += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return seen[:, 0], seen[:, 1]


def recording(seed: int, *, hidden: bool, n: int = 700) -> Recording:
    """A recording of the axis, read in steps of 1 um as its encoder does."""
    force = excitation(n, seed)
    position = positions(force, hidden=hidden)[0]
    position = 1e-6 * np.round(position / 1e-6)
    return Recording(
        f"axis-{seed}",
        SAMPLE_TIME * np.arange(n),
        (
            Signal("force", force, "N", role="command"),
            Signal("position", position, "m"),
        ),
    )


def observed(seed: int, *, hidden: bool, n: int = 700) -> Observed:
    """The same in the shape that the filter needs."""
    return observe(servo_axis(), recording(seed, hidden=hidden, n=n))


@once
def diagnosed(hidden: bool) -> Diagnosis:
    """Diagnose the axis with or without hidden friction, once for all tests."""
    fitted = [recording(1, hidden=hidden), recording(2, hidden=hidden)]
    return diagnose(servo_axis(), fitted, held_out(hidden), jobs=1)


def held_out(hidden: bool) -> list[Recording]:
    """Recordings that are not fitted on."""
    return [recording(3, hidden=hidden)]
