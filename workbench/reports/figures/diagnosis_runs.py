"""Held-out recordings beside free runs of the refitted and of the extended model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.model import Model
from workbench.model.units import from_si, of_difference, readable, readably, written_unit
from workbench.reports.style import (
    BAND,
    FURTHER,
    MEASURED,
    REFERENCE,
    SIMULATED,
    key,
    label,
    named_line,
    new_figure,
    time_ticks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


BEFORE = FURTHER[1]
"""Colour of the refitted nominal model."""

AFTER = SIMULATED
"""Colour of the extended model."""

NAMES = ("refitted", "extended")
"""What the two models of a diagnosis are called."""

_POINTS = 1200
_DASHES = (0, (4, 2))
_WINDOWS = 60


def as_read(model: Model, run: FreeRun, *, errors: bool = False) -> FreeRun:
    """Return a free run, in SI, with each output in the unit that the model declares for reading.

    An output that declares none stays in SI.

    Args:
        errors: Whether errors are read from it, in which the zero of a scale has no part.
    """
    units = [_display(model, name) or unit for name, unit in zip(run.used, run.units, strict=True)]
    units = [of_difference(unit) for unit in units] if errors else units
    measured, simulated = (
        np.column_stack([from_si(v[:, i], unit) for i, unit in enumerate(units)])
        for v in (run.measured, run.simulated)
    )
    shown = tuple(written_unit(unit) or "1" for unit in units)
    return replace(run, units=shown, measured=measured, simulated=simulated)


def sizes_as_read(model: Model, sizes: Mapping[str, float]) -> dict[str, float]:
    """Return errors of outputs, in SI, by name, in the units of `as_read`."""
    return {
        name: float(from_si(size, of_difference(_display(model, name) or "1")))
        for name, size in sizes.items()
    }


def _display(model: Model, name: str) -> str:
    """Return the unit that an output declares beside its SI unit; empty if none."""
    shown = {q.name: q.display_unit for q in model.outputs if q.display_unit != q.unit}
    return shown.get(name, "")


def titled(name: str, unit: str, declared: str = "") -> str:
    """Write a quantity with its readable unit, from the SI one, as the label of an axis."""
    shown = readably(0.0, unit, declared)[1]
    plain = name.replace("_", " ")
    return plain if shown == "1" else f"{plain} in {shown}"


def diagnosis_runs(
    before: FreeRun, after: FreeRun | None = None, names: tuple[str, str] = NAMES
) -> Figure:
    """Draw what was measured and what both models say to the same input, on the same axes.

    Returns:
        The figure: one panel per output over time in s; the last repeats the first output where
        the first model is farthest off, measured by what moves there.
    """
    count = len(before.used)
    figure, panels = new_figure([1.6] + [1.4] * (count - 1) + [1.7], share_x=False)
    for i, axes in enumerate(panels[:count]):
        draw_run(axes, before, after, i, np.ones(len(before.time), dtype=bool))
        time_ticks(axes)
        if i < count - 1:
            axes.tick_params(labelbottom=False)
    label(panels[count - 1], x="time in s")
    draw_run(panels[-1], before, after, 0, farthest_off(before))
    label(panels[-1], x=f"time in s, where the {names[0]} model is farthest off")
    key(panels[0], columns=3, handles=run_key(after, names))
    figure.align_ylabels()
    return figure


def run_key(after: FreeRun | None, names: tuple[str, str] = NAMES) -> list[Line2D]:
    """Return the legend of measured and simulated curves."""
    handles = [
        named_line("measured", MEASURED, width=3.0, alpha=0.45),
        named_line(names[0], BEFORE, width=1.2),
    ]
    return handles + ([named_line(names[1], AFTER, width=1.2, style=_DASHES)] if after else [])


def farthest_off(run: FreeRun) -> npt.NDArray[np.bool_]:
    """Find where the error of the first output is the largest share of what is measured there.

    Returns:
        Whether a sample lies in that twelfth of the recording, shape (n,).
    """
    width = max(2, len(run.time) // 12)
    # A window in which nothing moves is judged by a twentieth of the whole range.
    floor = 0.05 * float(np.nanmax(run.measured[:, 0]) - np.nanmin(run.measured[:, 0]))
    best, first = -1.0, 0
    for begin in range(0, max(1, len(run.time) - width + 1), max(1, width // 8)):
        seen = np.nan_to_num(run.measured[begin : begin + width, 0])
        error = np.nan_to_num(run.error[begin : begin + width, 0])
        share = float(np.sqrt(np.mean(error**2)) / max(np.ptp(seen), floor, 1e-300))
        if share > best:
            best, first = share, begin
    rows = np.zeros(len(run.time), dtype=bool)
    rows[first : first + width] = True
    return rows


def draw_run(
    axes: Axes, before: FreeRun, after: FreeRun | None, i: int, rows: npt.NDArray[np.bool_]
) -> None:
    """Draw one output as measured and as both models say, at some of the samples."""
    factor = readable(before.units[i])[1]
    time, seen = _thinned(before.time[rows], before.measured[rows, i])
    axes.plot(time, factor * seen, color=MEASURED.light, linewidth=3.0, alpha=0.45)
    if before.finite:
        told = _thinned(before.time[rows], before.simulated[rows, i])[1]
        axes.plot(time, factor * told, color=BEFORE.light, linewidth=1.2)
    if after is not None and after.finite:
        told = _thinned(after.time[rows], after.simulated[rows, i])[1]
        axes.plot(time, factor * told, color=AFTER.light, linewidth=1.2, linestyle=_DASHES)
    low, high = float(np.nanmin(seen)) * factor, float(np.nanmax(seen)) * factor
    if before.finite:
        # A model that is far off is shown as far as it leaves the measurements legible, be it
        # where nothing moves.
        told = factor * _thinned(before.time[rows], before.simulated[rows, i])[1]
        whole = before.measured[:, i]
        reach = max(high - low, 0.2 * factor * float(np.nanmax(whole) - np.nanmin(whole)))
        low = max(min(low, float(np.nanmin(told))), low - reach)
        high = min(max(high, float(np.nanmax(told))), high + reach)
    room = 0.2 * (high - low) or 1.0
    axes.set_ylim(low - room, high + room)
    label(axes, y=titled(before.used[i], before.units[i]))


def diagnosis_residuals(
    before: FreeRun,
    noise: Mapping[str, float],
    after: FreeRun | None = None,
    names: tuple[str, str] = NAMES,
) -> Figure:
    """Draw how far both free runs are measured, against the noise of the sensors.

    Args:
        noise: Noise of each output, in its SI unit.

    Returns:
        The figure: root mean square of the error over sixty windows on a logarithmic axis, one
        panel per output over time in s; the band is twice the noise.
    """
    from matplotlib.patches import Patch

    figure, panels = new_figure(
        [(1.9 + 1.4 * len(before.used)) / len(before.used)] * len(before.used)
    )
    for i, axes in enumerate(panels):
        draw_error(axes, before, noise, after, i)
    label(panels[-1], x="time in s")
    handles: list[Line2D | Patch] = [named_line(names[0], BEFORE, width=1.3)]
    if after is not None:
        handles.append(named_line(names[1], AFTER, width=1.3))
    handles.append(Patch(color=BAND.light, label="twice the sensor's noise"))
    key(panels[0], columns=3, handles=handles)  # type: ignore[arg-type]
    figure.align_ylabels()
    return figure


def draw_error(
    axes: Axes, before: FreeRun, noise: Mapping[str, float], after: FreeRun | None, i: int
) -> None:
    """Draw the error of one output over time, on a logarithmic axis.

    Args:
        noise: Noise of each output, in its SI unit; the band is twice that.
    """
    factor = readable(before.units[i])[1]
    level = max(factor * noise.get(before.used[i], 0.0), 1e-12)
    smallest, largest = level, 3 * level
    for run, colour in ((before, BEFORE), (after, AFTER)):
        if run is not None and run.finite:
            time, rms = moving_rms(run.time, run.error[:, i])
            axes.plot(time, factor * rms, color=colour.light, linewidth=1.3)
            smallest = min(smallest, float(np.nanmin(factor * rms, initial=level)))
            largest = max(largest, float(np.nanmax(factor * rms, initial=level)))
    axes.set_yscale("log")
    axes.set_ylim(0.5 * max(smallest, 1e-3 * level), 2 * largest)
    axes.axhspan(1e-12, 2 * level, color=BAND.light, zorder=0)
    axes.axhline(level, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    _decades(axes)
    label(axes, y=titled(f"error of {before.used[i]}", before.units[i]))


def _decades(axes: Axes) -> None:
    """Write plain numbers on a logarithmic axis, three per decade where it spans few of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    within = (1.0, 2.0, 5.0) if high < 100 * low else (1.0,)
    axes.yaxis.set_major_locator(LogLocator(subs=within, numticks=6))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(which="minor", left=False)


def moving_rms(time: Vector, error: Vector) -> tuple[Vector, Vector]:
    """Return the root mean square of an error over sixty windows of time.

    A window has ten samples at least.

    Args:
        time: Sample times, shape (n,), in s.
        error: Errors, shape (n,), in any unit; NaN where there is no measurement.

    Returns:
        Middles of the windows, in s, and the values, in the error's unit.
    """
    size = max(10, len(time) // _WINDOWS)
    count = max(1, len(time) // size)
    used = min(len(time), count * size)
    squares = np.nan_to_num(error[:used] ** 2).reshape(count, -1)
    seen = np.isfinite(error[:used]).reshape(count, -1).sum(axis=1)
    values = np.sqrt(squares.sum(axis=1) / np.maximum(seen, 1))
    return time[:used].reshape(count, -1).mean(axis=1), np.where(seen > 0, values, np.nan)


def _thinned(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    step = max(1, len(time) // _POINTS)
    return time[::step], values[::step]
