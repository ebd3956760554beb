"""The section of a study about its parameter box."""

from __future__ import annotations

from workbench.reports.metrics_table import metric_title
from workbench.reports.page import Block, Section, Words
from workbench.reports.study_pictures import box_picture, breakable
from workbench.reports.tables import Cell, Table, number
from workbench.study.result import StudyResult
from workbench.study.study import Demand
from workbench.study.summary import parameter_text, score_text


def score_cell(value: float, *, capped: bool = False) -> Cell:
    """Write a score with its mark.

    Args:
        value: The score, a ratio.
        capped: Whether 10 stands for 10 and above.

    Example:
        >>> print(score_cell(0.8))
        0.80 ✓
    """
    return Cell(score_text(value, capped=capped), "met" if value <= 1.0 else "missed")


def demand_text(demand: Demand | str) -> str:
    """Write a requirement with the name of its metric in words.

    Example:
        >>> demand_text("settling_time at most 0.8 s")
        'settling time at most 0.8 s'
    """
    metric, _, rest = str(demand).partition(" ")
    return f"{metric_title(metric)} {rest}"


def box_section(outcome: StudyResult) -> list[Section]:
    """Build the section of the parameter box."""
    if not outcome.robustness or outcome.study.box is None:
        return []
    units = {q.name: q.unit for q in outcome.study.plant.build().parameters}

    def shown(name: str, value: float) -> str:
        return parameter_text(value, units[name])

    names = list(outcome.study.box.ranges)
    ends = ", ".join(
        f"{n} {shown(n, low)} to {shown(n, high)}"
        for n, (low, high) in outcome.study.box.ranges.items()
    )
    box = outcome.study.box
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
            for r in outcome.robustness
        ),
    )
    hurts = Table(
        "Change of the score from the lowest to the highest value of a parameter",
        ("controller", *map(breakable, names), "R²"),
        tuple(
            (r.controller, *(number(r.effects[n], 2) for n in names), number(r.explained, 2))
            for r in outcome.robustness
        ),
    )
    demands = dict.fromkeys(p.requirement for r in outcome.robustness for p in r.probabilities)
    by = {r.controller: {p.requirement: p for p in r.probabilities} for r in outcome.robustness}
    rows: list[tuple[Cell | str, ...]] = []
    for text in demands:
        row: list[Cell | str] = [demand_text(text)]
        for own in by.values():
            p = own.get(text)
            if p is None:
                row.append("–")
                continue
            share = f"{100 * p.share:.0f} %"
            row.append(Cell(share, "", f"{100 * p.low:.0f} to {100 * p.high:.0f} %"))
        rows.append(tuple(row))
    chances = Table(
        "Probability of meeting each requirement over the box",
        ("requirement", *by),
        tuple(rows),
        "Beside each number: its 95 % interval.",
    )
    blocks: tuple[Block, ...] = (words, box_picture(outcome), worst, hurts, chances)
    return [Section("robustness", "Robustness over a box of plants", blocks)]
