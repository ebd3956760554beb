"""What designs reach on machines that differ from what they know, and what costs most."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from workbench.model.units import with_unit
from workbench.reports.metrics_table import score_cell
from workbench.reports.tables import Cell, Table, number
from workbench.study.judgements import LARGEST

WORST = 12
"""Machines that are listed as the worst ones."""


@dataclass(frozen=True)
class Tried:
    """What one design does on one machine.

    Args:
        differs: What differs of the machine; nothing of the nominal one.
        values: Measured values by what is measured, each in the unit of its `Measured`; infinite
            where there is none.
        scores: Scores by what is required, ratios: at most 1 where it is met.
        reason: Why it could not be run; it then meets nothing.
    """

    controller: str
    machine: str
    differs: tuple[str, ...]
    values: Mapping[str, Sequence[float]] = field(default_factory=dict)
    scores: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""

    @property
    def score(self) -> float:
        """Worst score, a ratio."""
        return math.inf if self.reason else max(self.scores.values(), default=0.0)


@dataclass(frozen=True)
class Measured:
    """What is measured of every run.

    Args:
        words: Its name; with the limit where it is required.
        required: Whether it is.
    """

    words: str
    unit: str = "1"
    required: bool = False


Lines = Sequence[Measured]


def reached_table(runs: Sequence[Tried], lines: Lines, title: str) -> Table:
    """Return what each design reaches over machines that differ, a column for each design."""
    names = tuple(dict.fromkeys(run.controller for run in runs))
    drawn = {n: [r for r in runs if r.controller == n and r.differs] for n in names}
    nominal = {n: [r for r in runs if r.controller == n and not r.differs] for n in names}

    def meets(what: str) -> Callable[[Tried], bool]:
        return lambda run: run.scores.get(what, math.inf) <= 1.0

    def kept(holds: Callable[[Tried], bool]) -> tuple[Cell, ...]:
        counts = [(sum(map(holds, own)), len(own)) for own in drawn.values()]
        return tuple(Cell(f"{n} of {of}", "met" if n == of else "missed") for n, of in counts)

    def typical(of: Callable[..., float], what: str, among: Mapping[str, list[Tried]]) -> list[str]:
        found = [[v for run in own for v in run.values.get(what, ())] for own in among.values()]
        return [number(float(of(v)), 3) if v else "" for v in found]

    rows: list[tuple[Cell | str, ...]] = []
    if sum(line.required for line in lines) > 1:
        rows.append(("all of the limits", *kept(lambda run: run.score <= 1.0)))
    for line in lines:
        what, unit = line.words, with_unit("", line.unit).strip()
        unit = f" ({unit})" if unit else ""
        if line.required:
            rows.append((what, *kept(meets(what))))
        begin = "  " if line.required else f"{what}, "
        told = {
            "nominal": typical(max, what, nominal),
            "median": typical(np.median, what, drawn),
            "largest": typical(max, what, drawn),
        }
        rows += [(f"{begin}{word}{unit}", *cells) for word, cells in told.items() if any(cells)]
    count = len({run.machine for run in runs if run.differs})
    return Table(
        f"{title}: {count}",
        ("", *names),
        tuple(rows) if names else (),
        "A step that has not settled before the next one counts as infinitely slow.",
    )


def missed_table(runs: Sequence[Tried]) -> Table:
    """Return on how many machines with each difference a design misses a limit."""
    names = tuple(dict.fromkeys(run.controller for run in runs))
    kinds = tuple(dict.fromkeys(kind for run in runs for kind in run.differs))
    with_it = {kind: [run for run in runs if kind in run.differs] for kind in kinds}
    missed = {
        kind: [sum(run.controller == n and run.score > 1.0 for run in own) for n in names]
        for kind, own in with_it.items()
    }
    worst = sorted(kinds, key=lambda kind: -sum(missed[kind]) / len(with_it[kind]))
    machines = {kind: len({run.machine for run in own}) for kind, own in with_it.items()}
    return Table(
        "Machines on which a limit is missed, by what differs",
        ("what differs, alone or with others", "machines", *names),
        tuple(
            (kind.replace("_", " "), str(machines[kind]), *map(str, missed[kind])) for kind in worst
        ),
    )


def worst_table(runs: Sequence[Tried]) -> Table:
    """Return the machines on which most designs miss a limit, and by how much."""
    names = tuple(dict.fromkeys(run.controller for run in runs))
    machines: dict[str, dict[str, Tried]] = {}
    for run in runs:
        if run.differs:
            machines.setdefault(run.machine, {})[run.controller] = run

    def badness(own: Mapping[str, Tried]) -> tuple[int, float]:
        return sum(run.score > 1.0 for run in own.values()), sum(
            min(run.score, LARGEST) for run in own.values()
        )

    worst = sorted(machines.items(), key=lambda item: badness(item[1]), reverse=True)[:WORST]
    rows = []
    for name, own in worst:
        differs = ", ".join(next(iter(own.values())).differs).replace("_", " ")
        cells = (score_cell(own[n].score, capped=True) if n in own else "–" for n in names)
        rows.append((name, differs, *cells))
    title = "The worst machines: worst score of each design"
    note = "Score: what is measured over its limit; at most 1 means met."
    return Table(title, ("machine", "what differs", *names), tuple(rows), note)
