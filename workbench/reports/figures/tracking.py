"""Closed-loop trajectories of several controllers, on the full and on the linear model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from workbench.model.units import convert
from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import nominal_runs, output_of, shown, vector, written
from workbench.reports.pictures import Picture
from workbench.reports.style import INK, REFERENCE, colours, key, label, new_figure
from workbench.study.result import StudyResult
from workbench.study.tasks import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """What is drawn of one controller's run.

    Args:
        controller: Name of the controller; sets the colour.
        time: Times, shape (n,), in s.
        output: Controlled output of the full plant, shape (n,), in the unit of the picture.
        command: Command, shape (n,), in its unit.
        linear: Output of the linear model under the same controller, shape (n,); None if not run.
    """

    controller: str
    time: Vector
    output: Vector
    command: Vector
    linear: Vector | None = None


def tracking(
    time: npt.ArrayLike,
    reference: npt.ArrayLike,
    trajectories: Sequence[Trajectory],
    *,
    quantity: str,
    unit: str,
    command: str,
    error_limit: float | None = None,
    lines: tuple[str, str] = ("full plant", "linear model"),
) -> Drawing:
    """Draw what several controllers did with one reference.

    Args:
        time: Times of the reference, shape (n,), in s.
        reference: Reference, shape (n,), in ``unit``.
        unit: Its unit as written.
        command: The command and its unit.
        error_limit: Steady error allowed, in ``unit``, drawn as lines about zero error.

    Returns:
        The figure: output, error and command over time in s.
    """
    from matplotlib.lines import Line2D

    figure, (position, error, actuator) = new_figure([2.2, 1.1, 1.0])
    t, reference = np.asarray(time, dtype=float), np.asarray(reference, dtype=float)
    position.step(t, reference, where="post", color=REFERENCE.light, linewidth=1.0)
    shades = colours(trajectory.controller for trajectory in trajectories)
    handles = []
    for trajectory in trajectories:
        shade = shades[trajectory.controller].light
        position.plot(trajectory.time, trajectory.output, color=shade, linewidth=1.5)
        held = reference[np.clip(np.searchsorted(t, trajectory.time, "right") - 1, 0, len(t) - 1)]
        error.plot(trajectory.time, held - trajectory.output, color=shade, linewidth=1.1)
        actuator.step(trajectory.time, trajectory.command, where="post", color=shade, linewidth=0.9)
        if trajectory.linear is not None:
            position.plot(trajectory.time, trajectory.linear, "--", color=shade, linewidth=1.0)
        handles.append(Line2D([], [], color=shade, linewidth=1.5, label=trajectory.controller))
    if error_limit:
        for limit in (-error_limit, error_limit):
            error.axhline(limit, color=REFERENCE.light, linewidth=0.9, linestyle=":")
        # Right after a step the error is the step; what matters is whether it comes to rest.
        error.set_ylim(-5.0 * error_limit, 5.0 * error_limit)
    handles.append(Line2D([], [], color=REFERENCE.light, linewidth=1.0, label="reference"))
    if any(trajectory.linear is not None for trajectory in trajectories):
        handles += [
            Line2D([], [], color=INK.light, linewidth=1.5, label=lines[0]),
            Line2D([], [], color=INK.light, linewidth=1.0, linestyle="--", label=lines[1]),
        ]
    label(position, y=f"{quantity} in {unit}")
    label(error, y=f"error in {unit}")
    label(actuator, x="time in s", y=command)
    key(position, columns=3, handles=handles)
    figure.align_ylabels()
    return figure


def _draw(result: StudyResult, scenario: str, case: str, suffix: str) -> list[Picture]:
    found = [_picture(result, scenario, case, f"tracking-{suffix}", nominal_runs)]
    if result.robustness:
        found.append(_picture(result, scenario, case, f"worst-{suffix}", _worst_runs))
    return [picture for picture in found if picture is not None]


def _worst_runs(result: StudyResult, scenario: str, case: str = "") -> dict[str, Record]:
    """Return the runs on the worst plant of the box, the nominal output in place of the linear."""
    nominal = nominal_runs(result, scenario, case)
    found = {}
    for own in result.robustness:
        for run in own.worst_runs:
            if run.scenario == scenario and run.traces and own.controller in nominal:
                other = nominal[own.controller].traces
                beside = {f"linear.{n[7:]}": other[n] for n in other if n.startswith("output.")}
                found[own.controller] = replace(run, traces={**run.traces, **beside})
    return found


def _picture(
    result: StudyResult,
    scenario: str,
    case: str,
    name_of_file: str,
    runs_of: Callable[[StudyResult, str, str], dict[str, Record]],
) -> Picture | None:
    runs = runs_of(result, scenario, case)
    if not runs:
        return None
    worst = runs_of is _worst_runs
    first = next(iter(runs.values())).traces
    command = next(name for name in first if name.startswith("input."))
    inputs = result.study.plant.build().inputs
    unit_in = next(q.unit for q in inputs if f"input.{q.name}" == command)
    name = next(n.removeprefix("reference.") for n in first if n.startswith("reference."))
    quantity = output_of(result.study, name)
    trajectories = [
        Trajectory(
            controller,
            vector(r.traces["time"]),
            shown(r.traces[f"output.{name}"], quantity),
            vector(r.traces[command]),
            shown(r.traces[f"linear.{name}"], quantity) if f"linear.{name}" in r.traces else None,
        )
        for controller, r in runs.items()
    ]
    steps = bool(result.study.scenarios[scenario].references[name].changes)
    unit, limit = written(quantity.display_unit), None
    if steps:
        limit = _limit(result, scenario, quantity.display_unit)
    figure = tracking(
        first["time"],
        shown(first[f"reference.{name}"], quantity),
        trajectories,
        quantity=name,
        unit=unit,
        command=f"{command.removeprefix('input.')} in {unit_in}",
        error_limit=limit,
        lines=("worst plant", "nominal plant") if worst else ("full plant", "linear model"),
    )
    dotted = f" (dotted: ± {limit:g}{unit if unit == '°' else f' {unit}'})" if limit else ""
    linear = any(t.linear is not None for t in trajectories)
    where = "each controller on its worst plant of the box" if worst else case or "nominal plant"
    tail = (
        " Dashed: the same controller on the nominal plant."
        if worst
        else " Dashed: the same controller on its linear model, with ideal sensors."
        if linear
        else " No linear run: the plant changes during the run."
    )
    caption = f"{scenario}, {where}: {name}, error{dotted} and command.{tail}"
    place = f"{scenario} on its worst plant" if worst else scenario
    words = f"{name}, error and command over time of {', '.join(runs)} in {place}"
    return Picture(name_of_file, figure, caption, words)


def _limit(result: StudyResult, scenario: str, unit: str) -> float | None:
    for demand in result.study.demands:
        limit = demand.requirement
        if limit.metric == "steady_error" and limit.scenario in ("", scenario):
            return float(convert(limit.limit, limit.unit, unit))
    return None


TRACKING = Figure("tracking", _draw, "scenario", order=10)
