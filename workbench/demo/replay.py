"""Replay a recording: the model's answer to the recorded valve voltage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.model import Model
from workbench.recordings import Recording
from workbench.simulation import Trajectory, simulate

Vector = npt.NDArray[np.float64]

FIRST_SAMPLES = 10
"""Samples averaged for the angle and the pressures at the start, against sensor noise."""


@dataclass(frozen=True)
class Replay:
    """A recording and the simulation of the same command.

    Args:
        recording: The recording.
        trajectory: The simulation.

    Example:
        >>> "trajectory" in Replay.__dataclass_fields__
        True
    """

    recording: Recording
    trajectory: Trajectory

    def difference(self, name: str) -> Vector:
        """Return measured minus simulated.

        Args:
            name: Name of a measured signal.

        Returns:
            Difference, shape (n,), in the signal's SI unit.
        """
        return np.asarray(self.recording[name] - self.trajectory[name])

    def rms(self, name: str) -> float:
        """Return the root mean square of measured minus simulated.

        Args:
            name: Name of a measured signal.

        Returns:
            Root mean square, in the signal's SI unit.
        """
        return float(np.sqrt(np.nanmean(self.difference(name) ** 2)))


def replay(model: Model, recording: Recording) -> Replay:
    """Simulate a model of the arm with the valve voltage of a recording.

    The simulation runs freely from the start to the end. It starts at the mean of the first
    samples of angle and pressures, at rest, with gas at ambient temperature and the spool where
    the first voltage holds it.

    Args:
        model: The arm.
        recording: A uniformly sampled recording with ``valve``, ``angle`` and both pressures.

    Returns:
        Recording and simulation, sample by sample.

    Raises:
        WorkbenchError: If the recording lacks a signal.
        NumericalError: If the simulation cannot be trusted.

    Example:
        >>> from workbench.data_folder import shipped_data
        >>> from workbench.plants.arm import arm
        >>> from workbench.recordings import read_case
        >>> recording = read_case(shipped_data("practice-07")).hold_out["validate_open"]
        >>> replay(arm(3), recording.between(0.0, 1.0)).rms("angle") < 0.2
        True
    """
    values = {q.name: q.value for q in model.parameters}
    command = model.inputs[0]
    voltage = np.clip(recording["valve"], command.lower, command.upper)
    ambient, warm = values["ambient_pressure"], values["ambient_temperature"]
    first = {
        name: float(np.nanmean(recording[name][:FIRST_SAMPLES]))
        for name in ("angle", "pressure_1", "pressure_2")
    }
    start = {
        "spool": float(voltage[0]) - values["valve_centre"],
        "spool_speed": 0.0,
        "angle": first["angle"],
        "speed": 0.0,
        "pressure_1": first["pressure_1"] + ambient,
        "pressure_2": first["pressure_2"] + ambient,
        "temperature_1": warm,
        "temperature_2": warm,
    }
    run = simulate(model, voltage, sample_time=recording.sample_time, start=start)
    return Replay(recording, run)
