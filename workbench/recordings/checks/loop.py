"""Was a feedback loop closed around the machine while it was recorded?"""

from __future__ import annotations

import numpy as np

from workbench.recordings.checks.check import Outcome, unchanged
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.innovations import MAX_SAMPLES, MEMORY, correlation, innovations
from workbench.recordings.recording import Recording

_NAME = "loop"
_LAGS = 24
_THRESHOLD = 5.5
"""In sigmas; 24 lags and a few signals stay below 4 by chance, nonlinear machines below 5."""


def feedback_strength(recording: Recording, command: str, measurement: str) -> tuple[float, int]:
    """Return how strongly a command follows the surprises of a measurement, and after how long.

    The surprise of the measurement is what its own past and the command do not predict (noise and
    disturbances); that of the command is what its own past does not predict. Without feedback the
    command cannot know the surprises of the measurement before it, whatever the machine does.
    This is the correlation of residual and input at negative lags (Ljung, System Identification,
    2nd ed., section 16.6).

    Args:
        recording: Uniformly sampled recording.
        command: Name of a command.
        measurement: Name of a measured signal.

    Returns:
        Largest correlation in sigmas, and its lag in samples.
    """
    u = recording[command][:MAX_SAMPLES]
    y = recording[measurement][:MAX_SAMPLES]
    surprise = innovations(y, [y, u])
    action = innovations(u, [u])
    strength = np.abs(correlation(surprise, action, range(1, _LAGS + 1)))
    best = int(np.argmax(strength))
    return float(strength[best]), best + 1


def check_loop(recording: Recording, expected: Expected) -> Outcome:
    """Tell whether the recording was made in open or closed loop.

    Args:
        recording: Uniformly sampled recording.
        expected: What is known about it (not used).

    Returns:
        Pass; ``values["loop"]`` is ``open``, ``closed`` or ``unknown``.
    """
    del expected
    moving = [c for c in recording.commands if np.ptp(recording[c]) > 0]
    measured = [m for m in recording.measurements if np.ptp(recording[m]) > 0]
    if not moving or not measured or len(recording) < 10 * MEMORY:
        return unchanged(
            recording, _NAME, "pass", "cannot tell: no command that moves among the signals",
            loop="unknown",
        )
    strengths = {
        (c, m): feedback_strength(recording, c, m) for c in moving for m in measured
    }
    (command, measurement), (strength, lag) = max(strengths.items(), key=lambda kv: kv[1][0])
    values = {"strength": {f"{c}<-{m}": s for (c, m), (s, _) in strengths.items()}}
    if strength > _THRESHOLD:
        return unchanged(
            recording, _NAME, "pass",
            f"closed: {command} answers to the surprises of {measurement} after "
            f"{1e3 * lag * recording.sample_time:.3g} ms ({strength:.1f} sigma); feedback hides "
            "part of a mismatch",
            loop="closed", **values,
        )
    return unchanged(
        recording, _NAME, "pass",
        f"open: no command answers to a measurement (at most {strength:.1f} sigma, {_THRESHOLD} "
        "would tell)", loop="open", **values,
    )
