"""A sliding mode in the plane of error and its rate, and its surface over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import (
    INK,
    REFERENCE,
    Colour,
    key,
    label,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def phase_portrait(
    error: npt.ArrayLike, rate: npt.ArrayLike, *, slope: float, shade: Colour, name: str
) -> Figure:
    """Draw error against its rate, with the direction in which errors decay on the surface.

    Args:
        error: Reference minus angle, shape (n,), in °.
        rate: Its rate where the reference rests, minus the speed, shape (n,), in °/s.
        slope: Slope lambda of the surface, in 1/s.
        shade: Colour of the controller.
        name: Name of the controller.

    Example:
        >>> from workbench.reports.style import FURTHER
        >>> figure = phase_portrait([1, 0.1], [-20, -2], slope=20, shade=FURTHER[0], name="mine")
        >>> figure.axes[0].get_xlabel()
        'error in °'
    """
    figure, (axes,) = new_figure([3.0])
    x, v = np.asarray(error, dtype=float), np.asarray(rate, dtype=float)
    reach = 1.1 * float(np.max(np.abs(v)) or 1.0)
    ends = np.array([-reach / slope, reach / slope])
    axes.plot(
        ends,
        -slope * ends,
        color=REFERENCE.light,
        linewidth=1.0,
        linestyle="--",
        label="rate = -slope x error",
    )
    axes.plot(x, v, color=shade.light, linewidth=1.1, label=name)
    axes.plot([0.0], [0.0], marker="+", color=INK.light, markersize=9, linestyle="none")
    axes.set_ylim(-reach, reach)
    axes.set_xlim(-1.05 * float(np.max(np.abs(x)) or 1.0), 1.05 * float(np.max(np.abs(x)) or 1.0))
    label(axes, x="error in °", y="rate of the error in °/s")
    key(axes, columns=2)
    return figure


def surface(time: npt.ArrayLike, value: npt.ArrayLike, *, shade: Colour) -> Figure:
    """Draw the surface over its boundary layer.

    Args:
        time: Times, shape (n,), in s.
        value: s over the half width of the layer, shape (n,), dimensionless.
        shade: Colour of the controller.

    Returns:
        The figure: s over layer, over time in s, with the layer at ±1.

    Example:
        >>> from workbench.reports.style import FURTHER
        >>> figure = surface([0, 1], [0, 0.5], shade=FURTHER[0])
        >>> figure.axes[0].get_ylabel()
        's over layer'
    """
    figure, (axes,) = new_figure([2.2])
    axes.plot(time, value, color=shade.light, linewidth=1.1)
    for limit in (-1.0, 1.0):
        axes.axhline(limit, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    label(axes, x="time in s", y="s over layer")
    return figure
