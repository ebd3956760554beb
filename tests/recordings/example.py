"""A made-up recording, for examples and for trying the checks on something known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from tests.diagnosis.machine_data import recording
from workbench.errors import check_range
from workbench.recordings.recording import Recording, Signal, Vector

Read = Callable[..., Recording]


def _pulses(rng: np.random.Generator, n: int, hold: int) -> Vector:
    levels = 5.0 + rng.uniform(-1.2, 1.2, n // hold + 2)
    lengths = rng.integers(hold // 2, 2 * hold, n // hold + 2)
    pulses: Vector = np.repeat(levels, lengths)
    return np.concatenate([pulses, np.full(max(0, n - len(pulses)), levels[-1])])[:n]


def example_recording(
    *, seconds: float = 8.0, closed_loop: bool = False, seed: int = 0
) -> Recording:
    """Make a recording of two chambers that push a damped mass against each other.

    A valve fills one chamber and vents the other (500 Hz, spool delay of two samples); pressures
    carry 6 mbar of noise and steps of 2.4 mbar, the angle steps of 0.002 deg. In closed loop a
    controller with filtered derivative follows random steps of the angle.

    Args:
        seconds: Duration, in s, 2 to 600.
        closed_loop: Whether the valve answers to the measured angle.
        seed: Seed of the random pulses and the noise.

    Returns:
        Signals ``valve`` (V), ``angle`` (rad), ``pressure_1`` and ``pressure_2`` (Pa, gauge).

    Raises:
        WorkbenchError: If the duration is outside its range.
    """
    check_range("seconds", seconds, 2.0, 600.0, "s")
    rng = np.random.default_rng(seed)
    dt, n = 0.002, round(seconds / 0.002)
    goal = _pulses(rng, n, 150)
    valve = np.full(n, 5.0)
    angle, p1, p2 = np.zeros(n), np.full(n, 3e5), np.full(n, 3e5)
    read = np.zeros(n)
    speed, turning = 0.0, 0.0
    for k in range(n):
        read[k] = np.deg2rad(0.002 * np.round(np.rad2deg(angle[k]) / 0.002 + 0.02 * rng.normal()))
        command = goal[k]
        if closed_loop:
            turning += 0.5 * ((read[k] - read[k - 1]) / dt - turning) if k else 0.0
            command = 5.0 + 4.0 * (0.25 * (goal[k] - 5.0) - read[k]) - 0.8 * turning
        valve[k] = 10 / 4096 * np.round(np.clip(command, 0.0, 10.0) * 4096 / 10)
        if k + 1 == n:
            break
        flow = 4e5 * (valve[max(0, k - 2)] - 5.0)
        p1[k + 1] = p1[k] + dt * (flow - 2.0 * (p1[k] - 3e5) - 5e4 * speed)
        p2[k + 1] = p2[k] + dt * (-flow - 2.0 * (p2[k] - 3e5) + 5e4 * speed)
        torque = 1e-4 * (p1[k] - p2[k]) - 3.0 * speed - 60.0 * angle[k]
        speed += dt * torque / 0.5
        angle[k + 1] = angle[k] + dt * speed
    sensed = [240.0 * np.round((p + 600.0 * rng.normal(size=n)) / 240.0) for p in (p1, p2)]
    return Recording(
        "example",
        dt * np.arange(n, dtype=float),
        (
            Signal("valve", valve, "V", role="command"),
            Signal("angle", read, "rad", display_unit="deg"),
            Signal("pressure_1", sensed[0], "Pa", kind="gauge pressure", display_unit="bar"),
            Signal("pressure_2", sensed[1], "Pa", kind="gauge pressure", display_unit="bar"),
        ),
        source="made up",
    )


recorded = partial(recording, "recorded")
"""Makes a recording of columns; see `recording`."""


def with_values(recording: Recording, name: str, values: npt.ArrayLike) -> Recording:
    """Return the recording with other samples of one signal."""
    return recording.with_signal(replace(recording.signal(name), values=np.asarray(values)))
