"""Where a model lacks something: unknown inputs at each group of ports, before and after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from workbench.reports.figures.diagnosis_runs import AFTER, BEFORE
from workbench.reports.style import FONT_POINTS, INK, key, label, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
