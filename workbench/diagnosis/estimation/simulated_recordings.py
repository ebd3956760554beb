"""Simulated recordings of a model, for examples and for proving that estimates are right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed, gauss_markov
from workbench.model import Model
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording, Signal
from workbench.simulation import simulate


def simulated(
    model: Model,
    inputs: npt.ArrayLike,
    *,
    sample_time: float,
    values: Mapping[str, float] | None = None,
    seed: int = 0,
    name: str = "simulated",
) -> Observed:
    """Simulate a recording as `simulated_recording` does, and observe it.

    It is returned as `observe` returns it for the model with its own values, every input held
    between samples. Inputs, sample time
    and values are in SI.
    """
    return observe(
        replace(model, traits=replace(model.traits, straight=())),
        simulated_recording(
            model, inputs, sample_time=sample_time, values=values, seed=seed, name=name
        ),
    )


def simulated_recording(
    model: Model,
    inputs: npt.ArrayLike,
    *,
    sample_time: float,
    values: Mapping[str, float] | None = None,
    seed: int = 0,
    name: str = "simulated",
) -> Recording:
    """Simulate a recording of a model, with the noise and the resolution of its sensors.

    Args:
        inputs: Inputs, shape (n, n_inputs), or (n,) for a single input, in SI.
        sample_time: Time between samples, in s.
        values: True values of some parameters by name, in SI; the model's own by default.
    """
    true = model.with_parameters(dict(values or {}))
    run = simulate(true, inputs, sample_time=sample_time, check=False)
    rng = np.random.default_rng(seed)
    signals = [
        Signal(q.name, column, q.unit, role="command")
        for q, column in zip(model.inputs, run.inputs.T, strict=True)
    ]
    for quantity, column in zip(model.outputs, run.outputs.T, strict=True):
        white = np.hypot(quantity.noise_rms, quantity.relative_noise_rms * column)
        read = column + white * rng.normal(size=len(column))
        rms, time = quantity.correlated_noise_rms, quantity.noise_correlation_time
        if rms > 0.0 and time > 0.0:
            read += gauss_markov(len(read), rms, time, sample_time, rng)
        if quantity.resolution:
            read = quantity.resolution * np.round(read / quantity.resolution)
        signals.append(Signal(quantity.name, read, quantity.unit))
    return Recording(name, run.time, tuple(signals))


def pushes(samples: int, *, largest: float, hold: int = 40, seed: int = 0) -> Vector:
    """Return random levels up to ``largest``, in its unit, shape (samples,), each held a while."""
    levels = np.random.default_rng(seed).uniform(-largest, largest, samples // hold + 1)
    return np.repeat(levels, hold)[:samples]


def simulated_axis(seed: int = 0, *, samples: int = 800) -> Observed:
    """Simulate a recording of the servo axis with a mass of 100 kg instead of 95 kg.

    Args:
        samples: Number of samples, 10 ms apart.
    """
    forces = pushes(samples, largest=200.0, seed=seed)
    true = {"mass": 100.0, "offset": 2.0}
    return simulated(servo_axis(), forces, sample_time=0.01, values=true, seed=seed)
