"""The start of a recording where the first measurements do not tell all states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import free_run
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.errors import check_range
from workbench.model import Model

_ITERATIONS = 12


def fitted_start(model: Model, observed: Observed, *, samples: int) -> Observed:
    """Estimate the start of a recording so that a free run meets its first measurements.

    Levenberg-Marquardt on the free-run error over the first samples, with the start that the
    recording came with, and its uncertainty, as prior. States that the measurements determine at
    once keep their value; a hidden one, such as the level of an upper tank, takes some samples to
    show.

    Args:
        samples: Number of samples to meet, 2 to the length of the recording.

    Returns:
        The recording with the estimated start; its uncertainty stays.
    """
    count = round(check_range("samples", samples, 2, len(observed.outputs)))
    if not observed.start.size:
        return observed
    first = replace(observed, inputs=observed.inputs[:count], outputs=observed.outputs[:count])
    low = np.array([q.lower for q in model.states])[: len(observed.start)]
    high = np.array([q.upper for q in model.states])[: len(observed.start)]
    rms = np.maximum(observed.start_rms, 1e-12)

    def misfit(x: Vector) -> Vector:
        run = free_run(model, replace(first, start=x))
        error = np.nan_to_num(run.error / observed.noise_rms, nan=0.0 if run.finite else 1e6)
        return np.concatenate([error.ravel(), (observed.start - x) / rms])

    x, damping = observed.start.astype(float), 1e-3
    e = misfit(x)
    for _ in range(_ITERATIONS):
        step = 1e-3 * rms
        # One-sided differences: a start on its limit must not be stepped across it.
        sides = np.where(x + step > high, -step, step)
        jacobian = np.column_stack(
            [
                (misfit(x + np.where(np.arange(len(x)) == i, sides, 0.0)) - e) / sides[i]
                for i in range(len(x))
            ]
        )
        normal = jacobian.T @ jacobian
        moved = False
        for _ in range(5):
            damped = normal + damping * np.diag(np.diag(normal))
            trial = np.clip(x - np.linalg.solve(damped, jacobian.T @ e), low, high)
            trial_e = misfit(trial)
            if trial_e @ trial_e < e @ e:
                moved = True
                break
            damping *= 10
        if not moved:
            break
        gained = e @ e - trial_e @ trial_e
        x, e, damping = trial, trial_e, max(damping / 10, 1e-9)
        if gained < 1e-3:
            break
    return replace(observed, start=x)
