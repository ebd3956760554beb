"""The paper's open-loop experiment: a pulse train on the valve, the arm runs from stop to stop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.arrays import Vector
from workbench.errors import check_range
from workbench.experiments.transits import TransitFigures, measure_transits
from workbench.model import Model
from workbench.simulation import Trajectory, simulate


@dataclass(frozen=True)
class OpenLoopExperiment:
    """A simulated open-loop experiment with the figures measured from it."""

    trajectory: Trajectory
    figures: TransitFigures

    def __str__(self) -> str:
        """Return the figures as a short aligned table."""
        return f"{self.trajectory.model.description}\n{self.figures}"


def pulse_train(
    *,
    amplitude_V: float = 0.9,
    period: float = 4.0,
    duration: float = 20.0,
    centre_V: float = 5.0,
    sample_time: float = 0.002,
) -> Vector:
    """Return the samples of a pulse train about the valve's centre, the first pulse upwards.

    Args:
        period: Period, in s; half of it up, half of it down.
        duration: Length of the train, in s.
        sample_time: Time between samples, in s.

    Returns:
        Voltages, shape (n,), in V.

    Source:
        The paper: an impulse train of +-0.9 V about +5 V, over a period of 4 s.
    """
    check_range("pulse amplitude", amplitude_V, 0.0, 5.0, "V")
    check_range("sample time", sample_time, 1e-5, 0.02, "s")
    check_range("period", period, 2 * sample_time, 1e4, "s")
    check_range("duration", duration, 2 * sample_time, 1e5, "s")
    # Counted in samples: rounded times would move an edge by a sample now and then.
    half = round(0.5 * period / sample_time)
    number = np.arange(round(duration / sample_time))
    return np.where((number // half) % 2 == 0, centre_V + amplitude_V, centre_V - amplitude_V)


def open_loop_experiment(model: Model, *, duration: float = 20.0) -> OpenLoopExperiment:
    """Run the open-loop experiment of the paper's Figure 8 on a model of the arm.

    Args:
        model: The arm, with the input ``valve`` and the state ``angle``.
        duration: Length of the experiment, in s.

    Raises:
        NumericalError: If the run cannot be trusted.

    Source:
        The paper's Figure 8: 5 +- 0.9 V, 4 s period, 3 kg, horizontal plane.
    """
    values = {q.name: q.value for q in model.parameters}
    voltage = pulse_train(duration=duration, centre_V=values.get("valve_centre", 5.0))
    run = simulate(model, voltage, sample_time=0.002)
    stops = (values.get("lower_stop", 0.0), values.get("upper_stop", math.radians(60.0)))
    figures = measure_transits(run.time, run["angle"], stops=stops)
    return OpenLoopExperiment(run, figures)
