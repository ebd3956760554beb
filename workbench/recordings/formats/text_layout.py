"""Recognise how a text file is laid out: separator, decimal sign, header, units, comments."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date
from typing import Any

from workbench.errors import WorkbenchError
from workbench.recordings.headers import read_unit
from workbench.recordings.recording import Scalar

COMMENT_SIGNS = ("#", "%", "//")
SAVED_MARK = "# recording: "
_POINT = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
_COMMA = re.compile(r"^[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?$")
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "inf", "+inf", "-inf", "#n/a"}
_STAMP = re.compile(
    r"(?P<date>(?P<year>\d{4})([-/.])(?P<month>\d\d?)\3(?P<day>\d\d?)"
    r"|(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4}))?"
    r"(?:(?:(?<=\d)[T ]\s*)?(?P<clock>(?P<h>\d\d?):(?P<min>\d\d)(?::(?P<s>\d\d(?:[.,]\d*)?))?)"
    r"\s?(?:Z|UTC|[+-]\d\d:?\d\d)?)?"
)
Instant = tuple[float | None, float | None]
NEVER: Instant = (None, None)
_MILLENNIUM = date(2000, 1, 1).toordinal()
_SETTING = re.compile(r"^\s*([A-Za-z][\w ./()\[\]-]{0,60}?)\s*[:=]\s*(\S.*?)\s*$")


@dataclass(frozen=True)
class Layout:
    """How the rows of a text file are to be read.

    Args:
        separator: One character, or None for runs of blanks.
        units: Units from a row of units; empty if there is none.
        first: Index of the first row of numbers among the lines of the file.
    """

    separator: str | None
    decimal: str
    headers: tuple[str, ...]
    units: tuple[str, ...]
    width: int
    first: int
    metadata: dict[str, Scalar] = field(default_factory=dict)
    saved: dict[str, Any] | None = None


def split_line(line: str, separator: str | None) -> list[str]:
    """Split a line into cells, quotes removed.

    Example:
        >>> split_line('"0,5";2', ";")
        ['0,5', '2']
    """
    if separator is None:
        return line.split()
    if '"' in line:
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
        except (csv.Error, StopIteration):
            return [cell.strip().strip('"') for cell in line.split(separator)]
    return [cell.strip() for cell in line.split(separator)]


def is_comment(line: str) -> bool:
    """Tell whether a line is blank or a comment."""
    text = line.lstrip()
    return not text or text.startswith(COMMENT_SIGNS)


def is_number(cell: str, decimal: str = ".") -> bool:
    """Tell whether a cell holds a number."""
    return bool((_POINT if decimal == "." else _COMMA).match(cell))


def instant(cell: str) -> Instant:
    """Return the date that a cell holds, counted from 2000, and its time of day, both in s.

    Zones are not counted.

    Example:
        >>> instant("04.01.2000 06:00"), instant("2000-01-04T00:01:30.5Z"), instant("7:00")
        ((259200.0, 21600.0), (259200.0, 90.5), (None, 25200.0))
    """
    found = _STAMP.fullmatch(cell)
    if found is None:
        return NEVER
    day = clock = None
    if found["date"]:
        numbers = found.group(*(("year", "month", "day") if found["year"] else ("y", "m", "d")))
        try:
            day = 86400.0 * (date(*map(int, numbers)).toordinal() - _MILLENNIUM)
        except ValueError:
            return NEVER
    if found["clock"]:
        hour, minute, second = (
            float((n or "0").replace(",", ".")) for n in found.group("h", "min", "s")
        )
        clock = 3600.0 * hour + 60.0 * minute + second
    return day, clock


def is_missing(cell: str) -> bool:
    """Tell whether a cell says that there is no number."""
    return cell.lower() in _MISSING


def _numeric_share(cells: Sequence[str], decimal: str) -> float:
    if not any(is_number(c, decimal) for c in cells):
        return 0.0
    held = [is_number(c, decimal) or is_missing(c) or instant(c) != NEVER for c in cells]
    return sum(held) / len(cells)


def _candidates(lines: Sequence[str]) -> list[tuple[str | None, str]]:
    text = "\n".join(lines)
    out: list[tuple[str | None, str]] = []
    for separator in ("\t", ";", ",", "|", None):
        if separator is not None and separator not in text:
            continue
        out.append((separator, "."))
        if separator != ",":
            out.append((separator, ","))
    return out


def _first_row(rows: Sequence[list[str]], decimal: str, least: int) -> int | None:
    """Return where rows of numbers of equal width begin."""
    for i, cells in enumerate(rows):
        block = rows[i : i + 3]
        if (
            len(cells) >= least
            and all(len(r) == len(cells) for r in block)
            and all(_numeric_share(r, decimal) > 0.5 for r in block)
        ):
            return i
    return None


def _metadata(lines: Sequence[str]) -> tuple[dict[str, Scalar], dict[str, Any] | None]:
    found: dict[str, Scalar] = {}
    saved = None
    for line in lines:
        if line.startswith(SAVED_MARK):
            try:
                content = json.loads(line[len(SAVED_MARK) :])
            except (json.JSONDecodeError, RecursionError):
                continue
            saved = content if isinstance(content, dict) else None
            continue
        match = _SETTING.match(line.lstrip().lstrip("#%/ "))
        if match is not None and len(found) < 200:
            value = match.group(2)
            found[match.group(1)] = float(value) if _POINT.match(value) else value
    return found, saved


def detect_layout(lines: Sequence[str], *, source: str) -> Layout:
    """Recognise the layout with the most columns that holds for three rows in a row.

    Example:
        >>> layout = detect_layout(["# rig 2", "t;u", "0,0;5,1", "0,1;5,2", "0,2;5,3"], source="f")
        >>> layout.separator, layout.decimal, layout.headers
        (';', ',', ('t', 'u'))
    """
    body = [(i, line) for i, line in enumerate(lines) if not is_comment(line)]
    if not body:
        raise WorkbenchError(f"{source} holds no rows of numbers; it is empty or all comments")
    best: tuple[float, int, int, str | None, str] | None = None
    for separator, decimal in _candidates([line for _, line in body]):
        rows = [split_line(line, separator) for _, line in body]
        start = _first_row(rows, decimal, 2 if separator is not None else 1)
        if start is None:
            continue
        width = len(rows[start])
        alike = [r for r in rows[start : start + 40] if len(r) == width]
        # The share of numbers decides first: "0,5;2" split at its commas is wider, but not numbers.
        share = round(sum(_numeric_share(r, decimal) for r in alike) / len(alike), 1)
        if best is None or (share, width) > best[:2]:
            best = (share, width, start, separator, decimal)
    if best is None:
        raise WorkbenchError(
            f"{source} holds no rows of numbers that share one separator (tab, semicolon, comma or "
            f"blank); its first line is {body[0][1].strip()[:60]!r}"
        )
    _, width, start, separator, decimal = best
    headers, units, used = _titles(body, lines, start, separator, width)
    above = [line for i, line in enumerate(lines[: body[start][0]]) if i not in used]
    metadata, saved = _metadata(above)
    return Layout(separator, decimal, headers, units, width, body[start][0], metadata, saved)


def _titles(
    body: Sequence[tuple[int, str]],
    lines: Sequence[str],
    start: int,
    separator: str | None,
    width: int,
) -> tuple[tuple[str, ...], tuple[str, ...], set[int]]:
    """Find the header above the numbers, and a row of units below the header."""
    above = [(i, split_line(line, separator)) for i, line in body[:start]]
    above = [(i, cells) for i, cells in above if abs(len(cells) - width) <= 1]
    units: tuple[str, ...] = ()
    used: set[int] = set()
    if len(above) >= 2 and _all_units(above[-1][1]):
        i, cells = above.pop()
        used.add(i)
        units = tuple(c.strip("[]() ") for c in cells)
        units = (units + ("",) * width)[:width]
    if not above and not used:
        # The header may be the last comment line above the numbers.
        for i in range(body[start][0] - 1, -1, -1):
            text = lines[i].lstrip().lstrip("#%/ ").rstrip()
            cells = split_line(text, separator)
            if (
                is_comment(lines[i])
                and len(cells) == width
                and width > 1
                and not (lines[i].startswith(SAVED_MARK))
            ):
                return tuple(cells), units, {i}
    if not above:
        return (), units, used
    i, cells = above[-1]
    used.add(i)
    if len(cells) == width - 1 and separator is not None:
        cells = [*cells, ""]
    if len(cells) == width + 1 and not cells[-1]:
        cells = cells[:-1]
    if len(cells) != width:
        raise WorkbenchError(
            f"the header names {len(cells)} columns but the rows below have {width}; the header "
            f"begins with {', '.join(cells[:3])}"
        )
    return tuple(cells), units, used


def _all_units(cells: Sequence[str]) -> bool:
    texts = [c.strip("[]() ") for c in cells]
    filled = [t for t in texts if t]
    return bool(filled) and all(read_unit(t)[0] is not None for t in filled)
