"""Robustness: scores of controllers over the plants of a parameter box."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from workbench.arrays import Vector
from workbench.reports.figure import Figure
from workbench.reports.figures.study_traces import breakable, shades_of
from workbench.reports.metrics_table import demand_text, metric_title, score_cell
from workbench.reports.page import Block, Words, methods
from workbench.reports.pictures import Picture
from workbench.reports.style import INK, REFERENCE, Colour, label, new_figure
from workbench.reports.tables import Cell, Table, number
from workbench.study.result import StudyResult
from workbench.study.summary import parameter_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


def draw_scores(scores: Mapping[str, tuple[Vector, int]], shades: Mapping[str, Colour]) -> Drawing:
    """Draw the score at every plant and how many were drawn, a line of dots per controller."""
    from matplotlib.ticker import FixedLocator, NullLocator

    figure, (axes,) = new_figure([0.6 + 0.5 * len(scores)])
    rng = np.random.default_rng(0)
    for row, (name, (values, drawn)) in enumerate(scores.items()):
        # Spread a little, so that equal scores do not hide each other.
        place = row + rng.uniform(-0.16, 0.16, len(values))
        shade = shades[name].light
        axes.plot(values[:drawn], place[:drawn], "o", color=shade, markersize=4.5, alpha=0.75)
        axes.plot(values[drawn:], place[drawn:], "x", color=shade, markersize=5)
        worst = int(np.argmax(values))
        axes.plot(values[worst], place[worst], "o", markersize=9, fillstyle="none", color=INK.light)
    axes.axvline(1.0, color=REFERENCE.light, linewidth=1.2, linestyle="--")
    axes.set_xscale("log")
    low = min(float(values.min()) for values, _ in scores.values())
    ticks = [t for t in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0) if t >= 0.6 * low]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(ticks, [f"{t:g}" if t < 10 else "≥ 10" for t in ticks])
    axes.set_xlim(0.8 * min(low, 0.9), 13.0)
    axes.set_yticks(range(len(scores)), list(scores))
    axes.set_ylim(len(scores) - 0.5, -0.5)
    axes.grid(False, axis="y")
    label(axes, x="score; at most 1 means met")
    return figure


def _draw(result: StudyResult) -> list[Block]:
    if not result.robustness or result.study.box is None:
        return []
    units = {q.name: q.unit for q in result.study.plant.build().parameters}

    def shown(name: str, value: float) -> str:
        return parameter_text(value, units[name])

    names = list(result.study.box.ranges)
    ends = ", ".join(
        f"{n} {shown(n, low)} to {shown(n, high)}"
        for n, (low, high) in result.study.box.ranges.items()
    )
    box = result.study.box
    scenarios = ", ".join(box.scenarios)
    words = Words(
        f"{box.draws} plants drawn from the box ({ends}) run {scenarios}; the worst is then "
        "searched. Dots are draws, crosses the search, the ring is the worst plant."
        + ("" if box.hard else " In this study the box informs and does not fail it.")
    )
    worst = Table(
        "Worst plant found",
        ("controller", "score", *map(breakable, names), "because"),
        tuple(
            (
                r.controller,
                score_cell(r.worst_score, capped=True),
                *(shown(n, r.worst[n]) for n in names),
                f"{metric_title(r.judgement.demand.requirement.metric)} {r.judgement.excess()}"
                if r.judgement
                else "–",
            )
            for r in result.robustness
        ),
    )
    hurts = Table(
        "Change of the score from the lowest to the highest value of a parameter",
        ("controller", *map(breakable, names), "R²"),
        tuple(
            (r.controller, *(number(r.effects[n], 2) for n in names), number(r.explained, 2))
            for r in result.robustness
        ),
    )
    demands = dict.fromkeys(p.requirement for r in result.robustness for p in r.probabilities)
    by = {r.controller: {p.requirement: p for p in r.probabilities} for r in result.robustness}

    def chance(controller: str, text: str) -> Cell | str:
        if (p := by[controller].get(text)) is None:
            return "–"
        return Cell(f"{100 * p.share:.0f} %", "", f"{100 * p.low:.0f} to {100 * p.high:.0f} %")

    chances = Table.of(
        "Probability of meeting each requirement over the box",
        demands,
        {"requirement": demand_text, **{name: partial(chance, name) for name in by}},
        "Beside each number: its 95 % interval.",
    )
    drawn = {r.controller: (r.scores, r.drawn) for r in result.robustness}
    picture = Picture(
        "box-scores",
        draw_scores(drawn, shades_of(result.study)),
        "Score of each controller at every plant of the box; right of the dashed line a hard "
        "requirement is missed.",
        "scores of the controllers over drawn plants",
    )
    return [words, picture, worst, hurts, chances]


ROBUSTNESS = Figure(
    "robustness",
    _draw,
    title="Robustness over a box of plants",
    order=50,
    methods=methods("robustness"),
)
