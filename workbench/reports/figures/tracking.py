"""Closed-loop trajectories of several controllers: of their outputs, and of others they measure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.model.units import convert, of_difference, with_unit
from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import (
    Part,
    nominal_runs,
    output_of,
    parts,
    shades_of,
    shown,
    vector,
    written,
)
from workbench.reports.pictures import Picture
from workbench.reports.style import (
    INK,
    REFERENCE,
    Colour,
    colours,
    key,
    label,
    named_line,
    new_figure,
)
from workbench.study.result import StudyResult
from workbench.study.study import Study
from workbench.study.tasks import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


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
    size: float = 0.0,
    lines: tuple[str, str] = ("full plant", "linear model"),
    shades: Mapping[str, Colour] | None = None,
) -> Drawing:
    """Draw what several controllers did with one reference.

    Args:
        time: Times of the reference, shape (n,), in s.
        reference: Reference, shape (n,), in ``unit``.
        unit: Its unit as written.
        error_limit: Steady error allowed, in ``unit``, drawn as lines about zero error.
        size: Typical size of the output, in ``unit``: a millionth of it is no more than rounding.
    """
    figure, (position, error, actuator) = new_figure([2.2, 1.1, 1.0])
    t, reference = np.asarray(time, dtype=float), np.asarray(reference, dtype=float)
    position.step(t, reference, where="post", color=REFERENCE.light, linewidth=1.0)
    shades = shades or colours(trajectory.controller for trajectory in trajectories)
    handles = []
    for trajectory in trajectories:
        shade = shades[trajectory.controller].light
        position.plot(trajectory.time, trajectory.output, color=shade, linewidth=1.5)
        held = reference[np.clip(np.searchsorted(t, trajectory.time, "right") - 1, 0, len(t) - 1)]
        error.plot(trajectory.time, held - trajectory.output, color=shade, linewidth=1.1)
        actuator.step(trajectory.time, trajectory.command, where="post", color=shade, linewidth=0.9)
        if trajectory.linear is not None:
            position.plot(trajectory.time, trajectory.linear, "--", color=shade, linewidth=1.0)
        handles.append(named_line(trajectory.controller, shades[trajectory.controller], width=1.5))
    if error_limit:
        for limit in (-error_limit, error_limit):
            error.axhline(limit, color=REFERENCE.light, linewidth=0.9, linestyle=":")
        # Right after a step the error is the step; what matters is whether it comes to rest.
        error.set_ylim(-5.0 * error_limit, 5.0 * error_limit)
    for axes in (position, error):
        low, high = axes.get_ylim()
        room = max(0.5 * (1e-6 * size - (high - low)), 0.0)
        axes.set_ylim(low - room, high + room)
    handles.append(named_line("reference", REFERENCE, width=1.0))
    if any(trajectory.linear is not None for trajectory in trajectories):
        plain, dashed = lines
        handles.append(named_line(plain, INK, width=1.5))
        handles.append(named_line(dashed, INK, width=1.0, style="--"))
    label(position, y=f"{quantity} in {unit}")
    label(error, y=f"error in {of_difference(unit)}")
    label(actuator, x="time in s", y=command)
    key(position, columns=3, handles=handles)
    return figure


def tracked(
    study: Study,
    scenario: str,
    runs: Mapping[str, Record],
    output: str = "",
    *,
    window: tuple[float, float] | None = None,
    lines: tuple[str, str] = ("full plant", "linear model"),
) -> Drawing:
    """Draw what the runs of a scenario kept of their trajectories, by controller.

    Args:
        output: Output that they follow, the first by default. With the first of several stands the
            first command that moves, with the second the second.
        window: First and last time that is drawn, in s.
    """
    outputs = followed(runs)
    output = output or outputs[0]
    runs = {c: r for c, r in runs.items() if f"reference.{output}" in r.traces}
    first = next(iter(runs.values())).traces
    commands = [n.removeprefix("input.") for n in first if n.startswith("input.")]
    moved = [n for n in commands if any(np.ptp(r.traces[f"input.{n}"]) for r in runs.values())]
    command = (moved or commands)[: outputs.index(output) + 1][-1]
    quantity, plant = output_of(study, output), study.plant.build()
    driven = next(q for q in plant.inputs if q.name == command)

    def cut(own: Mapping[str, Any], name: str) -> Vector:
        low, high = window or (-math.inf, math.inf)
        time = vector(own["time"])
        return vector(own[name])[(time >= low - 1e-9) & (time <= high + 1e-9)]

    trajectories = [
        Trajectory(
            controller,
            cut(r.traces, "time"),
            shown(cut(r.traces, f"output.{output}"), quantity),
            shown(cut(r.traces, f"input.{command}"), driven),
            shown(cut(r.traces, f"linear.{output}"), quantity)
            if f"linear.{output}" in r.traces
            else None,
        )
        for controller, r in runs.items()
    ]
    return tracking(
        cut(first, "time"),
        shown(cut(first, f"reference.{output}"), quantity),
        trajectories,
        quantity=output,
        unit=written(quantity.display_unit),
        command=f"{command} in {written(driven.display_unit)}",
        error_limit=steady_limit(study, scenario, output),
        size=float(convert(quantity.scale, quantity.unit, of_difference(quantity.display_unit))),
        lines=lines,
        shades=shades_of(study),
    )


def followed(runs: Mapping[str, Record]) -> list[str]:
    """Return the outputs that runs follow a reference with, each once."""
    names = (name for run in runs.values() for name in run.traces)
    return list(
        dict.fromkeys(n.removeprefix("reference.") for n in names if n.startswith("reference."))
    )


def steady_limit(study: Study, scenario: str, output: str) -> float | None:
    """Return the steady error that a study allows after steps, in the display unit, or None."""
    for demand in study.demands:
        limit = demand.requirement
        if (
            limit.metric in ("steady_error", f"{output}.steady_error")
            and limit.scenario in ("", scenario)
            and study.scenarios[scenario].references[output].changes
        ):
            unit = of_difference(output_of(study, output).display_unit)
            return float(convert(limit.limit, limit.unit, unit))
    return None


def _draw(result: StudyResult, scenario: str, case: str, suffix: str) -> list[Picture]:
    nominal = nominal_runs(result, scenario, case)
    found = []
    if nominal:
        linear = any(n.startswith("linear.") for r in nominal.values() for n in r.traces)
        tail = (
            "Dashed: the same controller on its linear model, with ideal sensors."
            if linear
            else "No linear run: the plant changes during the run."
        )
        for part in parts(result.study, nominal):
            for i, output in enumerate(followed(part.runs)):
                figure = tracked(result.study, scenario, part.runs, output)
                name = f"tracking-{suffix}{part.tail}" + (f"-output-{i + 1}" if i else "")
                where = case or "nominal plant"
                found.append(_picture(result, scenario, output, figure, name, where, tail))
    worst = _worst_runs(result, scenario, nominal)
    for part in parts(result.study, worst):
        figure = tracked(result.study, scenario, part.runs, lines=("worst plant", "nominal plant"))
        where = "each controller on its worst plant of the box"
        tail = "Dashed: the same controller on the nominal plant."
        name = f"worst-{suffix}{part.tail}"
        output = followed(part.runs)[0]
        found.append(_picture(result, scenario, output, figure, name, where, tail))
    return found


def _worst_runs(
    result: StudyResult, scenario: str, nominal: Mapping[str, Record]
) -> dict[str, Record]:
    """Return the runs on the worst plant of the box, the nominal output in place of the linear."""
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
    output: str,
    figure: Drawing,
    name: str,
    where: str,
    tail: str,
) -> Picture:
    limit = steady_limit(result.study, scenario, output)
    unit = of_difference(output_of(result.study, output).display_unit)
    dotted = f" (dotted: ± {with_unit(f'{limit:g}', unit)})" if limit else ""
    caption = f"{scenario}, {where}: {output}, error{dotted} and command. {tail}"
    words = f"{output}, error and command over time in {scenario}, {where}"
    return Picture(name, figure, caption, words)


def _draw_others(result: StudyResult, scenario: str, case: str, suffix: str) -> list[Picture]:
    """Draw what controllers measure beside the outputs that they control."""
    runs = nominal_runs(result, scenario, case)
    drawn = (_others_in(result, scenario, case, suffix, part) for part in parts(result.study, runs))
    return [picture for picture in drawn if picture is not None]


def _others_in(
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
    caption = f"{scenario}, {case or 'nominal plant'}: the other outputs that are measured."
    words = f"other measured outputs over time in {scenario}"
    return Picture(f"outputs-{suffix}{part.tail}", figure, caption, words)


TRACKING = Figure("tracking", _draw, "scenario", order=10)
OTHER_OUTPUTS = Figure("other-outputs", _draw_others, "scenario", order=20)
