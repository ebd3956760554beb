"""Where has the machine been? Only there can a model be judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.model.units import in_range
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.noise import white_rms
from workbench.recordings.recording import Recording, Signal

_SMOOTHED = 5.0
"""Samples over which a motion is smoothed before its direction is read."""

_MOTIONS = ("rad", "m")
"""SI units of what moves forward and backward."""


@dataclass(frozen=True)
class Directions:
    """How a motion divides between its directions.

    Args:
        signal: Name of the angle or position.
        forward: Fraction of the time with positive speed.
        backward: Fraction of the time with negative speed.
        resting: Fraction of the time with a speed that the noise hides.
    """

    signal: str
    forward: float
    backward: float
    resting: float
    reversals: int


def directions(signal: Signal, sample_time: float) -> Directions:
    """Return how a motion divides between forward, backward and rest.

    Args:
        sample_time: Step, in s.
    """
    from scipy.ndimage import gaussian_filter1d

    # A Gaussian does not ring at a sudden stop, as a sharper filter would.
    smooth = gaussian_filter1d(signal.values, _SMOOTHED, mode="nearest")
    speed = np.gradient(smooth, sample_time)
    # White noise of rms s, smoothed over w samples, changes by s / (2 pi^(1/4) w^(3/2)) per sample.
    noise = white_rms(signal.values) / (2 * np.pi**0.25 * _SMOOTHED**1.5) / sample_time
    limit = max(4 * noise, 1e-3 * float(np.abs(speed).max()))
    sign = np.where(np.abs(speed) > limit, np.sign(speed), 0.0)
    moving = sign[sign != 0]
    forward, backward, resting = (float(np.mean(sign == way)) for way in (1.0, -1.0, 0.0))
    turns = int(np.count_nonzero(np.diff(moving)))
    return Directions(signal.name, forward, backward, resting, turns)


@check("excitation", 140, fix="record a motion that covers the range of the machine")
def check_excitation(recording: Recording, expected: Expected) -> Finding:
    """Tell where the machine has been: angles or positions, directions, pressures, commands."""
    moving = [s for s in recording.signals if s.role != "reference" and np.ptp(s.values) > 0]
    motions = [s for s in moving if s.role == "measurement" and s.unit in _MOTIONS]
    turns = {s.name: directions(s, recording.sample_time) for s in motions}
    notes = []
    for signal in moving:
        low, high = in_range(
            signal.displayed([signal.values.min(), signal.values.max()]).tolist(), 4
        )
        unit = "" if signal.display_unit == "1" else f" {signal.display_unit}".rstrip()
        text = f"{signal.name} {low} to {high}{unit}"
        if signal.name in turns:
            t = turns[signal.name]
            text += (
                f" (forward {100 * t.forward:.0f} %, backward {100 * t.backward:.0f} %, at rest "
                f"{100 * t.resting:.0f} %, {t.reversals} reversals)"
            )
        notes.append(text)
    one_way = [
        t.signal for t in turns.values() if min(t.forward, t.backward) < 0.02 and t.resting < 0.98
    ]
    if one_way:
        notes.append(
            f"{', '.join(one_way)} moves one way only: friction cannot be told from a constant load"
        )
    asked = [n for n in recording.measurements if n in expected.required]
    if asked and not any(s.name in asked for s in moving):
        return Finding("unfit", "no required measurement moves")
    return Finding("pass", "; ".join(notes) or "nothing moves", {"directions": turns})
