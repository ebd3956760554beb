"""Tables of a page: words and numbers with a mark where something was required."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

from workbench.display import aligned_table
from workbench.errors import WorkbenchError
from workbench.model.units import RAISED

T = TypeVar("T")

Mark = Literal["", "met", "missed", "open"]

MARKS: dict[Mark, str] = {"": "", "met": "✓", "missed": "✗", "open": "–"}


@dataclass(frozen=True)
class Cell:
    """One entry of a table.

    Args:
        mark: Whether a requirement is met or missed, or ``"open"`` where it could not be judged.
    """

    text: str
    mark: Mark = ""
    reason: str = ""

    def __str__(self) -> str:
        return f"{self.text} {MARKS[self.mark]}".strip()


@dataclass(frozen=True)
class Table:
    """Rows under headings.

    Args:
        headings: Heading of each column, with the unit where all its numbers share one.
        rows: Rows of entries; plain words are entries without a mark.

    Example:
        >>> print(Table("Modes", ("angle in °", "frequency in Hz"), (("30", "2.1"),)))
        Modes
        angle in °  frequency in Hz
        30          2.1
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell | str, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for number, row in enumerate(self.rows, start=1):
            if len(row) != len(self.headings):
                raise WorkbenchError(
                    f"row {number} of table {self.title!r} has {len(row)} entries; its headings"
                    f" ask for {len(self.headings)}"
                )

    @classmethod
    def of(
        cls,
        title: str,
        items: Iterable[T],
        columns: Mapping[str, Callable[[T], Cell | str]],
        note: str = "",
    ) -> Table:
        """Return a table with a row for each item, and what its columns write of one.

        Example:
            >>> print(Table.of("Modes", (2.1, 4.2), {"frequency in Hz": number}))
            Modes
            frequency in Hz
            2.10
            4.20
        """
        rows = tuple(tuple(write(item) for write in columns.values()) for item in items)
        return cls(title, tuple(columns), rows, note)

    def told(self) -> Table:
        """Return the table without the columns in which nothing was computed."""
        empty = {Cell(""), Cell("–")}
        kept = [
            i for i, _ in enumerate(self.headings) if any(row[i] not in empty for row in self.cells)
        ]
        if not self.rows or len(kept) == len(self.headings):
            return self
        rows = tuple(tuple(row[i] for i in kept) for row in self.rows)
        return replace(self, headings=tuple(self.headings[i] for i in kept), rows=rows)

    @property
    def cells(self) -> tuple[tuple[Cell, ...], ...]:
        """Rows with every entry as a `Cell`."""
        return tuple(
            tuple(entry if isinstance(entry, Cell) else Cell(entry) for entry in row)
            for row in self.rows
        )

    def __str__(self) -> str:
        body = aligned_table(self.headings, self.cells, width=None)
        return "\n".join([self.title, body, *([self.note] if self.note else [])])


def plain(text: str) -> str:
    """Write names and signs as people read them; a port keeps its name.

    Example:
        >>> plain("arm_inertia +- 0.01"), plain("coulomb_friction at muscle_1.force")
        ('arm inertia ± 0.01', 'Coulomb friction at muscle_1.force')
    """
    words = re.sub(r"(?<![\w.])\w+(?![\w.]*\.\w)", lambda w: w[0].replace("_", " "), text)
    return _PEOPLE.sub(lambda name: _SPELLED[name[0]], words.replace("+-", "±"))


_SPELLED = {
    name.lower(): name for name in ("Bouc Wen", "Coulomb", "Dahl", "LuGre", "Maxwell", "Stribeck")
}
_PEOPLE = re.compile(rf"\b({'|'.join(_SPELLED)})\b")


def number(value: float, digits: int = 3, *, unit: str = "") -> str:
    """Write a number with a given number of significant digits, and none that mean nothing.

    Args:
        value: The number, in ``unit``.

    Example:
        >>> number(0.000123456), number(12345.6, unit="Pa"), number(float("nan"))
        ('0.000123', '12300 Pa', '–')
    """
    if value is None or math.isnan(value):
        return "–"
    suffix = f" {unit}" if unit else ""
    if isinstance(value, int):
        return f"{value}{suffix}".replace("-", "−")
    if math.isinf(value):
        return ("∞" if value > 0 else "−∞") + suffix
    if value == 0:
        return f"0{suffix}"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    rounded = round(value, places)
    # Rounding 0.9996 gains a digit before the point, which takes the place of one behind it.
    places = digits - 1 - math.floor(math.log10(abs(rounded)))
    text = f"{rounded:.{min(max(places, 0), 9)}f}"
    if abs(value) < 1e-4 or abs(value) >= 1e7:
        text = f"{value:.{digits - 1}e}"
    return text.replace("-", "−") + suffix


def plus_minus(value: float, std: float, digits: int = 3) -> str:
    """Write a number with its standard deviation, both by the power of ten of a number far from 1.

    Args:
        value: The number, in any unit.
        std: Its standard deviation, in the same unit.

    Example:
        >>> plus_minus(0.2512, 5.71e-5), plus_minus(-5.4545e9, 8.7e6)
        ('0.251 ± 0.000057', '(−5.45 ± 0.0087)·10⁹')
    """
    power = math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0
    if -5 < power < 7:
        places = 1 - math.floor(math.log10(std)) if 0.0 < std < 1e-3 else 0
        told = f"{std:.{places}f}" if 0 < places < 10 else number(std, 2)
        return f"{number(value, digits)} ± {told}"
    told = plus_minus(value / 10.0**power, std / 10.0**power, digits)
    return f"({told})·10{str(power).translate(RAISED)}"


def interval(low: float, high: float, digits: int = 3, *, unit: str = "") -> str:
    """Write the two ends of an interval.

    Args:
        low: Lower end, in ``unit``.
        high: Upper end, in ``unit``.

    Example:
        >>> interval(279.5, 280.5, 4)
        '279.5 … 280.5'
    """
    suffix = f" {unit}" if unit else ""
    return f"{number(low, digits)} … {number(high, digits)}{suffix}"
