"""A part of the demonstration: a section of the page and the numbers behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from workbench.reports.page import Moving, Page, Section
from workbench.reports.pictures import Picture
from workbench.reports.tables import Cell, number


@dataclass(frozen=True)
class Part:
    """What one part of the demonstration found.

    Args:
        results: Its numbers, with the units in their names, for ``results.json``.
        first: What it has to show on the first screen, with a sentence; None if it is detail.
    """

    section: Section
    results: Mapping[str, Any] = field(default_factory=dict)
    first: Picture | Moving | None = None

    @property
    def marks(self) -> dict[str, int]:
        """How many requirements of the section are met, missed and open."""
        return Page("", "", (self.section,)).marks


def judged(value: float, low: float, high: float, digits: int = 3, *, unit: str = "") -> Cell:
    """Write a number, in ``unit``, with a mark for the band, in ``unit``, that it has to lie in."""
    if value != value:
        return Cell("–", "open")
    return Cell(number(value, digits, unit=unit), "met" if low <= value <= high else "missed")
