"""Steps of closed loops: the same controller on the linear and on the full model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import INK, REFERENCE, colours, key, label, new_figure

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
        runs: What each controller did.
        error_limit_deg: Steady error allowed, drawn as lines about zero error.

    Returns:
        The figure: angle and error in ° and valve voltage in V over time in s.
    """
    from matplotlib.lines import Line2D

    figure, (position, error, command) = new_figure([2.2, 1.1, 1.0])
    t = np.asarray(time, dtype=float)
    wanted = np.asarray(reference, dtype=float)
    position.step(t, np.degrees(wanted), where="post", color=REFERENCE.light, linewidth=1.0)
    for limit in (-error_limit_deg, error_limit_deg):
        error.axhline(limit, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    shades = colours(run.controller for run in runs)
    handles = []
    for run in runs:
        shade = shades[run.controller].light
        position.plot(run.time, np.degrees(run.angle), color=shade, linewidth=1.5)
        held = wanted[np.clip(np.searchsorted(t, run.time, "right") - 1, 0, len(t) - 1)]
        error.plot(run.time, np.degrees(held - run.angle), color=shade, linewidth=1.1)
        command.step(run.time, run.command, where="post", color=shade, linewidth=0.9)
        if run.linear_angle is not None:
            position.plot(
                run.time, np.degrees(run.linear_angle), color=shade, linewidth=1.0, linestyle="--"
            )
        handles.append(Line2D([], [], color=shade, linewidth=1.5, label=run.controller))
    handles.append(Line2D([], [], color=REFERENCE.light, linewidth=1.0, label="reference"))
    if any(run.linear_angle is not None for run in runs):
        handles += [
            Line2D([], [], color=INK.light, linewidth=1.5, label="full plant"),
            Line2D([], [], color=INK.light, linewidth=1.0, linestyle="--", label="linear model"),
        ]
    error.set_ylim(-5.0 * error_limit_deg, 5.0 * error_limit_deg)
    label(position, y="angle in °")
    label(error, y="error in °")
    label(command, x="time in s", y="valve in V")
    key(position, columns=3, handles=handles)
    figure.align_ylabels()
    return figure
