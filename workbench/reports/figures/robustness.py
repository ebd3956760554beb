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
from workbench.study.judgements import RUN_FAILED
from workbench.study.result import StudyResult
from workbench.study.robustness import Robustness
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


def box_tables(result: StudyResult) -> list[Table]:
    """Return the worst plant of a box, what hurts most, and probabilities; none without a box."""
    if not result.robustness:
        return []
    units = {q.name: q.unit for q in result.study.plant.build().parameters}
    names = list(result.robustness[0].worst)

    def because(r: Robustness) -> str:
        if r.judgement is None:
            return "–"
        if r.judgement.reason.startswith(RUN_FAILED):
            # The reason stands with the failed runs.
            return RUN_FAILED
        return f"{metric_title(r.judgement.demand.requirement.metric)} {r.judgement.excess()}"

    def shown(name: str, r: Robustness) -> str:
        return parameter_text(r.worst[name], units[name])

    def hurt(name: str, r: Robustness) -> str:
        return number(r.effects[name], 2)

    by = {r.controller: {p.requirement: p for p in r.probabilities} for r in result.robustness}

    def chance(controller: str, text: str) -> Cell | str:
        if (p := by[controller].get(text)) is None:
            return "–"
        return Cell(f"{100 * p.share:.0f} %", "", f"{100 * p.low:.0f} to {100 * p.high:.0f} %")

    worst = Table.of(
        "Worst plant found in the box",
        result.robustness,
        {
            "controller": lambda r: r.controller,
            "score": lambda r: score_cell(r.worst_score, capped=True),
            **{breakable(name): partial(shown, name) for name in names},
            "because": because,
        },
    )
    hurts = Table.of(
        "Change of the score from the lowest to the highest value of a parameter",
        result.robustness,
        {
            "controller": lambda r: r.controller,
            **{breakable(name): partial(hurt, name) for name in names},
            "R²": lambda r: number(r.explained, 2),
        },
    )
    chances = Table.of(
        "Probability of meeting each requirement over the box",
        dict.fromkeys(p.requirement for r in result.robustness for p in r.probabilities),
        {"requirement": demand_text, **{name: partial(chance, name) for name in by}},
        "Beside each number: its 95 % interval.",
    )
    return [worst, hurts, chances]


def _draw(result: StudyResult) -> list[Block]:
    box = result.study.box
    if not result.robustness or box is None:
        return []
    units = {q.name: q.unit for q in result.study.plant.build().parameters}
    ends = ", ".join(
        f"{n} {' to '.join(parameter_text(end, units[n]) for end in ends)}"
        for n, ends in box.ranges.items()
    )
    words = Words(
        f"{box.draws} plants drawn from the box ({ends}) run {', '.join(box.scenarios)}; the worst"
        " is then searched. Dots are draws, crosses the search, the ring is the worst plant."
        + ("" if box.hard else " In this study the box informs and does not fail it.")
    )
    drawn = {r.controller: (r.scores, r.drawn) for r in result.robustness}
    picture = Picture(
        "box-scores",
        draw_scores(drawn, shades_of(result.study)),
        "Score of each controller at every plant of the box; right of the dashed line a hard "
        "requirement is missed.",
        "scores of the controllers over drawn plants",
    )
    return [words, picture, *box_tables(result)]


ROBUSTNESS = Figure(
    "robustness",
    _draw,
    title="Robustness over a box of plants",
    order=50,
    methods=methods("robustness"),
)
