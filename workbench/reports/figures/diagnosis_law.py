"""The located signal: against its argument with the law on it, and over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from workbench.diagnosis.location.missing_signal import MissingSignal
from workbench.model.units import readable
from workbench.reports.figures.diagnosis_runs import AFTER
from workbench.reports.figures.diagnosis_units import titled
from workbench.reports.style import FAINT, MEASURED, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS = 1200
_SHOWN_S = 8.0


def diagnosis_law(located: MissingSignal) -> Figure:
    """Draw the located signal against the quantity that the effect depends on most."""
    figure, (axes,) = new_figure([2.7])
    draw_law(axes, located)
    return figure


def draw_law(axes: Axes, located: MissingSignal) -> None:
    """Draw a located signal and the law on it against its argument."""
    rows = np.flatnonzero(located.known)
    rows = rows[:: max(1, len(rows) // _POINTS)]
    unit, factor = readable(located.unit)
    x = located.argument_values[rows] * readable(located.argument_unit)[1]
    y = factor * located.signal[rows]
    axes.plot(
        x,
        y,
        ".",
        color=MEASURED.light,
        markersize=3.2,
        alpha=0.6,
        markeredgewidth=0,
        label="from the measurements",
        zorder=2,
    )
    shown = [y]
    if located.law is not None:
        law = factor * located.law[rows]
        axes.plot(
            x,
            law,
            ".",
            color=AFTER.light,
            markersize=3.2,
            markeredgewidth=0,
            label=located.law_name,
            zorder=3,
        )
        shown.append(law)
    axes.axhline(0.0, color=FAINT.light, linewidth=0.9, zorder=1)
    _limit(axes, np.concatenate(shown))
    axes.margins(x=0.03)
    label(
        axes,
        x=titled(located.argument, located.argument_unit),
        y=f"{located.port.replace('_', ' ')} in {unit}" if unit != "1" else located.port,
    )
    key(axes, columns=2)
    legend = axes.get_legend()
    for handle in legend.legend_handles if legend is not None else ():
        handle.set_markersize(8.0)  # type: ignore[union-attr]


def diagnosis_signal(located: MissingSignal) -> Figure:
    """Draw the located signal over time with its band."""
    figure, (axes,) = new_figure([2.7])
    last = max(_SHOWN_S, 400 * float(located.time[1] - located.time[0]))
    rows = located.time <= located.time[0] + last
    rows &= np.maximum.accumulate(located.time) == located.time
    time = located.time[rows]
    unit, factor = readable(located.unit)
    signal, std = factor * located.signal[rows], factor * located.std[rows]
    axes.fill_between(
        time, signal - 2 * std, signal + 2 * std, color=FAINT.light, alpha=0.45, linewidth=0
    )
    axes.plot(time, signal, color=MEASURED.light, linewidth=1.2, label="from the measurements")
    if located.law is not None:
        law = factor * located.law[rows]
        axes.plot(time, law, color=AFTER.light, linewidth=1.0, label=located.law_name)
        signal = np.concatenate([signal, law])
    _limit(axes, signal)
    name = located.port.replace("_", " ")
    label(axes, x="time in s", y=f"{name} in {unit}" if unit != "1" else name)
    key(axes, columns=2)
    return figure


def _limit(axes: object, values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    low, high = np.quantile(values, [0.002, 0.998])
    room = 0.15 * (high - low) or abs(high) or 1.0
    axes.set_ylim(min(low - room, -0.1 * room), max(high + room, 0.1 * room))  # type: ignore[attr-defined]
