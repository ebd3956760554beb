"""Time and iterations of the optimisations of a controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import breakable, nominal_runs, vector
from workbench.reports.page import Block
from workbench.reports.pictures import Picture
from workbench.reports.style import REFERENCE, colours, key, label, new_figure
from workbench.reports.tables import Table, number
from workbench.study.result import StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

Vector = npt.NDArray[np.float64]


def solver(
    trajectories: Mapping[str, tuple[Vector, Vector, Vector]], *, deadline: float
) -> Drawing:
    """Draw solve times and iterations over time.

    Args:
        trajectories: Times in s, solve times in s and iterations, shape (n,) each, by controller;
            iterations that no solver tells are NaN and not drawn.
        deadline: Sample time, in s.
    """
    counted = any(
        np.isfinite(np.asarray(count, dtype=float)).any() for _, _, count in trajectories.values()
    )
    figure, panels = new_figure([1.8, 1.1] if counted else [2.4])
    times = panels[0]
    shades = colours(trajectories)
    for name, (time, seconds, count) in trajectories.items():
        shade = shades[name].light
        times.semilogy(time, 1e3 * np.asarray(seconds), color=shade, linewidth=1.0, label=name)
        if counted:
            panels[1].step(time, count, where="post", color=shade, linewidth=1.0)
    times.axhline(
        1e3 * deadline, color=REFERENCE.light, linewidth=1.0, linestyle="--", label="sample time"
    )
    label(times, y="solve time in ms")
    if counted:
        label(panels[1], y="iterations")
    label(panels[-1], x="time in s")
    key(times)
    figure.align_ylabels()
    return figure


def _draw(result: StudyResult) -> list[Block]:
    scenario = next(iter(result.study.scenarios))
    runs = {c: r for c, r in nominal_runs(result, scenario).items() if "solve_time" in r.traces}
    if not runs:
        return []
    deadline = result.study.scenarios[scenario].sample_time
    figure = solver(
        {
            c: (
                vector(r.traces["time"]),
                vector(r.traces["solve_time"]),
                vector(r.traces["iterations"]),
            )
            for c, r in runs.items()
        },
        deadline=deadline,
    )
    picture = Picture(
        "solver",
        figure,
        f"{scenario}: longest solve time among the samples that one point stands for, measured on "
        "the machine that ran the study.",
        "solve time and iterations over time",
    )
    rows = []
    for record in result.records:
        metrics = record.metrics
        if metrics is None or "fallbacks" not in metrics or record.variation != "nominal":
            continue
        status = record.traces.get("statuses", {})
        rows.append(
            (
                record.controller,
                record.scenario,
                number(1e3 * metrics["solve_time_median"].value, unit="ms"),
                number(1e3 * metrics["solve_time_p99"].value, unit="ms"),
                str(int(metrics["deadline_misses"].value)),
                str(int(metrics["fallbacks"].value)),
                breakable(", ".join(f"{count} x {word}" for word, count in status.items())) or "–",
            )
        )
    head = (
        "controller",
        "scenario",
        "solve, median",
        "solve, 99th percentile",
        "deadline misses",
        "fallbacks",
        "status",
    )
    return [picture, Table("How the solver ended, nominal plant", head, tuple(rows))]


SOLVER = Figure("solver", _draw, title="Optimisation at every sample", order=30, folded=True)
