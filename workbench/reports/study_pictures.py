"""Pictures of a study, drawn from the courses that its runs kept."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from workbench.model.units import from_si
from workbench.reports.figures.box_scores import box_scores
from workbench.reports.figures.sliding import phase_portrait, surface
from workbench.reports.figures.solver import solver
from workbench.reports.figures.tracking import Course, pressures, tracking
from workbench.reports.pictures import Picture
from workbench.reports.style import colours
from workbench.reports.tables import Table, number
from workbench.study.result import StudyResult
from workbench.study.tasks import Record


def breakable(text: str) -> str:
    """Let long names break where their words end, or a phone could not show them.

    Returns:
        The text with places, invisible, at which a line may end.

    Example:
        >>> len(breakable("joint.torque")) - len("joint.torque")
        1
    """
    return re.sub(r"([A-Za-z])([._:])(?=[A-Za-z])", "\\1\\2\u200b", text)


def _array(values: Any) -> Any:
    return np.asarray(values, dtype=float)


def _drawn(outcome: StudyResult, scenario: str, case: str = "") -> dict[str, Record]:
    nominal = outcome.study.nominal(case)
    chosen = outcome.study.cases[nominal.case].controllers
    records = {c: outcome.record(c, scenario, case) for c in chosen}
    return {c: r for c, r in records.items() if r is not None and r.traces}


def tracking_picture(
    outcome: StudyResult, scenario: str, index: str, case: str = ""
) -> list[Picture]:
    """Draw what every controller did in a scenario on the nominal plant.

    Returns:
        One picture per followed output; none if every run failed.
    """
    runs = _drawn(outcome, scenario, case)
    if not runs:
        return []
    where = case or "nominal plant"
    first = next(iter(runs.values())).traces
    model = outcome.study.plant.build()
    command = next(name for name in first if name.startswith("input."))
    unit_in = next(q.unit for q in model.inputs if f"input.{q.name}" == command)
    found = []
    for name in (n.removeprefix("reference.") for n in first if n.startswith("reference.")):
        quantity = next(q for q in model.outputs if q.name == name)
        unit = quantity.display_unit or quantity.unit

        def shown(values: Any, unit: str = unit) -> Any:
            return from_si(_array(values), unit)

        courses = [
            Course(
                controller,
                _array(r.traces["time"]),
                shown(r.traces[f"output.{name}"]),
                _array(r.traces[command]),
                shown(r.traces[f"linear.{name}"]) if f"linear.{name}" in r.traces else None,
            )
            for controller, r in runs.items()
        ]
        steps = bool(outcome.study.scenarios[scenario].references[name].changes)
        limit = _limit(outcome, scenario) if steps and unit == "deg" else None
        figure = tracking(
            first["time"],
            shown(first[f"reference.{name}"]),
            courses,
            quantity=name,
            unit=unit.replace("deg", "°"),
            command=f"{command.removeprefix('input.')} in {unit_in}",
            error_limit=limit,
        )
        dotted = f" (dotted: ± {limit:g}°)" if limit else ""
        linear = any(c.linear is not None for c in courses)
        caption = f"{scenario}, {where}: {name}, error{dotted} and command." + (
            " Dashed: the same controller on its linear model, with ideal sensors."
            if linear
            else " No linear run: the plant changes during the run."
        )
        words = f"{name}, error and command over time of {', '.join(runs)} in {scenario}"
        found.append(Picture(f"tracking-{index}", figure, caption, words))
    return found[:1]


def _limit(outcome: StudyResult, scenario: str) -> float | None:
    for demand in outcome.study.demands:
        wanted = demand.requirement
        if wanted.metric == "steady_error" and wanted.scenario in ("", scenario):
            return wanted.limit if wanted.unit == "deg" else math.degrees(wanted.limit)
    return None


def pressure_picture(
    outcome: StudyResult, scenario: str, index: str, case: str = ""
) -> list[Picture]:
    """Draw the pressures of both muscles in a scenario.

    Returns:
        One picture; none if the plant has no such pressures.
    """
    drawn = _drawn(outcome, scenario, case)
    runs = {c: r.traces for c, r in drawn.items() if "pressure_2" in r.traces}
    if not runs:
        return []
    figure = pressures(
        {
            c: (_array(t["time"]), _array(t["pressure_1"]), _array(t["pressure_2"]))
            for c, t in runs.items()
        }
    )
    caption = f"{scenario}, {case or 'nominal plant'}: gauge pressures of both muscles."
    return [Picture(f"pressures-{index}", figure, caption, f"pressures over time in {scenario}")]


def sliding_pictures(outcome: StudyResult) -> list[Picture]:
    """Draw phase portrait and surface of each sliding mode in the first scenario."""
    shades = colours(outcome.study.controllers)
    found = []
    scenario = next(iter(outcome.study.scenarios))
    for number_, (name, record) in enumerate(_drawn(outcome, scenario).items(), start=1):
        t = record.traces
        if "surface" not in t or "speed" not in t or "slope" not in t:
            continue
        error = np.degrees(_array(t["reference.angle"]) - _array(t["output.angle"]))
        rate = -np.degrees(_array(t["speed"]))
        portrait = phase_portrait(
            error, rate, slope=float(t["slope"]), shade=shades[name], name=name
        )
        found.append(
            Picture(
                f"portrait-{number_}",
                portrait,
                f"{name} in {scenario}: the error and its rate. Each loop is one step of the "
                "reference, which jumps sideways; the law follows a smoothed reference, so the "
                "way back bends.",
                "rate of the error over the error",
            )
        )
        layer = float(t.get("layer", 1.0))
        found.append(
            Picture(
                f"surface-{number_}",
                surface(t["time"], _array(t["surface"]) / layer, shade=shades[name]),
                f"{name} in {scenario}: s over the half width of its boundary layer (dotted: ± 1).",
                "sliding variable over time",
            )
        )
    return found


def solver_picture(outcome: StudyResult) -> tuple[Picture | None, Table | None]:
    """Draw solve times and iterations in the first scenario, and list how the solver ended.

    Returns:
        The picture and the table; None if no controller solves problems.
    """
    scenario = next(iter(outcome.study.scenarios))
    runs = {c: r for c, r in _drawn(outcome, scenario).items() if "solve_time" in r.traces}
    if not runs:
        return None, None
    deadline = outcome.study.scenarios[scenario].sample_time
    figure = solver(
        {
            c: (
                _array(r.traces["time"]),
                _array(r.traces["solve_time"]),
                _array(r.traces["iterations"]),
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
    for record in outcome.records:
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
    return picture, Table("How the solver ended, nominal plant", head, tuple(rows))


def box_picture(outcome: StudyResult) -> Picture:
    """Draw the scores over the parameter box."""
    figure = box_scores({r.controller: (r.scores, r.drawn) for r in outcome.robustness})
    return Picture(
        "box-scores",
        figure,
        "Score of each controller at every plant of the box; right of the dashed line a hard "
        "requirement is missed.",
        "scores of the controllers over drawn plants",
    )
