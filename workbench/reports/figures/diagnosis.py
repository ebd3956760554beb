"""Pictures of a diagnosis: free runs beside held-out recordings, what is missing, and where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.diagnosis.location.missing_signal import MissingSignal
from workbench.diagnosis.nonparametric.result import Argument
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.units import from_si, of_difference, readably, written_unit
from workbench.reports.pictures import Picture
from workbench.reports.style import (
    BAND,
    FAINT,
    FURTHER,
    MEASURED,
    REFERENCE,
    SIMULATED,
    Colour,
    bars,
    decades,
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

    from workbench.diagnosis.stages import Diagnosis


BEFORE = FURTHER[1]
"""Colour of the refitted nominal model."""

AFTER = SIMULATED
"""Colour of the extended model."""

Runs = Mapping[str, FreeRun]
"""Free runs along one recording by the name of the model: before, and if there is one, after."""

_POINTS = 1200
_LOOKS: tuple[tuple[Colour, Any], ...] = ((BEFORE, "-"), (AFTER, (0, (4, 2))))
_WINDOWS = 60


def held_out_runs(diagnosis: Diagnosis, recording: str) -> dict[str, FreeRun]:
    """Return the free runs along a held-out recording: refitted, and extended if that is better."""
    names = ("refitted", "extended") if diagnosis.improved else ("refitted",)
    known = {name: diagnosis.runs.get(name, {}) for name in names}
    return {name: runs[recording] for name, runs in known.items() if recording in runs}


def as_read(model: Model, run: FreeRun, *, errors: bool = False) -> FreeRun:
    """Return a free run, in SI, with each output in the unit in which people read it.

    Args:
        errors: Whether errors are read from it, in which the zero of a scale has no part.
    """
    shown = {q.name: q.display_unit for q in model.outputs}
    units = [of_difference(shown[name]) if errors else shown[name] for name in run.used]
    measured, simulated = (
        np.column_stack([from_si(v[:, i], unit) for i, unit in enumerate(units)])
        for v in (run.measured, run.simulated)
    )
    written = tuple(written_unit(unit) or "1" for unit in units)
    return replace(run, units=written, measured=measured, simulated=simulated)


def all_as_read(model: Model, runs: Runs) -> tuple[dict[str, FreeRun], dict[str, FreeRun]]:
    """Return free runs as people read the outputs, and as they read the errors."""
    shown, errors = (
        {name: as_read(model, run, errors=errors) for name, run in runs.items()}
        for errors in (False, True)
    )
    return shown, errors


def sizes_as_read(model: Model, sizes: Mapping[str, float]) -> dict[str, float]:
    """Return errors of outputs, in SI, by name, in the units of `as_read`."""
    shown = {q.name: of_difference(q.display_unit) for q in model.outputs}
    return {name: float(from_si(size, shown[name])) for name, size in sizes.items()}


def titled(name: str, unit: str) -> str:
    """Write a quantity with its unit, as people write it, as the label of an axis."""
    plain = name.replace("_", " ")
    return plain if unit == "1" else f"{plain} in {unit}"


def diagnosis_runs(runs: Runs) -> Figure:
    """Draw what was measured and what the models say to the same input, on the same axes.

    Returns:
        The figure: one panel per output over time in s; the last repeats the first output where
        the first model is farthest off, measured by what moves there.
    """
    name, before = next(iter(runs.items()))
    count = len(before.used)
    figure, panels = new_figure([1.6] + [1.4] * (count - 1) + [1.7], share_x=False)
    for i, axes in enumerate(panels[:count]):
        draw_run(axes, runs, i, np.ones(len(before.time), dtype=bool))
        time_ticks(axes)
        if i < count - 1:
            axes.tick_params(labelbottom=False)
    label(panels[count - 1], x="time in s")
    draw_run(panels[-1], runs, 0, farthest_off(before))
    label(panels[-1], x=f"time in s, where the {name} model is farthest off")
    key(panels[0], columns=3, handles=run_key(runs))
    return figure


def run_pictures(
    model: Model, runs: Runs, noise: Mapping[str, float], title: str, files: tuple[str, str]
) -> tuple[Picture, Picture]:
    """Return the pictures of free runs along a recording and of their errors.

    The runs are in SI; the model says in which units people read them.

    Args:
        noise: Noise of each output, in its SI unit.
    """
    shown, errors = all_as_read(model, runs)
    failed = [
        f" The {name} model does not reach the end: {run.failure}."
        for name, run in runs.items()
        if not run.finite
    ]
    first = next(iter(errors.values()))
    told = "; ".join(
        f"{output}: rms error "
        + ", ".join(f"{run.rmse[output]:.3g} {unit} {name}" for name, run in shown.items())
        for output, unit in zip(first.used, first.units, strict=True)
    )
    models = " and by ".join(f"the {name} model" for name in runs)
    return (
        Picture(
            files[0],
            diagnosis_runs(shown),
            f"{title}: measured, and simulated by {models}.{''.join(failed)}",
            told,
        ),
        Picture(
            files[1],
            diagnosis_residuals(errors, sizes_as_read(model, noise)),
            f"{title}: error of the free run{'s' * (len(runs) > 1)}, root mean square over a"
            " sixtieth of it, on a logarithmic axis. In the green band it is no larger than twice"
            " the noise of the sensor.",
            told,
        ),
    )


def run_key(runs: Runs) -> list[Line2D]:
    """Return the legend of measured and simulated curves."""
    return [
        named_line("measured", MEASURED, width=3.0, alpha=0.45),
        *(
            named_line(name, colour, width=1.2, style=dashes)
            for name, (colour, dashes) in zip(runs, _LOOKS, strict=False)
        ),
    ]


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


def draw_run(axes: Axes, runs: Runs, i: int, rows: npt.NDArray[np.bool_]) -> None:
    """Draw one output as measured and as the models say, at some of the samples."""
    before = next(iter(runs.values()))
    time, seen = _thinned(before.time[rows], before.measured[rows, i])
    axes.plot(time, seen, color=MEASURED.light, linewidth=3.0, alpha=0.45)
    for run, (colour, dashes) in zip(runs.values(), _LOOKS, strict=False):
        if run.finite:
            time, told = _thinned(run.time[rows], run.simulated[rows, i])
            axes.plot(time, told, color=colour.light, linewidth=1.2, linestyle=dashes)
    whole = before.measured[np.isfinite(before.measured[:, i]), i]
    low, high = (f(seen if len(seen) else whole) for f in (np.min, np.max))
    if before.finite:
        # A model that is far off is shown as far as it leaves the measurements legible, be it
        # where nothing moves.
        told = _thinned(before.time[rows], before.simulated[rows, i])[1]
        reach = max(high - low, 0.2 * np.ptp(whole))
        low = max(min(low, np.min(told)), low - reach)
        high = min(max(high, np.max(told)), high + reach)
    room = 0.2 * (high - low) or 1.0
    axes.set_ylim(low - room, high + room)
    label(axes, y=titled(before.used[i], before.units[i]))


def diagnosis_residuals(runs: Runs, noise: Mapping[str, float]) -> Figure:
    """Draw how far the free runs are measured, against the noise of the sensors.

    Args:
        noise: Noise of each output, in the unit of the runs.

    Returns:
        The figure: root mean square of the error over sixty windows on a logarithmic axis, one
        panel per output over time in s; the band is twice the noise.
    """
    from matplotlib.patches import Patch

    used = next(iter(runs.values())).used
    figure, panels = new_figure([(1.9 + 1.4 * len(used)) / len(used)] * len(used))
    for i, axes in enumerate(panels):
        draw_error(axes, runs, noise, i)
    label(panels[-1], x="time in s")
    handles: list[Line2D | Patch] = [
        named_line(name, colour, width=1.3) for name, (colour, _) in zip(runs, _LOOKS, strict=False)
    ]
    if any(noise.get(name) for name in used):
        handles.append(Patch(color=BAND.light, label="twice the sensor's noise"))
    key(panels[0], columns=3, handles=handles)  # type: ignore[arg-type]
    return figure


def draw_error(axes: Axes, runs: Runs, noise: Mapping[str, float], i: int) -> None:
    """Draw the error of one output over time, on a logarithmic axis.

    Args:
        noise: Noise of each output, in the unit of the runs; the band is twice that. Without one no
            band is drawn.
    """
    before = next(iter(runs.values()))
    told = noise.get(before.used[i], 0.0)
    off = np.abs(before.error[:, i])
    typical = float(np.nanmedian(off[off > 0.0])) if np.any(off > 0.0) else 1.0
    level = max(told, 1e-9 * float(np.nanmax(off, initial=0.0))) if told else typical
    smallest, largest = level, 3 * level
    for run, (colour, _) in zip(runs.values(), _LOOKS, strict=False):
        if run.finite:
            time, rms = moving_rms(run.time, run.error[:, i])
            axes.plot(time, rms, color=colour.light, linewidth=1.3)
            smallest = min(smallest, float(np.nanmin(rms, initial=level)))
            largest = max(largest, float(np.nanmax(rms, initial=level)))
    axes.set_yscale("log")
    axes.set_ylim(0.5 * max(smallest, 1e-3 * level), 2 * largest)
    if told:
        axes.axhspan(1e-12, 2 * level, color=BAND.light, zorder=0)
        axes.axhline(level, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    decades(axes)
    label(axes, y=titled(f"error of {before.used[i]}", before.units[i]))


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
    """Return some of the samples of what was measured, which a slow sensor does now and then."""
    known = np.flatnonzero(np.isfinite(values))
    some = known[:: max(1, len(known) // _POINTS)]
    return time[some], values[some]


_SHOWN = 0.4


def diagnosis_law(located: MissingSignal) -> Figure:
    """Draw the located signal against the quantity that the effect depends on most."""
    figure, (axes,) = new_figure([2.7])
    _draw_law(axes, located)
    return figure


def _draw_law(axes: Axes, located: MissingSignal) -> None:
    """Draw a located signal and the law on it against its argument."""
    rows = np.flatnonzero(located.known)
    rows = rows[:: max(1, len(rows) // _POINTS)]
    along = located.argument
    x, unit_of_x = readably(along.values[rows], along.unit, along.shown)
    drawn = [(located.signal, MEASURED, 0.6, "from the measurements")]
    if located.law is not None:
        drawn.append((located.law, AFTER, 1.0, located.law_name))
    shown, unit = readably(
        np.array([values[rows] for values, *_ in drawn]), located.unit, located.shown
    )
    for values, (_, colour, alpha, name) in zip(shown, drawn, strict=True):
        look: dict[str, Any] = {"markersize": 3.2, "markeredgewidth": 0, "alpha": alpha}
        axes.plot(x, values, ".", color=colour.light, label=name, **look)
    axes.axhline(0.0, color=FAINT.light, linewidth=0.9, zorder=1)
    _limit(axes, shown)
    axes.margins(x=0.03)
    label(axes, x=titled(along.name, unit_of_x), y=titled(located.port, unit))
    key(axes, columns=2)
    legend = axes.get_legend()
    for handle in legend.legend_handles if legend is not None else ():
        handle.set_markersize(8.0)  # type: ignore[union-attr]


def diagnosis_signal(located: MissingSignal) -> Figure:
    """Draw the located signal over time with its band."""
    figure, (axes,) = new_figure([2.7])
    last = max(_SHOWN * np.ptp(located.time), 400 * float(located.time[1] - located.time[0]))
    rows = located.time <= located.time[0] + last
    rows &= np.maximum.accumulate(located.time) == located.time
    time = located.time[rows]
    told = [located.signal, located.std, *([] if located.law is None else [located.law])]
    (signal, std, *laws), unit = readably(
        np.array([values[rows] for values in told]), located.unit, located.shown
    )
    axes.fill_between(
        time, signal - 2 * std, signal + 2 * std, color=FAINT.light, alpha=0.45, linewidth=0
    )
    axes.plot(time, signal, color=MEASURED.light, linewidth=1.2, label="from the measurements")
    for law in laws:
        axes.plot(time, law, color=AFTER.light, linewidth=1.0, label=located.law_name)
        signal = np.concatenate([signal, law])
    _limit(axes, signal)
    label(axes, x="time in s", y=titled(located.port, unit))
    key(axes, columns=2)
    return figure


def _limit(axes: Axes, values: Vector) -> None:
    low, high = np.quantile(values, [0.002, 0.998])
    room = 0.15 * (high - low) or abs(high) or 1.0
    axes.set_ylim(min(low - room, -0.1 * room), max(high + room, 0.1 * room))


def diagnosis_location(
    before: Mapping[str, float], after: Mapping[str, float] | None = None
) -> Figure:
    """Draw how much an unknown input at each group of ports gains.

    Args:
        before: Log likelihood gained by group in the refitted nominal model, dimensionless.
        after: The same in the extended model, dimensionless; None if nothing was found.
    """
    groups = sorted(before, key=before.__getitem__)
    figure, (axes,) = new_figure([0.35 + 0.42 * len(groups)])
    place = np.arange(len(groups), dtype=float)
    height, shift = (0.36, 0.19) if after else (0.55, 0.0)
    models = (("refitted", before, BEFORE, shift), ("extended", after, AFTER, -shift))
    for name, values, colour, up in models:
        if values:
            lengths = [max(values.get(group, 0.0), 0.0) for group in groups]
            texts = [f"{length:.0f}" for length in lengths]
            bars(axes, place + up, lengths, texts, colour, height=height, name=name)
    axes.set_xscale("symlog", linthresh=10.0)
    axes.set_xlim(0.0, 8.0 * max(10.0, *before.values()))
    axes.set_yticks(place, [group.replace("_", " ") for group in groups])
    axes.grid(False, axis="y")
    axes.minorticks_off()
    label(axes, x="log likelihood gained by an unknown input there")
    handles, _ = axes.get_legend_handles_labels()
    key(axes, columns=2, handles=handles)  # type: ignore[arg-type]
    return figure


def diagnosis_nonparametric(
    argument: Argument, *, place: str, unit: str, shown: str = "", argument_shown: str = ""
) -> Figure:
    """Draw the classes of the located signal with their band, and the fitted curve on them.

    Args:
        unit: Unit of the curve; ``"1"`` for a fraction of the port's signal.
        shown: Unit declared for reading it; empty if none.
        argument_shown: The same of the argument.
    """
    if argument.bins is None:
        raise WorkbenchError(
            f"no curve over {argument.name} was fitted, so that there is nothing to draw; draw the"
            " located signal instead"
        )
    figure, (axes,) = new_figure([2.7])
    bins, shown = argument.bins, "%" if unit == "1" else shown
    x, unit_of_x = readably(bins.x, argument.unit, argument_shown)
    (mean, std, curve), read = readably(np.array([bins.mean, bins.std, bins.curve]), unit, shown)
    axes.fill_between(
        x,
        mean - std,
        mean + std,
        color=FAINT.light,
        alpha=0.45,
        linewidth=0,
        label="its scatter in a class",
    )
    axes.plot(x, mean, ".", color=MEASURED.light, markersize=6.0, label="from the measurements")
    axes.plot(x, curve, color=AFTER.light, linewidth=1.4, label="fitted curve")
    axes.axhline(0.0, color=FAINT.light, linewidth=0.9, zorder=1)
    axes.margins(x=0.03)
    label(
        axes,
        x=titled(argument.name, unit_of_x),
        y=f"{'change of ' if unit == '1' else ''}{titled(place, read)}",
    )
    handles, _ = axes.get_legend_handles_labels()
    # The measurements come first, as they do in every picture.
    key(axes, columns=3, handles=[*handles[1:], handles[0]])  # type: ignore[list-item]
    return figure


def diagnosis_answer(
    model: Model, runs: Runs, noise: Mapping[str, float], located: MissingSignal | None = None
) -> Figure:
    """Draw the first output where the refitted model is farthest off, its error, and the law.

    The runs are in SI; the model says in which units people read them.

    Args:
        noise: Noise of each output, in its SI unit.
    """
    heights = [1.7, 1.3] if located is None else [1.5, 1.2, 1.7]
    figure, panels = new_figure(heights, share_x=False)
    shown, errors = all_as_read(model, runs)
    draw_run(panels[0], shown, 0, farthest_off(shown["refitted"]))
    label(panels[0], x="time in s, where the refitted model is farthest off")
    draw_error(panels[1], errors, sizes_as_read(model, noise), 0)
    label(panels[1], x="time in s", y=titled("error", errors["refitted"].units[0]))
    key(panels[0], columns=3, handles=run_key(runs))
    if located is not None:
        _draw_law(panels[2], located)
    return figure
