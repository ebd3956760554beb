"""The steps of a course one by one, each from its own instant until the next begins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from workbench.verification.responses import Figure, settling_time

Vector = npt.NDArray[np.float64]

_ROUNDING = 1e-9
"""A time computed as k h may fall short of its decimal value by one rounding, s."""


class StepPart(NamedTuple):
    """One step of a reference, and the samples that show its response.

    Args:
        begin: Time of the step, in s.
        initial: Reference before it, in SI.
        final: Reference after it, in SI.
        part: Samples from the step until the next one.
    """

    begin: float
    initial: float
    final: float
    part: slice


class StepSettling(NamedTuple):
    """How long one step of a run took.

    Args:
        output: Name of the followed output.
        begin: Time of the step, in s.
        initial: Reference before it, in the unit of the output.
        final: Reference after it, in the unit of the output.
        settling: Settling time, in s, or NaN with a reason.
    """

    output: str
    begin: float
    initial: float
    final: float
    settling: Figure


def each_step(time: Vector, changes: Sequence[tuple[float, float, float]]) -> tuple[StepPart, ...]:
    """Cut a course into its steps.

    Args:
        time: Sample times, shape (n,), in s.
        changes: Time in s, value before and value after of every step, as `Steps.changes` has them.

    Returns:
        One part per step that begins within the course; the last one ends with it.

    Example:
        >>> time = np.arange(10) * 0.1
        >>> [step.part for step in each_step(time, [(0.2, 0.0, 1.0), (0.5, 1.0, 0.0)])]
        [slice(2, 5, None), slice(5, 10, None)]
    """
    own = [change for change in changes if change[0] < time[-1]]
    begins = [int(np.searchsorted(time, change[0] - _ROUNDING)) for change in own]
    ends = [*begins[1:], len(time)]
    return tuple(
        StepPart(*change, slice(a, b))
        for change, a, b in zip(own, begins, ends[: len(own)], strict=True)
    )


def settling_of_each_step(
    output: str, time: Vector, course: Vector, changes: Sequence[tuple[float, float, float]]
) -> tuple[StepSettling, ...]:
    """Return the settling time of every step of a course.

    Args:
        output: Name of the followed output.
        time: Sample times, shape (n,), in s.
        course: The output, shape (n,), in any unit.
        changes: Time in s, value before and value after of every step, in the unit of the course.

    Returns:
        One settling time per step, as `responses.settling_time` defines it.

    Example:
        >>> time = np.arange(1000) * 0.001
        >>> (step,) = settling_of_each_step("angle", time, 1.0 * (time > 0.3), [(0.2, 0.0, 1.0)])
        >>> round(step.settling.value, 3)
        0.101
    """
    return tuple(
        StepSettling(
            output,
            step.begin,
            step.initial,
            step.final,
            settling_time(
                time[step.part], course[step.part], initial=step.initial, final=step.final
            ),
        )
        for step in each_step(time, changes)
    )
