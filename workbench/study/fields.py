"""The schema of a study file: every field of ``fields.toml`` with its unit, range and example.

It is checked before anything is built, it says which keys there are, and the page of all fields is
written from it.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from controllers.uncertainty import Uncertainty
from workbench import checked_json
from workbench.checked_json import Place, Shape, ShapeError, anything, listed, named, one_of
from workbench.errors import WorkbenchError, check_choice
from workbench.model.units import quantity
from workbench.study.designs import Fastest
from workbench.study.study import Box, Limitations, Variation
from workbench.verification import Requirement, Scenario, Tolerance
from workbench.verification.scenario import EVENTS_S, FAULTS, RANGES_S, USUAL_SAMPLES
from workbench.verification.signals import BEGINS_S, FREQUENCIES_HZ

_FIXED = ("1", "s", "Hz")
"""Units that stand for one, whatever the plant: their numbers are converted as they are read."""


class ToldError(ShapeError):
    """An entry whose mistake is a whole sentence already."""


@dataclass(frozen=True)
class FieldTable:
    """A table of a study file whose fields are known.

    Args:
        partial: Whether needed fields may be missing, because another table may have them.
        others: Whether there may be other fields, such as the options of a plant or the keys of a
            reference of one's own.
    """

    fields: Mapping[str, Field]
    partial: bool = False
    others: bool = False

    def __call__(self, value: Any, place: Place) -> Any:
        """Accept a table that has the needed fields and no unknown ones."""
        found = dict(named(anything)(value, place))
        name = ".".join(map(str, place)) or "the study"
        for key, item in found.items():
            if key in self.fields:
                found[key] = self.fields[key](item, (*place, key))
            elif not self.others:
                try:
                    check_choice(f"key of {name}", key, self.fields)
                except WorkbenchError as error:
                    raise ToldError((*place, key), str(error)) from None
        if not self.partial:
            self.check_needed(found, place)
        return found

    def check_needed(self, table: Mapping[str, Any], place: Place) -> None:
        """Check that every needed field is there."""
        for key, field in self.fields.items():
            if field.needed and not table.get(key) and table.get(key) != 0:
                name = ".".join(map(str, place)) or "the study"
                raise ToldError(place, f"{name} has no {key!r}; add it")


@dataclass(frozen=True)
class Field:
    """An entry of a table.

    Args:
        example: How it is written in TOML; none for a table of fields.
        unit: Unit of a number without one, in words where it depends on another entry.
        range: Least and largest value, in ``unit``.
        usual: What holds where it is left out.
        needed: Whether it must be given.
    """

    shape: Shape
    text: str
    example: str = ""
    unit: str = ""
    range: tuple[float, float] | None = None
    usual: object = ""
    needed: bool = False

    def __call__(self, value: Any, place: Place) -> Any:
        """Accept what has the shape and is in the range; numbers of a fixed unit become SI."""
        return self._read(self.shape(value, place), place)

    def _read(self, value: Any, place: Place) -> Any:
        if isinstance(value, list):
            return [self._read(item, (*place, i)) for i, item in enumerate(value)]
        if isinstance(value, dict) and self.unit:
            return {name: self._read(item, (*place, name)) for name, item in value.items()}
        if not (self.unit in _FIXED or self.range) or isinstance(value, (bool, dict)):
            return value
        if isinstance(value, str) and self.unit and self.unit not in _FIXED:
            return value  # Who knows the unit reads it.
        unit = self.unit if self.unit in _FIXED else "1"
        try:
            given = quantity(str(place[-1]), value, unit)
        except WorkbenchError as error:
            raise ToldError(place, str(error)) from None
        if self.range is not None and not self.range[0] <= given <= self.range[1]:
            shown = f"{given:g}" if unit == "1" else f"{given:g} {unit}"
            raise ShapeError(place, f"is {shown}; the valid range is {self.valid}")
        return value if isinstance(value, int) and unit == "1" else given

    @property
    def valid(self) -> str:
        """The range in words; empty if there is none."""
        if self.range is None:
            return ""
        low, high = self.range
        unit = "" if self.unit == "1" or self.unit.startswith("`") else f" {self.unit}"
        if math.isinf(high):
            return f"{low:g}{unit} or more"
        return f"{low:g} to {high:g}{unit}"


_PLAIN: dict[str, Shape] = {
    name: getattr(checked_json, name)
    for name in ("anything", "flag", "number", "size", "text", "whole")
}
_CLASSES: dict[str, Any] = {
    "variation": Variation,
    "uncertainty": Uncertainty,
    "fastest": Fastest,
    "scenario": Scenario,
    "limitations": Limitations,
    "requirement": Requirement,
    "robustness": Box,
    "tolerance": Tolerance(),
}
"""What becomes of a table, and says what is usual in it."""

_RANGES = {"FREQUENCIES_HZ": FREQUENCIES_HZ, "BEGINS_S": BEGINS_S, "EVENTS_S": EVENTS_S}


def _tables() -> dict[str, FieldTable]:
    """Read the tables of ``fields.toml``; each holds those before it."""
    file = files("workbench.study").joinpath("fields.toml")
    found: dict[str, FieldTable] = {}
    for name, rows in tomllib.loads(file.read_text(encoding="utf-8")).items():
        partial, others = (rows.pop(key, False) for key in ("_partial", "_others"))
        fields: dict[str, Field] = {}
        for key, row in rows.items():
            if isinstance(row, list):
                fields[key] = _field(name, key, row, found)
                continue
            table, _, one = row.partition(".")
            fields |= found[table].fields if one == "*" else {key: found[table].fields[one]}
        found[name] = FieldTable(fields, partial, others)
    return found


def _field(table: str, key: str, row: Sequence[Any], known: Mapping[str, FieldTable]) -> Field:
    cells: list[Any] = [_FAULTS if cell == "one of FAULTS" else cell for cell in row]
    more: dict[str, Any] = cells.pop() if isinstance(cells[-1], dict) else {}
    if isinstance(ends := more.get("range"), str):
        more["range"] = RANGES_S[key] if ends == "RANGES_S" else _RANGES[ends]
    elif ends:
        more["range"] = tuple(ends)
    if more.get("usual") == "default" and table == "scenario" and key in USUAL_SAMPLES:
        more["usual"] = f"{USUAL_SAMPLES[key]} samples"
    elif more.get("usual") == "default":
        usual = getattr(_CLASSES[table], key)
        # Frequencies of classes are in rad/s.
        more["usual"] = usual / (2.0 * math.pi) if more.get("unit") == "Hz" else usual
        if isinstance(usual, tuple):
            more["usual"] = list(usual)
    words, *texts = cells
    return Field(_shape(words.replace(",", "").split(), known), *texts, **more)


_FAULTS = f"one of {', '.join(FAULTS)}"


def _shape(words: Sequence[str], known: Mapping[str, FieldTable]) -> Shape:
    first, rest = words[0], words[1:]
    if first == "one":
        return one_of(*rest[1:])
    if first == "named":
        return named(_shape(rest, known))
    if first == "list":
        length = int(rest[0]) if rest[0].isdigit() else None
        return listed(_shape(rest[1:] if length else rest, known), length=length)
    return _PLAIN.get(first) or known[first]


TABLES = _tables()
"""Shapes of the tables of a study file by name; that of the whole file is ``study``."""
