"""What controllers measure beside the outputs that they control."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import (
    Vector,
    nominal_runs,
    output_of,
    shown,
    vector,
    written,
)
from workbench.reports.pictures import Picture
from workbench.reports.style import colours, key, label, new_figure
from workbench.study.result import StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


def other_outputs(trajectories: Mapping[str, tuple[Vector, Mapping[str, Vector]]]) -> Drawing:
    """Draw outputs of several controllers, one panel for each.

    Args:
        trajectories: Times in s, and outputs by what their axis says, shape (n,), by controller.
    """
    names = list(dict.fromkeys(n for _, own in trajectories.values() for n in own))
    figure, panels = new_figure([1.6] * len(names))
    shades = colours(trajectories)
    for axes, name in zip(panels, names, strict=True):
        for controller, (time, own) in trajectories.items():
            if name in own:
                shade = shades[controller].light
                axes.plot(time, own[name], color=shade, linewidth=1.2, label=controller)
        label(axes, y=name)
    label(panels[-1], x="time in s")
    key(panels[0])
    figure.align_ylabels()
    return figure


def _draw(result: StudyResult, scenario: str, case: str, suffix: str) -> list[Picture]:
    outputs = {q.name for q in result.study.plant.build().outputs}
    trajectories = {}
    for controller, record in nominal_runs(result, scenario, case).items():
        own = {}
        for name in record.traces.keys() & outputs:
            quantity = output_of(result.study, name)
            axis = f"{name.replace('_', ' ')} in {written(quantity.display_unit)}"
            own[axis] = shown(record.traces[name], quantity)
        if own:
            time = vector(record.traces["time"])
            trajectories[controller] = (time, dict(sorted(own.items())))
    if not trajectories:
        return []
    caption = f"{scenario}, {case or 'nominal plant'}: the other outputs that are measured."
    words = f"other measured outputs over time in {scenario}"
    return [Picture(f"outputs-{suffix}", other_outputs(trajectories), caption, words)]


OTHER_OUTPUTS = Figure("other-outputs", _draw, "scenario", order=20)
