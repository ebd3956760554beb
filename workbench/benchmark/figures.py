"""Pictures of the comparison: sines with their errors, and the drift of the mean pressure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from workbench.reports.style import REFERENCE, colours, key, label, new_figure, ramp

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from workbench.benchmark.run import Curves


def tracking_errors(runs: Mapping[str, Curves]) -> Figure:
    """Draw how controllers follow a course.

    Args:
        runs: Curves by name of the controller (times in s, angles in rad).

    Returns:
        The figure: angle and error in ° over time in s.

    Example:
        >>> tracking_errors.__name__
        'tracking_errors'
    """
    figure, (above, below) = new_figure([1.9, 1.4])
    first = next(iter(runs.values()))
    above.plot(
        first.time,
        np.degrees(first.reference),
        color=REFERENCE.light,
        linewidth=1.0,
        label="reference",
    )
    shades = colours(runs)
    for name, run in runs.items():
        shade = shades[name].light
        above.plot(run.time, np.degrees(run.angle), color=shade, linewidth=1.2, label=name)
        below.plot(run.time, np.degrees(run.reference - run.angle), color=shade, linewidth=1.0)
    label(above, y="angle in °")
    label(below, x="time in s", y="error in °")
    key(above, columns=3)
    figure.align_ylabels()
    return figure


def pressure_drift(runs: Mapping[str, Curves]) -> Figure:
    """Draw the mean of the two pressures over a run.

    Args:
        runs: Curves by name of the load (times in s, pressures in Pa).

    Returns:
        The figure: mean gauge pressure in bar over time in s.

    Example:
        >>> pressure_drift.__name__
        'pressure_drift'
    """
    figure, (panel,) = new_figure([2.2])
    for (name, run), shade in zip(runs.items(), ramp(len(runs)), strict=True):
        mean = 0.5e-5 * (run.pressures[0] + run.pressures[1])
        panel.plot(run.time, mean, color=shade.light, linewidth=1.2, label=name)
    label(panel, x="time in s", y="mean pressure in bar")
    key(panel, columns=2)
    return figure
