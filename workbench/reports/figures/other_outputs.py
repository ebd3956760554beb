"""What controllers measure beside the outputs that they control."""

from __future__ import annotations

from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import (
    Part,
    nominal_runs,
    output_of,
    parts,
    shown,
    written,
)
from workbench.reports.pictures import Picture
from workbench.reports.style import key, label, new_figure
from workbench.study.result import StudyResult


def _draw(result: StudyResult, scenario: str, case: str, suffix: str) -> list[Picture]:
    runs = nominal_runs(result, scenario, case)
    drawn = (_drawn(result, scenario, case, suffix, part) for part in parts(result.study, runs))
    return [picture for picture in drawn if picture is not None]


def _drawn(
    result: StudyResult, scenario: str, case: str, suffix: str, part: Part
) -> Picture | None:
    outputs = {q.name for q in result.study.plant.build().outputs}
    names = sorted({name for r in part.runs.values() for name in r.traces.keys() & outputs})
    if not names:
        return None
    figure, panels = new_figure([1.6] * len(names))
    for axes, name in zip(panels, names, strict=True):
        quantity = output_of(result.study, name)
        for controller, record in part.runs.items():
            if name in record.traces:
                values = shown(record.traces[name], quantity)
                shade, time = part.shades[controller].light, record.traces["time"]
                axes.plot(time, values, color=shade, linewidth=1.2, label=controller)
        label(axes, y=f"{name.replace('_', ' ')} in {written(quantity.display_unit)}")
    label(panels[-1], x="time in s")
    key(panels[0])
    figure.align_ylabels()
    caption = f"{scenario}, {case or 'nominal plant'}: the other outputs that are measured."
    words = f"other measured outputs over time in {scenario}"
    return Picture(f"outputs-{suffix}{part.tail}", figure, caption, words)


OTHER_OUTPUTS = Figure("other-outputs", _draw, "scenario", order=20)
