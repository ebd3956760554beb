"""Open-loop pulses: valve voltage, angle and speed, with what-if variants beside them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.style import (
    FURTHER,
    INK,
    REFERENCE,
    SIMULATED,
    check_family,
    key,
    label,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def open_loop(
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    angle: npt.ArrayLike,
    speed: npt.ArrayLike,
    *,
    variants: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]] | None = None,
    stops: tuple[float, float] = (0.0, np.pi / 3),
) -> Figure:
    """Draw the open-loop experiment: pulses on the valve and the run from stop to stop.

    Args:
        time: Sample times, shape (n,), in s.
        voltage: Valve voltage, shape (n,), in V.
        angle: Angle, shape (n,), in rad.
        speed: Angular speed, shape (n,), in rad/s.
        variants: Angle (rad) and speed (rad/s) of plants that lack something, by what they lack.
        stops: Angles of the stops, in rad.

    Returns:
        The figure: voltage in V, angle in ° and speed in °/s over time in s.
    """
    figure, (command, position, rate) = new_figure([0.75, 1.9, 1.5])
    t = np.asarray(time, dtype=float)
    command.step(t, voltage, where="post", color=INK.light, linewidth=1.1)
    for stop in stops:
        position.axhline(np.degrees(stop), color=REFERENCE.light, linewidth=0.9, linestyle=":")
    others = dict(variants or {})
    check_family(len(others))
    for (name, (other, other_speed)), colour in zip(others.items(), FURTHER, strict=False):
        position.plot(t, np.degrees(other), color=colour.light, linewidth=0.8, label=name)
        rate.plot(t, np.degrees(other_speed), color=colour.light, linewidth=0.8)
    position.plot(t, np.degrees(angle), color=SIMULATED.light, linewidth=1.7, label="full plant")
    rate.plot(t, np.degrees(speed), color=SIMULATED.light, linewidth=1.4)
    label(command, y="valve in V")
    label(position, y="angle in °")
    label(rate, x="time in s", y="speed in °/s")
    figure.align_ylabels()
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=SIMULATED.light, linewidth=1.7, label="full plant")]
    handles += [
        Line2D([], [], color=colour.light, linewidth=0.9, label=name)
        for name, colour in zip(others, FURTHER, strict=False)
    ]
    key(command, columns=2 if len(handles) > 3 else 3, handles=handles)
    return figure
