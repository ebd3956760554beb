"""Static identification: force over pressure at constant contractions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.errors import check_finite
from workbench.reports.style import MEASURED, key, label, new_figure, ramp

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Vector = npt.NDArray[np.float64]

_DOTS = 16
"""Measured points shown per line: enough to see the line, few enough to see the dots."""


def force_lines(
    contractions: npt.ArrayLike,
    pressures: Sequence[npt.ArrayLike],
    forces: Sequence[npt.ArrayLike],
    fitted: Sequence[npt.ArrayLike],
) -> Figure:
    """Draw the family of force lines of an isometric experiment with the law fitted to it.

    Args:
        contractions: Contraction of each line, shape (lines,), in m.
        pressures: Gauge pressures along each line, in Pa.
        forces: Measured force along each line, in N.
        fitted: Force of the fitted law along each line, in N.

    Returns:
        The figure: force in N over gauge pressure in bar.
    """
    from matplotlib.lines import Line2D

    figure, (axes,) = new_figure([3.6])
    lengths = check_finite("contractions", contractions)
    handles = []
    lines = zip(lengths, pressures, forces, fitted, ramp(len(lengths)), strict=True)
    for contraction, pressure, force, law, colour in lines:
        bar = np.asarray(pressure, dtype=float) / 1e5
        order = np.argsort(bar)
        step = max(1, len(bar) // _DOTS)
        axes.plot(bar[::step], np.asarray(force)[::step], ".", color=colour.light, markersize=4.5)
        axes.plot(bar[order], np.asarray(law)[order], color=colour.light, linewidth=1.1)
        handles.append(Line2D([], [], color=colour.light, label=f"{1e3 * contraction:.3g} mm"))
    handles.append(
        Line2D([], [], color=MEASURED.light, marker=".", linestyle="none", label="measured")
    )
    label(axes, x="gauge pressure in bar", y="force in N")
    key(axes, columns=4, handles=handles)
    axes.set_ylim(bottom=min(0.0, *(float(np.min(force)) for force in forces)))
    return figure
