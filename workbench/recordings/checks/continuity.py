"""Do all measurements jump at once, as where rows are missing or out of order?"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.recordings.checks.check import Finding, check
from workbench.recordings.checks.expected import Expected
from workbench.recordings.checks.noise import white_rms
from workbench.recordings.recording import Recording

_RARE = 0.995
"""Share of the steps between samples that are usual."""
_TIMES = 3.0
"""How many times a jump exceeds them."""
_FEW = 2
"""Jumps from which it is no accident."""


def _jumps(values: Vector) -> npt.NDArray[np.bool_]:
    steps = np.abs(np.diff(values))
    usual = max(float(np.quantile(steps, _RARE)), 3.0 * white_rms(values))
    return np.asarray(steps > _TIMES * usual)


@check(
    "continuity",
    85,
    fix="export the rows in the order in which they were sampled, one recording per file",
)
def check_continuity(recording: Recording, _expected: Expected) -> Finding:
    """Look for instants at which every measurement jumps far beyond its usual steps.

    A machine has no reason to: each of its quantities has its own inertia. A clock that goes on
    hides that rows were left out, sorted wrongly or joined from several files.
    """
    moving = [m for m in recording.measurements if np.ptp(recording[m]) > 0]
    if len(moving) < 2:
        return Finding("not checked", "one measurement alone may jump")
    at_once = np.flatnonzero(np.all([_jumps(recording[m]) for m in moving], axis=0))
    if len(at_once) < _FEW:
        return Finding("pass", "no jumps of all measurements at once")
    shown = ", ".join(f"{recording.time[k]:.4g}" for k in at_once[:4])
    more = ", ..." if len(at_once) > 4 else ""
    note = (
        f"all measurements jump at once, {len(at_once)} times (after {shown}{more} s): rows may be"
        " missing, out of order, or joined from several recordings"
    )
    return Finding("pass", note, {"instants": recording.time[at_once]}, doubt=True)
