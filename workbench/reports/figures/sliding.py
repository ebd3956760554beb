"""A sliding mode in the plane of error and its rate, and its surface over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import nominal_runs, output_of, shown, vector, written
from workbench.reports.page import Block, Words
from workbench.reports.pictures import Picture
from workbench.reports.style import INK, REFERENCE, Colour, colours, key, label, new_figure
from workbench.study.result import StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


def phase_portrait(
    error: npt.ArrayLike,
    rate: npt.ArrayLike,
    *,
    slope: float,
    shade: Colour,
    name: str,
    unit: str = "°",
) -> Drawing:
    """Draw error against its rate, with the direction in which errors decay on the surface.

    Args:
        error: Reference minus output, shape (n,), in ``unit``.
        rate: Its rate where the reference rests, minus the speed, shape (n,), in ``unit`` per s.
        slope: Slope lambda of the surface, in 1/s.
        unit: Unit of the output as written.
    """
    figure, (axes,) = new_figure([3.0])
    x, v = np.asarray(error, dtype=float), np.asarray(rate, dtype=float)
    reach = 1.1 * float(np.max(np.abs(v)) or 1.0)
    ends = np.array([-reach / slope, reach / slope])
    axes.plot(
        ends,
        -slope * ends,
        color=REFERENCE.light,
        linewidth=1.0,
        linestyle="--",
        label="rate = -slope x error",
    )
    axes.plot(x, v, color=shade.light, linewidth=1.1, label=name)
    axes.plot([0.0], [0.0], marker="+", color=INK.light, markersize=9, linestyle="none")
    axes.set_ylim(-reach, reach)
    axes.set_xlim(-1.05 * float(np.max(np.abs(x)) or 1.0), 1.05 * float(np.max(np.abs(x)) or 1.0))
    label(axes, x=f"error in {unit}", y=f"rate of the error in {unit}/s")
    key(axes, columns=2)
    return figure


def surface(time: npt.ArrayLike, value: npt.ArrayLike, *, shade: Colour) -> Drawing:
    """Draw the surface over its boundary layer.

    Args:
        time: Times, shape (n,), in s.
        value: s over the half width of the layer, shape (n,), dimensionless.
    """
    figure, (axes,) = new_figure([2.2])
    axes.plot(time, value, color=shade.light, linewidth=1.1)
    for limit in (-1.0, 1.0):
        axes.axhline(limit, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    label(axes, x="time in s", y="s over layer")
    return figure


def _draw(result: StudyResult) -> list[Block]:
    shades = colours(result.study.controllers)
    found: list[Block] = []
    scenario = next(iter(result.study.scenarios))
    for number, (name, record) in enumerate(nominal_runs(result, scenario).items(), start=1):
        t = record.traces
        if "surface" not in t or "speed" not in t or "slope" not in t:
            continue
        output = next(n.removeprefix("reference.") for n in t if n.startswith("reference."))
        quantity = output_of(result.study, output)
        error = shown(t[f"reference.{output}"], quantity) - shown(t[f"output.{output}"], quantity)
        portrait = phase_portrait(
            error,
            -shown(t["speed"], quantity),
            slope=float(t["slope"]),
            shade=shades[name],
            name=name,
            unit=written(quantity.display_unit),
        )
        layer = float(t.get("layer", 1.0))
        found += [
            Picture(
                f"portrait-{number}",
                portrait,
                f"{name} in {scenario}: the error and its rate. Each loop is one step of the "
                "reference, which jumps sideways; the law follows a smoothed reference, so the "
                "way back bends.",
                "rate of the error over the error",
            ),
            Picture(
                f"surface-{number}",
                surface(t["time"], vector(t["surface"]) / layer, shade=shades[name]),
                f"{name} in {scenario}: s over the half width of its boundary layer (dotted: ± 1).",
                "sliding variable over time",
            ),
        ]
    if not found:
        return []
    words = Words(
        "Errors decay along the dashed direction once the surface is reached. The invariants "
        "that a baseline holds this controller to are the rms and the peak of s, and the time "
        "outside the boundary layer."
    )
    return [words, *found]


SLIDING = Figure("sliding", _draw, title="Sliding mode", order=20, folded=True)
