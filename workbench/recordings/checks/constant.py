"""Does every signal move at all?"""

from __future__ import annotations

import numpy as np

from workbench.recordings.checks.check import Outcome, unchanged
from workbench.recordings.checks.expected import Expected
from workbench.recordings.recording import Recording

_NAME = "constant signals"


def check_constant(recording: Recording, expected: Expected) -> Outcome:
    """Check that no required signal is constant.

    Args:
        recording: The recording.
        expected: What is known about it.

    Returns:
        Pass, with the constant signals that do not matter; or unfit.

    Example:
        >>> from workbench.recordings.example import example_recording
        >>> trial = example_recording(seconds=2.0)
        >>> print(check_constant(trial, Expected()).check)
        constant signals: pass (every signal changes)
    """
    still = [s for s in recording.signals if np.ptp(s.values[np.isfinite(s.values)]) == 0]
    names = tuple(s.name for s in still)
    measured = set(recording.measurements)
    problems = []
    for signal in still:
        if signal.name in expected.required:
            value = f"{signal.displayed()[0]:g} {signal.display_unit}".strip()
            why = (
                "nothing was commanded"
                if signal.role == "command"
                else "the sensor is disconnected or its channel wrong"
            )
            problems.append(f"{signal.name} reads {value} throughout: {why}")
    if measured and measured <= set(names):
        problems = problems or ["no measured signal changes"]
    if problems:
        return unchanged(recording, _NAME, "unfit", "; ".join(problems), {"constant": names})
    note = f"{', '.join(names)} constant, not required" if names else "every signal changes"
    return unchanged(recording, _NAME, "pass", note, {"constant": names})
