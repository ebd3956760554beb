"""Does every signal move at all?"""

from __future__ import annotations

import numpy as np

from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.recording import Recording


@check(
    "constant signals",
    30,
    foundation=True,
    fix="check the cable and the channel, and that the column is the right one",
)
def check_constant(recording: Recording, expected: Expected) -> Finding:
    """Check that something was measured and that no required measurement is constant.

    A constant input is what the machine really got, and allowed.
    """
    still = [s for s in recording.signals if np.ptp(s.values[np.isfinite(s.values)]) == 0]
    names = tuple(s.name for s in still)
    values = {"constant": names}
    measured = set(recording.measurements)
    if not measured:
        return Finding("unfit", "the recording holds no measurement", values)
    notes, problems = [], []
    for signal in still:
        value = f"{signal.displayed()[0]:g} {signal.display_unit}".strip()
        if signal.name not in measured:
            notes.append(f"{signal.name} is {value} throughout")
        elif signal.name in expected.required:
            problems.append(
                f"{signal.name} reads {value} throughout: the sensor is disconnected or its channel"
                " wrong; leave it out if it is not needed"
            )
        else:
            notes.append(f"{signal.name} constant, not required")
    if measured <= set(names):
        problems = problems or ["no measured signal changes"]
    if problems:
        return Finding("unfit", "; ".join(problems), values)
    return Finding("pass", "; ".join(notes) or "every signal changes", values)
