"""A servo axis whose recordings come from an integrator of their own.

The truth is integrated here with fixed steps of the classical Runge-Kutta method in plain numbers;
nothing of the workbench's simulation takes part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tests.diagnosis import machine_data
from tests.once import once
from workbench.arrays import Vector
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.stages import Diagnosis
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording

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

    def rates(_: float, x: Sequence[float], push: float) -> tuple[float, float]:
        speed = x[1]
        friction = 200.0 * speed + COULOMB_N * math.tanh(speed / 1e-3)
        return speed, (push - friction - (stribeck(speed) if hidden else 0.0)) / mass

    seen = machine_data.by_runge_kutta(rates, (0.0, 0.0), force.tolist(), SAMPLE_TIME, substeps)
    return seen[:, 0], seen[:, 1]


def recording(seed: int, *, hidden: bool, n: int = 700) -> Recording:
    """A recording of the axis, read in steps of 1 um as its encoder does."""
    force = excitation(n, seed)
    position = positions(force, hidden=hidden)[0]
    read = {"position [m]": 1e-6 * np.round(position / 1e-6)}
    return machine_data.recording(f"axis-{seed}", SAMPLE_TIME, {"force [N]": force}, read)


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
