"""Settling times of controllers over the physical limit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from workbench.reports.style import FONT_POINTS, INK, REFERENCE, colours, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def limit_ratios(ratios: Mapping[str, Mapping[str, float]]) -> Figure:
    """Draw one bar per controller and step.

    Args:
        ratios: Settling time over the limit, dimensionless, NaN where a step did not settle, by
            step and controller.

    Returns:
        The figure: bars from 0, with the limit at 1 and each ratio at the end of its bar.

    Example:
        >>> figure = limit_ratios({"15° to 30°": {"cascade PID": 2.5, "linear MPC": math.nan}})
        >>> figure.axes[0].get_xlabel()
        'settling time over the physical limit'
    """
    names = list(dict.fromkeys(name for own in ratios.values() for name in own))
    shades = colours(names)
    rows = len(ratios) * (len(names) + 0.8)
    figure, (axes,) = new_figure([0.3 + 0.22 * rows])
    ticks = []
    for group, own in enumerate(ratios.values()):
        top = group * (len(names) + 0.8)
        ticks.append(top + 0.5 * (len(names) - 1))
        for row, name in enumerate(names):
            value = own.get(name, math.nan)
            text = "not settled" if math.isnan(value) else f"{value:.1f}"
            length = 0.0 if math.isnan(value) else value
            axes.barh(
                top + row,
                length,
                height=0.85,
                color=shades[name].light,
                label=name if group == 0 else None,
            )
            axes.annotate(
                text,
                (length, top + row),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                fontsize=FONT_POINTS - 1,
                color=INK.light,
            )
    axes.axvline(1.0, color=REFERENCE.light, linewidth=1.2, linestyle="--", label="physical limit")
    known = [v for own in ratios.values() for v in own.values() if not math.isnan(v)]
    axes.set_xlim(0.0, 1.18 * max([1.0, *known]))
    axes.set_ylim(rows - 0.8, -0.8)
    axes.set_yticks(ticks, list(ratios))
    axes.grid(False, axis="y")
    label(axes, x="settling time over the physical limit")
    key(axes, columns=3)
    return figure
