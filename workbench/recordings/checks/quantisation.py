"""How large are the steps of the converters?"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.recording import Recording

_LEVELS_OF_A_GRID = 8
"""Fewer levels show no grid."""

MIN_LEVELS = 20
"""A signal of fewer levels is a switch or a counter, for which standing still is normal."""


def quantum(values: npt.ArrayLike) -> float:
    """Return the step, in the unit of ``values``, of which all its differences are multiples.

    The distances of neighbouring levels are compared with whole multiples of the smallest one (or
    a half, a third, ... of it, for a signal that visits few levels). The step counts if what is
    left over is small against the 0.29 steps rms that unrelated numbers leave; else, or if too few
    levels are visited, it is 0.

    Args:
        values: Samples, shape (n,), any unit.

    Example:
        >>> round(quantum(0.25 * np.round(4 * np.sin(np.arange(500.0)) * 3)), 6)
        0.25
    """
    array = np.asarray(values, dtype=float)
    levels = np.unique(array[np.isfinite(array)])
    if len(levels) < _LEVELS_OF_A_GRID:
        return 0.0
    span = levels[-1] - levels[0]
    distances = np.diff(levels)
    # Levels that differ by rounding only are one level.
    distances = distances[distances > 1e-9 * span]
    if len(distances) < _LEVELS_OF_A_GRID - 1:
        return 0.0
    smallest = float(np.median(distances[distances <= 1.4 * distances.min()]))
    near = distances[distances <= 20.5 * smallest]
    # Among unrelated numbers the closest pair is far closer than the rest.
    if len(near) < max(_LEVELS_OF_A_GRID - 1, 0.3 * len(distances)):
        return 0.0
    for part in range(1, 7):
        step = smallest / part
        for _ in range(3):
            counts = np.round(near / step)
            step = float(np.sum(near * counts) / np.sum(counts**2)) if counts.any() else step
        left = near / step - np.round(near / step)
        # Printing rounds once more; a quarter of the steps' own scatter is allowed for it.
        if float(np.sqrt(np.mean(left**2))) < 0.1:
            counts = np.round(distances / step)
            return float(distances.sum() / counts.sum())
    return 0.0


def smallest_step(values: npt.ArrayLike) -> float:
    """Return the `quantum` of samples, or a millionth of what they span, in their unit."""
    return max(quantum(values), 1e-6 * float(np.ptp(values)))


def recorded_quantum(recording: Recording, name: str) -> float:
    """Return the step of a signal from the samples that were really measured."""
    return quantum(recording[name][recording.valid(name)])


@check("quantisation", 80, fix="widen the gain of the channel, or move further, and record again")
def check_quantisation(recording: Recording, expected: Expected) -> Finding:
    """Estimate the step of every signal, and say which have fewer than 20 levels."""
    steps = {name: recorded_quantum(recording, name) for name in recording.names}
    notes, coarse = [], []
    for signal in recording.signals:
        step = steps[signal.name]
        if step:
            shown = float(signal.displayed(step) - signal.displayed(0.0))
            notes.append(f"{signal.name} {shown:.4g} {signal.display_unit}".strip())
        finite = signal.values[np.isfinite(signal.values)]
        levels = round(float(np.ptp(finite)) / step) + 1 if step else 0
        if step and levels < 20 and not signal.zero_order_hold and signal.name in expected.required:
            text = f"{signal.name} covers {levels} converter steps only"
            coarse.append(f"{text}: amplify it or move further")
    note = "steps of " + ", ".join(notes) if notes else "no steps visible"
    return Finding("pass", "; ".join([note, *coarse]), {"steps": steps})
