"""Long tables, as databases of plants write them: one row per instant, signal and value."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from workbench.recordings.column_matching import is_time
from workbench.recordings.headers import read_header, read_unit

_MOST_SIGNALS = 200
_LEAST_ROWS = 8
_NUMERAL = re.compile(r"[+-]?[\d.,]+([eE][+-]?\d+)?")


class Long(NamedTuple):
    """Which columns of a long table hold what.

    Args:
        first: Index of the line of titles.
        time: Index of the column of instants, the others likewise.
        unit: Index of the column of units; None if there is none.
    """

    first: int
    titles: list[str]
    time: int
    name: int
    value: int
    unit: int | None


def long_table(rows: Sequence[list[str]], is_value: Callable[[str], bool]) -> Long | None:
    """Recognise a long table by its titles and first rows; None if it is no such table.

    One column is the time, one of words says which signal a row is of, the same ones again and
    again, and one other holds numbers.

    Args:
        rows: Cells of the first lines, none of them empty.
        is_value: Whether a cell holds a number, or says that there is none.
    """
    for first, titles in enumerate(rows):
        times = [k for k, title in enumerate(titles) if is_time(read_header(title))]
        below = [row for row in rows[first + 1 :] if len(row) == len(titles)]
        if len(times) == 1 and len(below) >= _LEAST_ROWS:
            break
    else:
        return None
    rest = [k for k in range(len(titles)) if k != times[0]]
    values = [k for k in rest if all(is_value(row[k]) for row in below)]
    # A number with the other decimal sign is no word.
    numbers = [k for k in rest if any(_NUMERAL.fullmatch(row[k]) for row in below)]
    words = [k for k in rest if k not in numbers and not any(is_value(row[k]) for row in below)]
    units = [k for k in words if all(_is_unit(row[k]) for row in below)]
    names = [k for k in words if k not in units]
    if len(values) != 1 or len(names) != 1 or len(units) > 1:
        return None
    kinds = {row[names[0]] for row in below}
    if not 2 <= len(kinds) <= min(_MOST_SIGNALS, len(below) // 3):
        return None
    return Long(first, titles, times[0], names[0], values[0], units[0] if units else None)


def _is_unit(cell: str) -> bool:
    return read_unit(cell.strip("[]() "))[0] is not None


def widened(rows: Iterable[list[str]], long: Long) -> list[list[str]]:
    """Return a long table as a wide one: its titles, then a row per instant.

    Args:
        rows: Cells of all lines below the titles.
    """
    signals: dict[str, str] = {}
    at: dict[str, dict[str, str]] = {}
    for row in rows:
        if len(row) != len(long.titles):
            continue
        name = row[long.name]
        unit = "" if long.unit is None else row[long.unit].strip("[]() ")
        signals.setdefault(name, f"{name} [{unit}]" if unit else name)
        at.setdefault(row[long.time], {})[name] = row[long.value]
    wide = [[instant, *(cells.get(s, "") for s in signals)] for instant, cells in at.items()]
    return [[long.titles[long.time], *signals.values()], *wide]
