"""Bode plots of a family of linear models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import Colour, key, label, new_figure, ramp

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def bode(
    frequency: npt.ArrayLike,
    responses: Mapping[str, npt.ArrayLike],
    *,
    unit: str,
    family: Mapping[str, Colour] | None = None,
) -> Figure:
    """Draw magnitude and phase of frequency responses over frequency.

    Args:
        frequency: Frequencies, shape (n,), in Hz.
        responses: Complex response, shape (n,), in ``unit``, by the name of its curve; an ordered
            family such as angles takes the colours of the ramp.
        unit: Unit of the magnitude, such as ``°/V``.
        family: Colours by name, where the curves are no ordered family.

    Returns:
        The figure: magnitude in ``unit`` and phase in ° over frequency in Hz.
    """
    figure, (magnitude, phase) = new_figure([2.2, 1.7])
    hertz = np.asarray(frequency, dtype=float)
    shades = family or dict(zip(responses, ramp(len(responses)), strict=True))
    for name, response in responses.items():
        values = np.asarray(response, dtype=complex)
        line = {"color": shades[name].light, "linewidth": 1.3}
        magnitude.loglog(hertz, np.abs(values), label=name, **line)
        degrees = np.degrees(np.unwrap(np.angle(values)))
        # Unwrapping starts anywhere; curves are comparable when all start within one turn.
        degrees -= 360.0 * np.ceil((degrees[0] - 1.0) / 360.0)
        phase.semilogx(hertz, degrees, **line)
    _round_ticks(magnitude, phase)
    label(magnitude, y=f"magnitude in {unit}")
    label(phase, x="frequency in Hz", y="phase in °")
    key(magnitude, columns=4)
    figure.align_ylabels()
    return figure


def _round_ticks(magnitude: Axes, phase: Axes) -> None:
    from matplotlib.ticker import LogLocator, MultipleLocator

    # Of many decades only some are written, so that their labels never touch.
    magnitude.yaxis.set_major_locator(LogLocator(numticks=6))
    low, high = phase.get_ylim()
    phase.yaxis.set_major_locator(MultipleLocator(90.0 * max(1, round((high - low) / 540.0))))
