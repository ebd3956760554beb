"""Are the samples evenly spaced?"""

from __future__ import annotations

import numpy as np

from workbench.arrays import Vector
from workbench.model.units import in_time
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.recording import Recording
from workbench.recordings.resampling import resample

_TOLERANCE = 0.02


def jitter(time: Vector) -> float:
    """Return the scatter of the steps of a time base, as a fraction of the mean step.

    Args:
        time: Increasing instants, shape (n,), in s.
    """
    steps = np.diff(time)
    return float(np.std(steps) / np.mean(steps))


def evened(recording: Recording) -> Recording:
    """Return a recording with even steps, interpolated where its own are not."""
    return check_uniformity(recording).recording or recording


@check("uniformity", 100)
def check_uniformity(recording: Recording, expected: Expected) -> Finding:
    """Check that the samples are evenly spaced; interpolate them to an even base if not.

    Jitter is the deviation of the instants from the best even time base. Up to 2 % of a step
    passes: at the largest speed of a signal it is an error of 2 % of one sample's change.
    """
    del expected
    time = recording.time
    index = np.arange(len(time))
    step = float((time[-1] - time[0]) / (len(time) - 1))
    deviation = time - (time[0] + step * index)
    deviation = deviation - np.median(deviation)
    steps = np.diff(time)
    rms, spread = jitter(time), (float(steps.min()), float(steps.max()))
    values = {"sample_time": step, "jitter_rms": rms * step, "steps": spread}
    if np.max(np.abs(deviation)) <= _TOLERANCE * step or (
        rms < 0.5 * _TOLERANCE and spread[1] - spread[0] < _TOLERANCE * step
    ):
        return Finding(
            "pass",
            f"even steps of {in_time(step, 6)} (jitter {max(100 * rms, 0.001):.2g} % of a step)",
            values,
        )
    even = np.linspace(time[0], time[-1], len(time))
    note = (
        f"the steps vary from {in_time(spread[0], 4)} to {in_time(spread[1], 4)}"
        f" ({100 * rms:.3g} % rms); interpolated to one every {in_time(step, 6)}"
    )
    return Finding("corrected", note, values, resample(recording, times=even))
