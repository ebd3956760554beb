"""Time and iterations of the optimisations of a controller."""

from __future__ import annotations

import math

import numpy as np

from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import Part, breakable, nominal_runs, parts, vector
from workbench.reports.page import Block
from workbench.reports.pictures import Picture
from workbench.reports.style import REFERENCE, decades, key, label, new_figure
from workbench.reports.tables import Table, number
from workbench.study.result import StudyResult
from workbench.study.study import NOMINAL
from workbench.study.tasks import Record


def _times(result: StudyResult, scenario: str, part: Part) -> Picture:
    # Iterations that no solver tells are NaN and not drawn.
    counts = {c: vector(r.traces["iterations"]) for c, r in part.runs.items()}
    counted = any(np.isfinite(count).any() for count in counts.values())
    figure, panels = new_figure([1.8, 1.1] if counted else [2.4])
    for name, record in part.runs.items():
        shade, time = part.shades[name].light, record.traces["time"]
        seconds = vector(record.traces["solve_time"])
        panels[0].semilogy(time, 1e3 * seconds, color=shade, linewidth=1.0, label=name)
        if counted:
            panels[1].step(time, counts[name], where="post", color=shade, linewidth=1.0)
    limit = 1e3 * result.study.scenarios[scenario].sample_time
    dashes = {"color": REFERENCE.light, "linewidth": 1.0, "linestyle": "--"}
    panels[0].axhline(limit, label="sample time", **dashes)  # type: ignore[arg-type]
    decades(panels[0])
    label(panels[0], y="solve time in ms")
    if counted:
        label(panels[1], y="iterations")
    label(panels[-1], x="time in s")
    key(panels[0])
    return Picture(
        f"solver{part.tail}",
        figure,
        f"{scenario}: longest solve time among the samples that one point stands for, measured on "
        "the machine that ran the study.",
        "solve time and iterations over time",
    )


def _draw(result: StudyResult) -> list[Block]:
    scenario = next(iter(result.study.scenarios))
    runs = {c: r for c, r in nominal_runs(result, scenario).items() if "solve_time" in r.traces}
    if not runs:
        return []
    pictures = [_times(result, scenario, part) for part in parts(result.study, runs)]

    def value(record: Record, metric: str) -> float:
        return record.metrics[metric].value if record.metrics else math.nan

    def status(record: Record) -> str:
        counts = record.traces.get("statuses", {}).items()
        return breakable(", ".join(f"{count} x {word}" for word, count in counts)) or "–"

    ended = Table.of(
        "How the solver ended, nominal plant",
        [r for r in result.records if "fallbacks" in (r.metrics or ()) and r.variation == NOMINAL],
        {
            "controller": lambda r: r.controller,
            "scenario": lambda r: r.scenario,
            "solve, median": lambda r: number(1e3 * value(r, "solve_time_median"), unit="ms"),
            "solve, 99th percentile": lambda r: number(1e3 * value(r, "solve_time_p99"), unit="ms"),
            "deadline misses": lambda r: str(int(value(r, "deadline_misses"))),
            "fallbacks": lambda r: str(int(value(r, "fallbacks"))),
            "status": status,
        },
    )
    return [*pictures, ended]


SOLVER = Figure("solver", _draw, title="Optimisation at every sample", order=30, folded=True)
