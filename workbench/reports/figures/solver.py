"""Time and iterations of the optimisations of a controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import REFERENCE, colours, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Vector = npt.NDArray[np.float64]


def solver(courses: Mapping[str, tuple[Vector, Vector, Vector]], *, deadline: float) -> Figure:
    """Draw solve times and iterations over time.

    Args:
        courses: Times in s, solve times in s and iterations, shape (n,) each, by controller;
            iterations that no solver tells are NaN and not drawn.
        deadline: Sample time, in s.

    Returns:
        The figure: solve time in ms with the deadline, and iterations, over time in s.

    Example:
        >>> t = np.linspace(0.0, 1.0, 5)
        >>> figure = solver({"linear MPC": (t, 1e-4 + t, t)}, deadline=0.002)
        >>> [axes.get_ylabel() for axes in figure.axes]
        ['solve time in ms', 'iterations']
    """
    counted = any(
        np.isfinite(np.asarray(count, dtype=float)).any() for _, _, count in courses.values()
    )
    figure, panels = new_figure([1.8, 1.1] if counted else [2.4])
    times = panels[0]
    shades = colours(courses)
    for name, (time, seconds, count) in courses.items():
        shade = shades[name].light
        times.semilogy(time, 1e3 * np.asarray(seconds), color=shade, linewidth=1.0, label=name)
        if counted:
            panels[1].step(time, count, where="post", color=shade, linewidth=1.0)
    times.axhline(
        1e3 * deadline, color=REFERENCE.light, linewidth=1.0, linestyle="--", label="sample time"
    )
    label(times, y="solve time in ms")
    if counted:
        label(panels[1], y="iterations")
    label(panels[-1], x="time in s")
    key(times)
    figure.align_ylabels()
    return figure
