"""The steps, changes and disturbances of a trajectory one by one, each until the next begins.

Units: s; values in that of the output.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from workbench.arrays import Vector
from workbench.verification.closed_loop_run import Run
from workbench.verification.responses import Value, overshoot, settling_time, steady_error

_ROUNDING = 1e-9
"""A time computed as k h may fall short of its decimal value by one rounding, s."""


class StepPart(NamedTuple):
    """One step of a reference, and the samples that show its response."""

    begin: float
    initial: float
    final: float
    part: slice


class StepResponse(NamedTuple):
    """How one step of a run was followed.

    Args:
        settling: Settling time, in s, or NaN with a reason.
        overshoot: How far the output goes past the reference, a fraction of the step.
        planned: Time after which the plan of the controller itself stays within the band, in s;
            NaN if it plans no move.
    """

    output: str
    begin: float
    initial: float
    final: float
    settling: Value
    overshoot: float = math.nan
    planned: float = math.nan

    def table(self) -> dict[str, Any]:
        """Return the response as plain numbers and words, None where there is no number."""
        return {
            "output": self.output,
            "begin_s": self.begin,
            "from": self.initial,
            "to": self.final,
            "settling_s": None if math.isnan(self.settling.value) else self.settling.value,
            "reason": self.settling.reason,
            "overshoot": None if math.isnan(self.overshoot) else self.overshoot,
            "planned_s": None if math.isnan(self.planned) else self.planned,
        }

    @classmethod
    def from_table(cls, row: Mapping[str, Any]) -> StepResponse:
        """Return the response that a table describes."""
        seconds, over, plan = (
            math.nan if row.get(key) is None else float(row[key])
            for key in ("settling_s", "overshoot", "planned_s")
        )
        settling = Value(seconds, row["reason"])
        return cls(row["output"], row["begin_s"], row["from"], row["to"], settling, over, plan)


def each_step(time: Vector, changes: Sequence[tuple[float, float, float]]) -> tuple[StepPart, ...]:
    """Cut a trajectory into its steps, of which those count that begin within it.

    Args:
        changes: Time in s, value before and value after of every step, as `Steps.changes` has them.
    """
    own = [change for change in changes if change[0] < time[-1]]
    begins = [int(np.searchsorted(time, change[0] - _ROUNDING)) for change in own]
    ends = [*begins[1:], len(time)]
    return tuple(
        StepPart(*change, slice(a, b))
        for change, a, b in zip(own, begins, ends[: len(own)], strict=True)
    )


def step_responses(
    output: str,
    time: Vector,
    trajectory: Vector,
    changes: Sequence[tuple[float, float, float]],
    plan: Vector | None = None,
) -> tuple[StepResponse, ...]:
    """Return how every step of a trajectory was followed.

    Args:
        trajectory: The output, shape (n,), in any unit.
        changes: Time in s, value before and value after of every step, in the unit of the output.
        plan: The controller's own planned move, shape (n,), in the unit of the output.
    """
    found = []
    for begin, a, b, part in each_step(time, changes):
        t, y = time[part], trajectory[part]
        settling = settling_time(t, y, initial=a, final=b)
        over = overshoot(y, initial=a, final=b).value
        own = math.nan if plan is None else settling_time(t, plan[part], initial=a, final=b).value
        found.append(StepResponse(output, begin, a, b, settling, over, own))
    return tuple(found)


def response_to_each_step(run: Run, output: str) -> tuple[StepResponse, ...]:
    """Return how every step of the reference of an output was followed in a run."""
    planned = len(run.controlled) == 1 and bool(run.infos) and "plan" in run.infos[0]
    changes = run.scenario.references[output].changes
    plan = run.info("plan") if planned else None
    return step_responses(output, run.time, run[output], changes, plan)


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
