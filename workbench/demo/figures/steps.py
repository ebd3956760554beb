"""Steps of closed loops: the same controller on the linear and on the full model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.figures.tracking import Trajectory, tracking

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ClosedLoopCurves:
    """What is drawn of one controller's run.

    Args:
        controller: Name of the controller; sets the colour.
        time: Sample times, shape (n,), in s.
        angle: Angle of the full plant, shape (n,), in rad.
        command: Valve voltage, shape (n,), in V.
        linear_angle: Angle of the linear model under the same controller, shape (n,), in rad; None
            if it was not run.
    """

    controller: str
    time: Vector
    angle: Vector
    command: Vector
    linear_angle: Vector | None = None


def closed_loop_steps(
    time: npt.ArrayLike,
    reference: npt.ArrayLike,
    runs: Sequence[ClosedLoopCurves],
    *,
    error_limit_deg: float = 0.3,
) -> Figure:
    """Draw the steps of several controllers over each other.

    Args:
        time: Sample times of the reference, shape (n,), in s.
        reference: Reference angle, shape (n,), in rad.
        error_limit_deg: Steady error allowed, drawn as lines about zero error.

    Returns:
        The figure: angle and error in ° and valve voltage in V over time in s.
    """
    trajectories = [
        Trajectory(
            run.controller,
            run.time,
            np.degrees(run.angle),
            run.command,
            None if run.linear_angle is None else np.degrees(run.linear_angle),
        )
        for run in runs
    ]
    degrees = np.degrees(np.asarray(reference, dtype=float))
    return tracking(
        time,
        degrees,
        trajectories,
        quantity="angle",
        unit="°",
        command="valve in V",
        error_limit=error_limit_deg,
    )
