"""What controllers measure beside the outputs that they control."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import nominal_runs, output_of, shown, written
from workbench.reports.pictures import Picture
from workbench.reports.style import colours, key, label, new_figure, told_apart
from workbench.study.result import StudyResult
from workbench.study.tasks import Record


def _draw(result: StudyResult, scenario: str, case: str, suffix: str) -> list[Picture]:
    runs = nominal_runs(result, scenario, case)
    found: list[Picture] = []
    for i, part in enumerate(told_apart(runs)):
        name = f"outputs-{suffix}" + (f"-part-{i + 1}" if i else "")
        found += _drawn(result, scenario, case, name, {c: runs[c] for c in part})
    return found


def _drawn(
    result: StudyResult, scenario: str, case: str, title: str, runs: Mapping[str, Record]
) -> list[Picture]:
    outputs = {q.name for q in result.study.plant.build().outputs}
    names = sorted({name for r in runs.values() for name in r.traces.keys() & outputs})
    if not names:
        return []
    figure, panels = new_figure([1.6] * len(names))
    shades = colours(runs)
    for axes, name in zip(panels, names, strict=True):
        quantity = output_of(result.study, name)
        for controller, record in runs.items():
            if name in record.traces:
                values = shown(record.traces[name], quantity)
                shade, time = shades[controller].light, record.traces["time"]
                axes.plot(time, values, color=shade, linewidth=1.2, label=controller)
        label(axes, y=f"{name.replace('_', ' ')} in {written(quantity.display_unit)}")
    label(panels[-1], x="time in s")
    key(panels[0])
    figure.align_ylabels()
    caption = f"{scenario}, {case or 'nominal plant'}: the other outputs that are measured."
    words = f"other measured outputs over time in {scenario}"
    return [Picture(title, figure, caption, words)]


OTHER_OUTPUTS = Figure("other-outputs", _draw, "scenario", order=20)
