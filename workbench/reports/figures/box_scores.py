"""Scores of controllers over the plants of a parameter box."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import INK, REFERENCE, colours, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Vector = npt.NDArray[np.float64]


def box_scores(scores: Mapping[str, tuple[Vector, int]]) -> Figure:
    """Draw the score at every drawn and searched plant, one line of dots per controller.

    Args:
        scores: Scores, shape (n,), dimensionless, and how many of them were drawn, by controller.

    Returns:
        The figure: score on a logarithmic axis, with the limit at 1.

    Example:
        >>> figure = box_scores({"cascade PID": (np.array([0.5, 0.7, 0.9]), 2)})
        >>> figure.axes[0].get_xlabel()
        'score; at most 1 means met'
    """
    from matplotlib.ticker import FixedLocator, NullLocator

    figure, (axes,) = new_figure([0.6 + 0.5 * len(scores)])
    shades = colours(scores)
    rng = np.random.default_rng(0)
    for row, (name, (values, drawn)) in enumerate(scores.items()):
        # Spread a little, so that equal scores do not hide each other.
        place = row + rng.uniform(-0.16, 0.16, len(values))
        shade = shades[name].light
        axes.plot(values[:drawn], place[:drawn], "o", color=shade, markersize=4.5, alpha=0.75)
        axes.plot(values[drawn:], place[drawn:], "x", color=shade, markersize=5)
        worst = int(np.argmax(values))
        axes.plot(values[worst], place[worst], "o", markersize=9, fillstyle="none", color=INK.light)
    axes.axvline(1.0, color=REFERENCE.light, linewidth=1.2, linestyle="--")
    axes.set_xscale("log")
    low = min(float(values.min()) for values, _ in scores.values())
    ticks = [t for t in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0) if t >= 0.6 * low]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(ticks, [f"{t:g}" if t < 10 else "≥ 10" for t in ticks])
    axes.set_xlim(0.8 * min(low, 0.9), 13.0)
    axes.set_yticks(range(len(scores)), list(scores))
    axes.set_ylim(len(scores) - 0.5, -0.5)
    axes.grid(False, axis="y")
    label(axes, x="score; at most 1 means met")
    return figure
