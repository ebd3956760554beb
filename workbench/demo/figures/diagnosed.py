"""A diagnosed recording: before and after what was found, and the better controller it gives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.reports.figures.diagnosis_runs import AFTER, BEFORE
from workbench.reports.style import FURTHER, MEASURED, REFERENCE, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def diagnosed(
    before: FreeRun, after: FreeRun, time: npt.ArrayLike, errors: Mapping[str, npt.ArrayLike]
) -> Figure:
    """Draw free runs of two models along a recording, and tracking errors of two designs.

    Args:
        before: Free run of the refitted nominal model; its first output is the angle.
        after: Free run of the model with what was found.
        time: Times of the tracking errors, shape (n,), in s.
        errors: Tracking error, shape (n,), in rad, by the name of the design.

    Returns:
        The figure: measured and simulated angle, errors of both models, and errors of both
        controllers, in ° over time in s.
    """
    figure, (angle, error, tracked) = new_figure([1.7, 1.0, 1.3], share_x=False)
    angle.plot(
        before.time,
        np.degrees(before.measured[:, 0]),
        color=MEASURED.light,
        linewidth=3.0,
        alpha=0.45,
        label="measured",
    )
    for run, colour, name in ((before, BEFORE, "before"), (after, AFTER, "after")):
        angle.plot(
            run.time,
            np.degrees(run.simulated[:, 0]),
            color=colour.light,
            linewidth=1.2,
            linestyle="-" if run is before else (0, (4, 2)),
            label=name,
        )
        error.plot(run.time, np.degrees(run.error[:, 0]), color=colour.light, linewidth=1.1)
    for (name, values), shade in zip(errors.items(), (REFERENCE, FURTHER[0]), strict=True):
        tracked.plot(time, np.degrees(values), color=shade.light, linewidth=1.3, label=name)
    angle.tick_params(labelbottom=False)
    label(angle, y="angle in °")
    label(error, x="time in s", y="error in °")
    label(tracked, x="time in s", y="error in °")
    key(angle)
    key(tracked, columns=2)
    figure.align_ylabels()
    return figure
