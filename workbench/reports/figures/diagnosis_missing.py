"""What is missing: the located signal with its law, its place, and the picture of the answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.diagnosis.location.missing_signal import MissingSignal
from workbench.diagnosis.nonparametric.result import Argument
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.model.units import readable, readably
from workbench.reports.figures.diagnosis_runs import (
    AFTER,
    BEFORE,
    as_read,
    draw_error,
    draw_run,
    farthest_off,
    run_key,
    sizes_as_read,
    titled,
)
from workbench.reports.style import FAINT, FONT_POINTS, INK, MEASURED, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POINTS = 1200
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
    y, unit = readably(located.signal[rows], located.unit, located.shown)
    x = readably(located.argument_values[rows], located.argument_unit, located.argument_shown)[0]
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
        law = readably(located.law[rows], located.unit, located.shown)[0]
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
        x=titled(located.argument, located.argument_unit, located.argument_shown),
        y=f"{located.port.replace('_', ' ')} in {unit}" if unit != "1" else located.port,
    )
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
    (signal, unit), (std, _) = (
        readably(values[rows], located.unit, located.shown)
        for values in (located.signal, located.std)
    )
    axes.fill_between(
        time, signal - 2 * std, signal + 2 * std, color=FAINT.light, alpha=0.45, linewidth=0
    )
    axes.plot(time, signal, color=MEASURED.light, linewidth=1.2, label="from the measurements")
    if located.law is not None:
        law = readably(located.law[rows], located.unit, located.shown)[0]
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
    bars = [("refitted", before, BEFORE, 0.19 if after else 0.0)]
    if after:
        bars.append(("extended", after, AFTER, -0.19))
    for name, values, colour, shift in bars:
        lengths = [max(values.get(group, 0.0), 0.0) for group in groups]
        axes.barh(place + shift, lengths, 0.36 if after else 0.55, color=colour.light, label=name)
        for y, length in zip(place + shift, lengths, strict=True):
            axes.text(
                max(length, 0.3) * 1.12,
                y,
                f"{length:.0f}",
                va="center",
                fontsize=FONT_POINTS - 1,
                color=INK.light,
            )
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

    Raises:
        WorkbenchError: If nothing was fitted over the argument.
    """
    if argument.bins is None:
        raise WorkbenchError(
            f"no curve over {argument.name} was fitted, so that there is nothing to draw; draw the"
            " located signal instead"
        )
    figure, (axes,) = new_figure([2.7])
    bins, shown = argument.bins, "%" if unit == "1" else shown
    x = readably(bins.x, argument.unit, argument_shown)[0]
    mean, std, curve = (
        readably(values, unit, shown)[0] for values in (bins.mean, bins.std, bins.curve)
    )
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
    name = place.replace("_", " ")
    label(
        axes,
        x=titled(argument.name, argument.unit, argument_shown),
        y=f"{'change of ' if unit == '1' else ''}{titled(name, unit, shown)}",
    )
    handles, _ = axes.get_legend_handles_labels()
    # The measurements come first, as they do in every picture.
    key(axes, columns=3, handles=[*handles[1:], handles[0]])  # type: ignore[list-item]
    return figure


def diagnosis_answer(
    model: Model,
    before: FreeRun,
    after: FreeRun | None,
    noise: Mapping[str, float],
    located: MissingSignal | None = None,
) -> Figure:
    """Draw the first output where the refitted model is farthest off, its error, and the law.

    The runs are in SI; the model says in which units people read them.

    Args:
        noise: Noise of each output, in its SI unit.
    """
    heights = [1.7, 1.3] if located is None else [1.5, 1.2, 1.7]
    figure, panels = new_figure(heights, share_x=False)
    first, then = as_read(model, before), after and as_read(model, after)
    draw_run(panels[0], first, then, 0, farthest_off(first))
    label(panels[0], x="time in s, where the refitted model is farthest off")
    error = as_read(model, before, errors=True)
    less = after and as_read(model, after, errors=True)
    draw_error(panels[1], error, sizes_as_read(model, noise), less, 0)
    label(panels[1], x="time in s", y=f"error in {readable(error.units[0])[0]}")
    key(panels[0], columns=3, handles=run_key(after))
    if located is not None:
        _draw_law(panels[2], located)
    figure.align_ylabels()
    return figure
