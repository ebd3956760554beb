"""Nyquist plots of a family of opened loops, with the disk that none may enter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.figures.bode import distinct
from workbench.reports.style import BAND, FAINT, INK, key, label, new_figure, ramp
from workbench.study.linear_loop import crossings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def nyquist(responses: Mapping[str, npt.ArrayLike], *, disk_margin: float | None = None) -> Figure:
    """Draw loop gains in the complex plane.

    Args:
        responses: Loop gain over frequency, shape (n,), dimensionless, by the name of its curve,
            an ordered family such as angles; curves that lie on each other are drawn once.
        disk_margin: Smallest disk margin alpha of the family, dimensionless: its disk about -1 is
            drawn.

    Returns:
        The figure: imaginary over real part, with the unit circle and the point -1; dots where a
        curve crosses the circle (phase margin) and the negative real axis (gain margin).
    """
    from matplotlib.patches import Circle

    figure, (axes,) = new_figure([3.6])
    if disk_margin is not None and 0.0 < disk_margin < 2.0:
        half = disk_margin / 2.0
        near, far = (1.0 - half) / (1.0 + half), (1.0 + half) / (1.0 - half)
        disk = Circle(
            (-0.5 * (near + far), 0.0),
            0.5 * (far - near),
            facecolor=BAND.light,
            edgecolor=FAINT.light,
            linewidth=0.9,
        )
        axes.add_patch(disk)
    axes.add_patch(
        Circle((0.0, 0.0), 1.0, fill=False, edgecolor=FAINT.light, linewidth=0.9, linestyle=":")
    )
    drawn = distinct(responses)
    for (name, values), shade in zip(drawn.items(), ramp(len(drawn)), strict=True):
        axes.plot(values.real, values.imag, color=shade.light, linewidth=1.4, label=name)
        circle, _, axis, _ = crossings(np.arange(1.0, len(values) + 1.0), values)
        marked = np.concatenate([circle, axis])
        axes.plot(marked.real, marked.imag, "o", color=shade.light, markersize=4.0)
    axes.plot([-1.0], [0.0], marker="+", color=INK.light, markersize=9, linestyle="none")
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(-3.2, 1.4)
    axes.set_ylim(-2.0, 1.4)
    label(axes, x="real part of the loop gain", y="imaginary part")
    key(axes, columns=4)
    return figure
