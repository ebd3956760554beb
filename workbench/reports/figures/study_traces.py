"""What figures read of a study: the trajectories that its nominal runs kept, in display units."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from workbench.arrays import Vector
from workbench.model.quantities import Channel, Output
from workbench.model.units import from_si, with_unit, written_unit
from workbench.reports.style import Colour, shades, told_apart
from workbench.study.result import StudyResult
from workbench.study.study import Study
from workbench.study.tasks import Record


def vector(values: Any) -> Vector:
    """Return numbers as an array, in their own unit."""
    return np.asarray(values, dtype=float)


def nominal_runs(result: StudyResult, scenario: str, case: str = "") -> dict[str, Record]:
    """Return the runs on the nominal plant that kept their trajectories, by controller."""
    chosen = result.study.cases[result.study.nominal(case).case].controllers
    records = {c: result.record(c, scenario, case) for c in chosen}
    return {c: r for c, r in records.items() if r is not None and r.traces}


def shades_of(study: Study) -> dict[str, Colour]:
    """Return the colour of each controller of a study: one in all pictures, by name."""
    kin = {name: dict(study.report.kin).get(name, name) for name in study.controllers}
    given = shades(kin.values())
    return {name: given[other] for name, other in kin.items()}


class Part(NamedTuple):
    """What one of several pictures shows, in whose colours.

    Args:
        tail: What its file's name has behind that of the first.
    """

    tail: str
    runs: dict[str, Record]
    shades: dict[str, Colour]


def parts(study: Study, runs: Mapping[str, Record]) -> Iterator[Part]:
    """Yield runs, by controller, so that colours tell those of one picture apart."""
    every = shades_of(study)
    for i, names in enumerate(told_apart({name: every[name] for name in runs})):
        own = {name: every[name] for name in names}
        yield Part(f"-part-{i + 1}" if i else "", {name: runs[name] for name in names}, own)


def output_of(study: Study, name: str) -> Output:
    """Return an output of the plant by its name."""
    return next(q for q in study.plant.build().outputs if q.name == name)


def written(unit: str) -> str:
    """Return a unit as axes and tables write it."""
    return written_unit(unit) or "1"


def shown(values: Any, quantity: Channel) -> Vector:
    """Return SI values of an input or output in its display unit."""
    return from_si(vector(values), quantity.display_unit)


def value_text(value: float, unit: str, *, digits: int = 6) -> str:
    """Write a value, in SI, in a display unit.

    Example:
        >>> value_text(0.5235987755982988, "deg"), value_text(0.012, "mm")
        ('30°', '12 mm')
    """
    return with_unit(f"{round(float(from_si(value, unit)), 6):.{digits}g}", unit)


def point_text(study: Study, point: tuple[tuple[str, float], ...]) -> str:
    """Write where a controller was designed, each value in its display unit.

    Args:
        point: Names and values in SI.
    """
    known = {q.name: q.display_unit for q in study.plant.build().outputs}
    said = []
    for name, value in point:
        text = value_text(value, known[name]) if name in known else f"{value:g}"
        said.append(text if text.endswith("°") else f"{name} {text}")
    return ", ".join(said)


def breakable(text: str) -> str:
    """Let long names break, invisibly, where their words end, or a phone could not show them."""
    return re.sub(r"([A-Za-z])([._:])(?=[A-Za-z])", "\\1\\2\u200b", text)
