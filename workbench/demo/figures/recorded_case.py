"""A recording beside its simulation: command, angle, difference and pressures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import INK, MEASURED, REFERENCE, SIMULATED, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def recorded_case(
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    measured: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike],
    simulated: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike],
) -> Figure:
    """Draw what was measured and what the model says to the same valve voltage.

    Args:
        time: Sample times, shape (n,), in s.
        voltage: Recorded valve voltage, shape (n,), in V.
        measured: Measured angle (rad) and gauge pressures of muscle 1 and 2 (Pa), shape (n,) each.
        simulated: Simulated angle (rad) and gauge pressures (Pa), shape (n,) each.

    Returns:
        The figure: voltage in V, angle and its difference in °, pressures in bar, over time in s.

    Example:
        >>> zero = np.zeros(3)
        >>> figure = recorded_case(zero, zero, (zero,) * 3, (zero,) * 3)
        >>> [axes.get_ylabel() for axes in figure.axes][:3]
        ['valve in V', 'angle in °', 'error in °']
    """
    from matplotlib.lines import Line2D

    figure, (command, position, residual, first, second) = new_figure([0.7, 1.7, 0.9, 1.1, 1.1])
    t = np.asarray(time, dtype=float)
    command.step(t, voltage, where="post", color=INK.light, linewidth=0.9)
    pairs = [
        (np.degrees(measured[0]), np.degrees(simulated[0])),
        (np.asarray(measured[1]) / 1e5, np.asarray(simulated[1]) / 1e5),
        (np.asarray(measured[2]) / 1e5, np.asarray(simulated[2]) / 1e5),
    ]
    for axes, (seen, told) in zip((position, first, second), pairs, strict=True):
        axes.plot(t, seen, color=MEASURED.light, linewidth=1.3)
        axes.plot(t, told, color=SIMULATED.light, linewidth=1.0)
    residual.axhline(0.0, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    residual.plot(t, pairs[0][0] - pairs[0][1], color=SIMULATED.light, linewidth=1.0)
    label(command, y="valve in V")
    label(position, y="angle in °")
    label(residual, y="error in °")
    label(first, y="p1 in bar")
    label(second, x="time in s", y="p2 in bar")
    key(
        command,
        columns=2,
        handles=[
            Line2D([], [], color=MEASURED.light, linewidth=1.3, label="measured"),
            Line2D([], [], color=SIMULATED.light, linewidth=1.1, label="simulated"),
        ],
    )
    figure.align_ylabels()
    return figure
