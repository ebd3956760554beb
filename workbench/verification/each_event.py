"""What each change of the plant and each disturbance does to a controlled output."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.verification.closed_loop_run import Run
from workbench.verification.responses import steady_error

WINDOW = 200
"""Samples at the end of the time until the next event or step over which what is left is taken."""


class EventResponse(NamedTuple):
    """What one change or disturbance did.

    Args:
        time: When it began, in s.
        peak: Largest error until the next event or step, in the unit of the output.
        left: Mean error at the end of that time, as a magnitude, in the unit of the output.
    """

    output: str
    time: float
    what: str
    peak: float
    left: float


def response_to_each_event(run: Run) -> tuple[EventResponse, ...]:
    """Return what each change and disturbance during a run did to each controlled output."""
    events = sorted(
        [
            *((c.time, c.parameter) for c in run.scenario.changes),
            *((d.time, d.port) for d in run.scenario.disturbances if d.time > 0.0),
        ]
    )
    ends = [*(time for time, _ in events), run.scenario.duration][1:]
    found = []
    for name in run.controlled:
        error = run.references[name] - run[name]
        steps = [time for time, *_ in run.scenario.references[name].changes]
        for (begin, what), last in zip(events, ends, strict=True):
            # The error of a step is none of what happened before it.
            end = min([last, *(time for time in steps if time > begin)])
            part = (run.time >= begin) & (run.time < end)
            if part.sum() < 2:
                continue
            window = WINDOW * run.scenario.sample_time
            left = steady_error(run.time[part], error[part], window=window)
            peak = float(np.max(np.abs(error[part])))
            found.append(EventResponse(name, begin, what, peak, left.value))
    return tuple(found)
