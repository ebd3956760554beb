"""How a plant changes over an output: frequency and damping of its oscillation, and its gain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import REFERENCE, SIMULATED, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_plant_map(
    values: npt.ArrayLike,
    frequency_hz: npt.ArrayLike,
    damping: npt.ArrayLike,
    gain: npt.ArrayLike,
    *,
    name: str,
    unit: str,
    gain_unit: str,
    marked: Sequence[float] = (),
) -> Figure:
    """Draw frequency, damping and gain over an output.

    Args:
        values: Values of the output, shape (n,), in ``unit``.
        frequency_hz: Frequency of the oscillation, shape (n,), in Hz.
        damping: Damping ratio, shape (n,), dimensionless.
        gain: Gain, shape (n,), in the unit ``gain_unit``.
        marked: Operating points that are marked, in ``unit``.
    """
    figure, panels = new_figure([1.15, 1.15, 1.15])
    names = ("frequency in Hz", "damping ratio", f"gain in {gain_unit}")
    for axes, drawn, title in zip(panels, (frequency_hz, damping, gain), names, strict=True):
        curve = np.asarray(drawn, dtype=float)
        # Points, for a line would make a slope of every jump at a corner of a law.
        axes.plot(values, curve, "o", color=SIMULATED.light, markersize=3.5)
        for value in marked:
            axes.axvline(value, color=REFERENCE.light, linewidth=1.0, linestyle=":")
        # From zero, so that a change of one per cent does not look like a doubling.
        axes.set_ylim(0.0, 1.15 * float(np.nanmax(curve)))
        label(axes, y=title)
    label(panels[-1], x=f"{name.replace('_', ' ')} in {unit}")
    figure.align_ylabels()
    return figure
