"""A sliding mode in the plane of error and its rate, and its surface over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from workbench.arrays import Vector
from workbench.model.units import of_difference, parse_unit
from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import (
    nominal_runs,
    output_of,
    shades_of,
    shown,
    vector,
    written,
)
from workbench.reports.page import Block, Words
from workbench.reports.pictures import Picture
from workbench.reports.style import INK, REFERENCE, Colour, key, label, new_figure
from workbench.study.result import StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


def _portrait(
    name: str, error: Vector, rate: Vector, slope: float, shade: Colour, unit: str
) -> Drawing:
    """Draw error against its rate, with the direction in which errors decay on the surface."""
    figure, (axes,) = new_figure([3.0])
    far, fast = (1.05 * float(np.max(np.abs(v)) or 1.0) for v in (error, rate))
    ends = 1.05 * np.array([-fast / slope, fast / slope])
    dashes = {"color": REFERENCE.light, "linewidth": 1.0, "linestyle": "--"}
    axes.plot(ends, -slope * ends, label="rate = -slope x error", **dashes)  # type: ignore[arg-type]
    axes.plot(error, rate, color=shade.light, linewidth=1.1, label=name)
    axes.plot([0.0], [0.0], marker="+", color=INK.light, markersize=9, linestyle="none")
    axes.set_ylim(-1.05 * fast, 1.05 * fast)
    axes.set_xlim(-far, far)
    label(axes, x=f"error in {unit}", y=f"rate of the error in {unit}/s")
    key(axes, columns=2)
    return figure


def surface(time: Vector, value: Vector, shade: Colour) -> Drawing:
    """Draw the surface over the half width of its boundary layer.

    Args:
        time: Times, shape (n,), in s.
        value: Surface over the half width of its layer, shape (n,), dimensionless.
    """
    figure, (axes,) = new_figure([2.2])
    axes.plot(time, value, color=shade.light, linewidth=1.1)
    for limit in (-1.0, 1.0):
        axes.axhline(limit, color=REFERENCE.light, linewidth=0.9, linestyle=":")
    label(axes, x="time in s", y="s over layer")
    return figure


def _draw(result: StudyResult) -> list[Block]:
    shades = shades_of(result.study)
    found: list[Block] = []
    scenario = next(iter(result.study.scenarios))
    for number, (name, record) in enumerate(nominal_runs(result, scenario).items(), start=1):
        t = record.traces
        if "surface" not in t or "speed" not in t or "slope" not in t:
            continue
        output = next(n.removeprefix("reference.") for n in t if n.startswith("reference."))
        quantity = output_of(result.study, output)
        error = shown(t[f"reference.{output}"], quantity) - shown(t[f"output.{output}"], quantity)
        rate = -vector(t["speed"]) / parse_unit(quantity.display_unit).factor
        shade = shades[name]
        unit = written(of_difference(quantity.display_unit))
        portrait = _portrait(name, error, rate, float(t["slope"]), shade, unit)
        value = vector(t["surface"]) / float(t.get("layer", 1.0))
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
                surface(vector(t["time"]), value, shade),
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
