"""Distance to the physical limit: settling times over those of time-optimal moves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import output_of, shades_of, value_text
from workbench.reports.page import Block, Words, methods
from workbench.reports.pictures import Picture
from workbench.reports.style import REFERENCE, Colour, bars, key, label, new_figure, told_apart
from workbench.reports.tables import Cell, Table, number
from workbench.study.physical_limit import Distances, Move, StepDistance
from workbench.study.result import StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

MOST = 8
"""Steps that a picture shows; of more, each scenario shows its worst."""


def _draw_ratios(
    ratios: Mapping[str, Mapping[str, float]], shades: Mapping[str, Colour]
) -> Drawing:
    """Draw settling over the limit as a bar per controller and step, the limit at 1."""
    pitch = len(shades) + 0.8
    tops = pitch * np.arange(len(ratios))
    figure, (axes,) = new_figure([0.3 + 0.22 * pitch * len(ratios)])
    longest = 1.0
    for row, (name, shade) in enumerate(shades.items()):
        values = np.array([own.get(name, math.nan) for own in ratios.values()])
        texts = ["not settled" if math.isnan(value) else f"{value:.1f}" for value in values]
        bars(axes, tops + row, np.nan_to_num(values), texts, shade, height=0.85, name=name)
        longest = max(longest, float(np.nanmax(values, initial=1.0)))
    axes.axvline(1.0, color=REFERENCE.light, linewidth=1.2, linestyle="--", label="physical limit")
    axes.set_xlim(0.0, 1.18 * longest)
    axes.set_ylim(pitch * len(ratios) - 0.8, -0.8)
    axes.set_yticks(tops + 0.5 * (len(shades) - 1), list(ratios))
    axes.grid(False, axis="y")
    label(axes, x="settling time over the physical limit")
    key(axes, columns=3)
    return figure


def _pictures(result: StudyResult) -> list[Picture]:
    if all(math.isnan(s.limit.value) for s in result.distances.steps):
        return []
    ratios, every = _bars(result), shades_of(result.study)
    drawn = {n: every[n] for own in ratios.values() for n in own}
    caption = (
        "Settling time of each step over the shortest time that the nominal plant allows; "
        "a controller whose bar ends at the dashed line could not be faster."
    )
    words = "settling times of the controllers over the physical limit"
    return [
        Picture(
            "physical-limit" + (f"-part-{i + 1}" if i else ""),
            _draw_ratios(ratios, {name: drawn[name] for name in names}),
            caption,
            words,
        )
        for i, names in enumerate(told_apart(drawn))
    ]


def limit_blocks(result: StudyResult) -> list[Block]:
    """Return what the limit tells in words and tables; nothing if it was not asked for."""
    found = result.distances
    if not found.asked:
        return []
    missing, head = tuple(_missing(found)), ("scenario", "why there is none")
    return [
        Words(_lead(result)),
        *([_steps(result)] if found.steps else []),
        *([Table("Scenarios without a limit", head, missing)] if missing else []),
    ]


def _draw(result: StudyResult) -> list[Block]:
    told = limit_blocks(result)
    return [*told[:1], *_pictures(result), *told[1:]]


def _lead(result: StudyResult) -> str:
    said = []
    for name in result.study.controllers:
        own = [d for d in result.distances.worst if d.controller == name and d.worst]
        if not own:
            continue
        unsettled = [d for d in own if math.isnan(d.ratio.value)]
        if unsettled:
            said.append(f"{name} does not settle in {unsettled[0].scenario}")
            continue
        worst = max(own, key=lambda d: d.ratio.value)
        assert worst.worst is not None
        said.append(
            f"{name} takes {number(worst.ratio.value, 2)} times the limit of "
            f"{number(worst.worst.limit.value, unit='s')} at its worst step"
        )
    opening = "No controller settles faster than a time-optimal move of the plant."
    return f"{opening} {'; '.join(said)}." if said else f"{opening} No step has a limit here."


def _bars(result: StudyResult) -> dict[str, dict[str, float]]:
    known = [s for s in result.distances.steps if not math.isnan(s.limit.value)]
    several = len({s.scenario for s in known}) > 1
    found: dict[str, dict[str, float]] = {}
    for s in known:
        text = _step_text(result, s.move)
        own = found.setdefault(f"{s.scenario}\n{text}" if several else text, {})
        # A ratio that there is not is worse than any.
        own[s.controller] = float(np.maximum(own.get(s.controller, 0.0), s.ratio.value))
    if len(found) <= MOST:
        return found
    worst: dict[str, dict[str, float]] = {}
    for d in result.distances.worst:
        if d.worst is not None:
            worst.setdefault(d.scenario, {})[d.controller] = d.ratio.value
    return worst


def _step_text(result: StudyResult, move: Move) -> str:
    unit = output_of(result.study, move.output).display_unit
    return " to ".join(value_text(v, unit, digits=4) for v in (move.initial, move.final))


def _steps(result: StudyResult) -> Table:
    study, found = result.study, result.distances
    groups: dict[tuple[str, float, Move], dict[str, StepDistance]] = {}
    for s in found.steps:
        own = groups.setdefault((s.scenario, s.begin, s.move), {})
        before = own.setdefault(s.controller, s)
        if math.isnan(s.ratio.value) or s.ratio.value > before.ratio.value:
            own[s.controller] = s
    rows: list[tuple[Cell | str, ...]] = []
    for (scenario, begin, move), own in groups.items():
        limit = next(iter(own.values())).limit
        least = "none" if math.isnan(limit.value) else number(limit.value, unit="s")
        where = (scenario, _step_text(result, move), f"{begin:g} s")
        cells = (_cell(own.get(name)) for name in study.controllers)
        rows.append((*where, Cell(least, "", limit.reason), *cells))
    return Table(
        "Settling time of each step on the nominal plant, and how many times the limit it is",
        ("scenario", "step", "at", "physical limit", *study.controllers),
        tuple(rows),
    )


def _cell(step: StepDistance | None) -> Cell:
    if step is None:
        return Cell("–", "", "the run failed")
    if math.isnan(step.settling.value):
        return Cell("–", "", step.settling.reason)
    settling = number(step.settling.value, unit="s")
    if math.isnan(step.ratio.value):
        return Cell(settling)
    return Cell(settling, "", f"{number(step.ratio.value, 2)} ×")


def _missing(found: Distances) -> list[tuple[str, str]]:
    reasons = {d.scenario: d.ratio.reason for d in found.worst}
    compared = {s.scenario for s in found.steps}
    return [(name, why) for name, why in reasons.items() if name not in compared and why]


LIMIT = Figure(
    "limit", _draw, title="Distance to the physical limit", order=10, methods=methods("limit")
)
