"""Was a feedback loop closed around the machine while it was recorded?"""

from __future__ import annotations

import numpy as np

from workbench.arrays import runs
from workbench.model.units import in_time
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.innovations import MAX_SAMPLES, MEMORY, correlation, surprises
from workbench.recordings.checks.noise import white_rms
from workbench.recordings.recording import Recording

_LAGS = 24
_THRESHOLD = 5.5
"""In sigmas; 24 lags and a few signals stay below 4 by chance, nonlinear machines below 5."""
_HELD_RUN = _LAGS + 1
_FOREKNOWN = 0.5
"""Correlation with the surprises before it from which on a command is their cause, not an answer
such as that of a thermostat."""
_READ = 0.9
"""Least part of the samples of a measurement that were read, not drawn between others."""


def is_held(recording: Recording, command: str) -> bool:
    """Tell whether a command stands still for long while a measurement moves.

    A digital controller that sees the motion would answer within a few samples.
    """
    limits = {m: 20 * white_rms(recording[m]) for m in recording.measurements}
    steady = 0
    for first, last in runs(np.diff(recording[command]) == 0):
        inside = slice(first, last + 2)
        if last - first + 2 >= _HELD_RUN and any(
            np.ptp(recording[m][inside]) > limit for m, limit in limits.items()
        ):
            steady += last - first + 2
    return steady > 0.5 * len(recording)


def feedback_strength(recording: Recording, command: str, measurement: str) -> tuple[float, int]:
    """Return how strongly a command follows the surprises of a measurement, and after how long.

    The surprise of the measurement is what its own past and the command do not predict (noise and
    disturbances); that of the command is what its own past does not predict. Without feedback the
    command cannot know the surprises of the measurement before it, whatever the machine does.
    This is the correlation of residual and input at negative lags (Ljung, System Identification,
    2nd ed., section 16.6).

    Returns:
        Largest correlation in sigmas, and its lag in samples.
    """
    surprise = surprises(recording, measurement, given=(command,))
    action = surprises(recording, command)
    strength = np.abs(correlation(surprise, action, np.arange(1, _LAGS + 1)))
    best = int(np.argmax(strength))
    return float(strength[best]), best + 1


@check("loop", 110)
def check_loop(recording: Recording, _expected: Expected) -> Finding:
    """Tell whether the recording was made in open or closed loop.

    Closed if a command answers to the surprises of a measurement; open if every command stands
    still for long while a measurement moves; otherwise unknown, because a controller whose command
    carries no noise of the measurement leaves no trace. A command that does both was written later
    than it acted. What is drawn between the values of a slow sensor knows the next of them.
    """
    moving = recording.moving(recording.commands)
    measured = [
        name
        for name in recording.moving(recording.measurements)
        if np.mean(recording.valid(name)) > _READ
    ]
    if not moving or not measured or len(recording) < 10 * MEMORY:
        note = "no command that moves among the signals"
        return Finding("not checked", note, {"loop": "unknown"})
    strengths = {(c, m): feedback_strength(recording, c, m) for c in moving for m in measured}
    (command, measurement), (strength, lag) = max(strengths.items(), key=lambda kv: kv[1][0])
    values = {"strength": {f"{c}<-{m}": s for (c, m), (s, _) in strengths.items()}}
    known = strength > max(_THRESHOLD, _FOREKNOWN * np.sqrt(min(len(recording), MAX_SAMPLES)))
    if known and all(is_held(recording, c) for c in moving):
        note = (
            f"open: every command stands still while the machine moves; but {command} changes"
            f" {in_time(lag * recording.sample_time)} after {measurement} answers to it, so it was"
            " written late: 'workbench diagnose' moves it by a row, more has to be moved in the"
            " file"
        )
        return Finding("pass", note, {"loop": "open", **values}, doubt=True)
    if strength > _THRESHOLD:
        return Finding(
            "pass",
            f"closed: {command} answers to the surprises of {measurement} after "
            f"{in_time(lag * recording.sample_time)} ({strength:.1f} sigma); feedback hides "
            "part of a mismatch",
            {"loop": "closed", **values},
        )
    answer = f"no command answers to a measurement ({strength:.1f} sigma, {_THRESHOLD} would tell)"
    if all(is_held(recording, c) for c in moving):
        note = f"open: {answer}, and every command stands still while the machine moves"
        return Finding("pass", note, {"loop": "open", **values})
    note = f"{answer}, but the command moves all the time"
    return Finding("not checked", note, {"loop": "unknown", **values})
