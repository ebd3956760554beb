"""A part of the demonstration: a section of the page and the numbers behind it."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

from workbench.reports.page import Block, Commands, Method, Moving, Page, Section, Words
from workbench.reports.pictures import Picture
from workbench.reports.tables import Cell, number

NONE: Mapping[str, Any] = {}


@dataclass(frozen=True)
class Part:
    """What one part of the demonstration found.

    Args:
        results: Its numbers, with the units in their names, for ``results.json``.
    """

    section: Section
    results: Mapping[str, Any] = field(default_factory=dict)
    first: Picture | Moving | None = None

    @property
    def marks(self) -> dict[str, int]:
        """How many requirements of the section are met, missed and open."""
        return Page("", "", (self.section,)).marks


@cache
def _texts() -> dict[str, Any]:
    return tomllib.loads(files("workbench.demo").joinpath("texts.toml").read_text(encoding="utf-8"))


def words(
    part: str, name: str = "words", *, values: Mapping[str, Any] = NONE, weight: str = "plain"
) -> Words:
    """Return a paragraph of a part, as ``texts.toml`` has it, with the values that it tells."""
    return Words(_texts()[part][name].format(**values), weight)


def method(part: str, *, values: Mapping[str, Any] = NONE) -> Method:
    """Return how the numbers of a part were computed, with the values that it tells."""
    entries = _texts()[part]["methods"].items()
    return Method(tuple((k.format(**values), text.format(**values)) for k, text in entries))


def section(
    name: str,
    title: str,
    part: str,
    blocks: Iterable[Block],
    command: str,
    values: Mapping[str, Any] = NONE,
) -> Section:
    """Return the section of a part: its words, its blocks, how they were found, and its command."""
    told = words(part, values=values), *blocks, method(part, values=values)
    return Section(name, title, (*told, Commands((command,))))


def judged(value: float, low: float, high: float, digits: int = 3, *, unit: str = "") -> Cell:
    """Write a number, in ``unit``, with a mark for the band, in ``unit``, that it has to lie in."""
    if value != value:
        return Cell("–", "open")
    return Cell(number(value, digits, unit=unit), "met" if low <= value <= high else "missed")
