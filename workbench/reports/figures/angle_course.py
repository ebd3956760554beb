"""How a plant changes over its angles: frequency and damping of its oscillation, and its gain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import REFERENCE, SIMULATED, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def angle_course(
    angles_deg: npt.ArrayLike,
    frequency_hz: npt.ArrayLike,
    damping: npt.ArrayLike,
    gain: npt.ArrayLike,
    *,
    marked_deg: Sequence[float] = (),
) -> Figure:
    """Draw frequency, damping and gain over the angle.

    Args:
        angles_deg: Angles, shape (n,), in °.
        frequency_hz: Frequency of the oscillation, shape (n,), in Hz.
        damping: Damping ratio, shape (n,), dimensionless.
        gain: Gain, shape (n,), in °/V.
        marked_deg: Operating angles that are marked, in °.
    """
    figure, panels = new_figure([1.15, 1.15, 1.15])
    names = ("frequency in Hz", "damping ratio", "gain in °/V")
    for axes, values, name in zip(panels, (frequency_hz, damping, gain), names, strict=True):
        course = np.asarray(values, dtype=float)
        # Points, for a line would make a slope of every jump at a corner of a law.
        axes.plot(angles_deg, course, "o", color=SIMULATED.light, markersize=3.5)
        for angle in marked_deg:
            axes.axvline(angle, color=REFERENCE.light, linewidth=1.0, linestyle=":")
        # From zero, so that a change of one per cent does not look like a doubling.
        axes.set_ylim(0.0, 1.15 * float(np.nanmax(course)))
        label(axes, y=name)
    label(panels[-1], x="angle in °")
    figure.align_ylabels()
    return figure
