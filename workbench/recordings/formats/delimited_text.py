"""Tables of numbers in text files: any separator and encoding, plain or compressed, any length."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import json
import math
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import chain, product, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.model.units import convert, same_dimension
from workbench.recordings.columns import Columns, Thinner, titles
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.instants import NEVER, begins_with_day, instant, start_at_zero
from workbench.recordings.formats.long_table import Long, long_table, widened
from workbench.recordings.headers import read_header, read_unit
from workbench.recordings.recording import Scalar

COMMENT_SIGNS = ("#", "%", "//")
SAVED_MARK = "# recording: "
_POINT = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
_COMMA = re.compile(r"^[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?$")
_GROUPED = {
    ".": re.compile(r"^[+-]?\d{1,3}(,\d{3})+(\.\d*)?$"),
    ",": re.compile(r"^[+-]?\d{1,3}(\.\d{3})+(,\d*)?$"),
}
"""Numbers with thousands set apart, by the decimal sign. Both signs, or one twice, tell which."""
_APOSTROPHES = re.compile(r"^[+-]?\d{1,3}(['’]\d{3})+([.,]\d*)?$")
"""Thousands as the Swiss set them apart."""
_REMARKS = ("", "comment", "comments", "remark", "remarks")
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "inf", "+inf", "-inf", "#n/a"}
_WORDS = {"true": 1.0, "false": 0.0, "on": 1.0, "off": 0.0, "good": 1.0, "bad": 0.0}
_SETTING = re.compile(r"^\s*([A-Za-z][\w ./()\[\]-]{0,60}?)\s*[:=]\s*(\S.*?)\s*$")


@dataclass(frozen=True)
class Layout:
    """How the rows of a text file are to be read.

    Args:
        separator: One character, or None for runs of blanks.
        units: Units from a row of units, or of what stands in every cell; empty if there are none.
        measured: Unit to which the numbers of a column are brought whose cells have their own;
            empty if they have none.
        first: Index of the first row of numbers among the lines of the file.
        words: Numbers that words stand for, dimensionless, by the word in lower case.
        day_first: Whether 3/4/2024 is a day of April.
    """

    separator: str | None
    decimal: str
    headers: tuple[str, ...]
    units: tuple[str, ...]
    width: int
    first: int
    metadata: dict[str, Scalar] = field(default_factory=dict)
    saved: dict[str, Any] | None = None
    words: Mapping[str, float] = field(default_factory=dict)
    day_first: bool = False
    measured: tuple[str, ...] = ()


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
    if _APOSTROPHES.match(cell):
        cell = _joined(cell)
    return bool((_POINT if decimal == "." else _COMMA).match(cell)) or _tells(cell, decimal)


def _joined(cell: str) -> str:
    return re.sub("['’]", "", cell)


def _tells(cell: str, decimal: str) -> bool:
    """Tell whether a cell shows by its thousands which sign is the decimal one."""
    return cell.count(".") + cell.count(",") > 1 and bool(_GROUPED[decimal].match(cell))


_MEASURED = re.compile(r"([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*([^\W\d_].*|[°%].*)")


def with_its_unit(cell: str) -> tuple[str, str]:
    """Return the number and the unit of a cell that holds both; two empty texts of any other.

    Example:
        >>> with_its_unit("950.2 mV"), with_its_unit("10:20:30")
        (('950.2', 'mV'), ('', ''))
    """
    found = _MEASURED.fullmatch(cell)
    return (found[1], found[2]) if found and _known(found[2]) else ("", "")


@lru_cache(maxsize=256)
def _known(unit: str) -> str:
    """Return a unit without what it counts from; empty if it is none, or is an empty text."""
    return (unit and read_unit(unit)[0]) or ""


def _numeral(cell: str) -> str:
    return with_its_unit(cell)[0] or cell


def is_missing(cell: str) -> bool:
    """Tell whether a cell says that there is no number."""
    return cell.lower() in _MISSING


def _numeric_share(cells: Sequence[str], decimal: str) -> float:
    if not any(is_number(_numeral(c), decimal) for c in cells):
        return 0.0
    # "Sample Interval,0.02,,," above a table is no row of it.
    held = [
        is_number(_numeral(c), decimal) or c.lower() in _WORDS or instant(c) != NEVER
        for c in cells
        if not is_missing(c)
    ]
    return sum(held) / len(held)


def _candidates(lines: Sequence[str]) -> list[tuple[str | None, str]]:
    text = "\n".join(lines)
    found = [sign for sign in ("\t", ";", ",", "|", None) if sign is None or sign in text]
    return [(sign, decimal) for sign in found for decimal in ".," if sign != decimal]


def _first_row(rows: Sequence[list[str]], decimal: str, least: int, numbers: float) -> int | None:
    """Return where rows of equal width begin of which more than a share is numbers."""

    def begins(i: int) -> bool:
        alike = len({len(row) for row in rows[i : i + 3]}) == 1 and len(rows[i]) >= least
        return alike and all(_numeric_share(row, decimal) > numbers for row in rows[i : i + 3])

    return next(filter(begins, range(len(rows))), None)


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
    found: list[tuple[tuple[float, bool, int], int, str | None, str]] = []
    # Beside a machine's states in words there may be few numbers.
    for numbers, (separator, decimal) in product(
        (0.5, 0.0), _candidates([line for _, line in body])
    ):
        if found and numbers == 0.0:
            break
        rows = [split_line(line, separator) for _, line in body]
        start = _first_row(rows, decimal, 2 if separator is not None else 1, numbers)
        if start is None:
            continue
        width = len(rows[start])
        alike = [r for r in rows[start : start + 40] if len(r) == width]
        # The share of numbers decides first: "0,5;2" split at its commas is wider, but not numbers.
        share = round(sum(_numeric_share(r, decimal) for r in alike) / len(alike), 1)
        # A blank may also stand between the date and the time of day in a cell.
        found.append(((share, separator is not None, width), start, separator, decimal))
    if not found:
        raise WorkbenchError(
            f"{source} holds no rows of numbers that share one separator (tab, semicolon, comma or "
            f"blank); its first line is {body[0][1].strip()[:60]!r}"
        )
    (_, _, width), start, separator, decimal = max(found, key=lambda ranked: ranked[0])
    rows = [split_line(line, separator) for _, line in body[start:]]
    other = "." if decimal == "," else ","
    if any(_tells(cell, other) for row in rows for cell in row):
        decimal = other
    headers, units, used = _titles(body, lines, start, separator, width)
    above = [line for i, line in enumerate(lines[: body[start][0]]) if i not in used]
    metadata, saved = _metadata(above)
    # An oscilloscope writes start and step of its time among the units.
    metadata |= {h: float(u) for h, u in zip(headers, units, strict=False) if is_number(u)}
    units = tuple("" if is_number(u) else u for u in units)
    measured = _units_of_cells([row for row in rows if len(row) == width], headers)
    if any(measured):
        units = tuple(m or u for m, u in zip(measured, units or ("",) * width, strict=True))
    return Layout(
        separator, decimal, headers, units, width, body[start][0], metadata, saved,
        measured=measured,
    )  # fmt: skip


def _units_of_cells(rows: Sequence[Sequence[str]], headers: Sequence[str]) -> tuple[str, ...]:
    """Return the unit in which a column is read whose cells all have one: the header's, if told."""
    found = []
    for column, header in zip_longest(zip(*rows, strict=True), headers, fillvalue=""):
        texts = dict.fromkeys(with_its_unit(cell)[1] for cell in column if not is_missing(cell))
        first, told = next(iter(texts), ""), read_header(header).unit
        alike = first and all(
            text and same_dimension(_known(text), _known(first)) for text in texts
        )
        of_header = told and alike and same_dimension(told, _known(first))
        found.append("" if not alike else told if of_header else first)
    return tuple(found)


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
    if len(above) >= 2 and (told := _units(above[-1][1])):
        used.add(above.pop()[0])
        units = (told + ("",) * width)[:width]
    if not above and not used:
        # The header may be the last comment line above the numbers.
        for i in range(body[start][0] - 1, -1, -1):
            cells = split_line(lines[i].lstrip().lstrip("#%/ ").rstrip(), separator)
            comment = is_comment(lines[i]) and not lines[i].startswith(SAVED_MARK)
            if comment and len(cells) == width > 1:
                return tuple(cells), units, {i}
    if not above:
        return (), units, used
    i, cells = above[-1]
    used.add(i)
    if len(cells) == width - 1 and separator is not None:
        cells = [*cells, ""]
    if len(cells) == width + 1 and cells[-1].lower() in _REMARKS:
        cells = cells[:-1]
    if len(cells) != width:
        raise WorkbenchError(
            f"the header names {len(cells)} columns but the rows below have {width}; the header "
            f"begins with {', '.join(cells[:3])}"
        )
    return tuple(cells), units, used


def _units(cells: Sequence[str]) -> tuple[str, ...]:
    """Return what a row of units holds, with numbers among them; nothing if it is none."""
    texts = tuple(c.strip("[]() ") for c in cells)
    known = [bool(t) and read_unit(t)[0] is not None for t in texts]
    numbers = [is_number(t) for t in texts]
    whole = all(k for k, t in zip(known, texts, strict=True) if t)
    if not any(known) or not (any(numbers) or whole):
        return ()
    return tuple(t if k or n else "" for t, k, n in zip(texts, known, numbers, strict=True))


_LOOK_AHEAD = 400
_PIECE = 1 << 16
_BLOCK = 1 << 22
_MAX_LINE = 1 << 20
_MARKS = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))


def guess_encoding(start: bytes, source: str) -> str:
    r"""Guess the encoding of a text from its first bytes; ``latin-1`` reads what is not UTF-8."""
    for mark, name in _MARKS:
        if start.startswith(mark):
            return name
    if b"\x00" in start:
        raise WorkbenchError(f"{source} is not a text file; its ending must tell what it is")
    try:
        # The last bytes may be half a character.
        start[: max(0, len(start) - 4)].decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def _pieces(path: Path, cut: list[str]) -> Iterator[bytes]:
    """Yield the bytes of a file, unpacked; stop where a compressed file breaks off."""
    with path.open("rb") as plain:
        packed = plain.read(2) == b"\x1f\x8b"
        plain.seek(0)
        if not packed:
            while piece := plain.read(_PIECE):
                yield piece
            return
        with gzip.open(plain, "rb") as unpacked:
            try:
                while piece := unpacked.read1(_PIECE):
                    yield piece
            except (EOFError, OSError, zlib.error):
                cut.append(
                    "the compressed file is damaged from some point on; what came before was read"
                )


def line_blocks(path: Path, cut: list[str]) -> Iterator[list[str]]:
    r"""Yield the lines of a text file, without their ends, in blocks of about 4 MB."""
    decoder: io.IncrementalNewlineDecoder | None = None
    waiting: list[str] = []
    size = 0
    for piece in _pieces(path, cut):
        if decoder is None:
            own = codecs.getincrementaldecoder(guess_encoding(piece, path.name))("replace")
            decoder = io.IncrementalNewlineDecoder(own, translate=True)
        waiting.append(decoder.decode(piece))
        size += len(waiting[-1])
        if size < _BLOCK:
            continue
        *lines, rest = "".join(waiting).split("\n")
        waiting, size = [rest], 0
        if any(len(line) > _MAX_LINE for line in (rest, *lines)):
            raise WorkbenchError(
                f"{path.name} has a line of more than {_MAX_LINE} characters; it is not a table of "
                "numbers"
            )
        yield lines
    *lines, rest = "".join(waiting).split("\n")
    lines += [rest] if rest else []
    if any(len(line) > _MAX_LINE for line in lines):
        raise WorkbenchError(f"{path.name} has a line too long for a table of numbers")
    if lines:
        yield lines


@dataclass
class _Tally:
    """What the slow path found in cells that hold no number."""

    rows_dropped: int = 0
    first_dropped: str = ""
    unreadable: dict[int, tuple[int, str]] = field(default_factory=dict)
    infinite: int = 0
    line: int = 0


def _fast(lines: Sequence[str], layout: Layout) -> Vector | None:
    """Read a block in which every cell is a number; None if one is not."""
    if layout.decimal == ",":
        if any("." in line for line in lines):
            return None
        lines = [line.replace(",", ".") for line in lines]
    try:
        rows = np.loadtxt(lines, delimiter=layout.separator, comments=None, ndmin=2)
    except (ValueError, IndexError, OverflowError):
        return None
    if rows.shape != (len(lines), layout.width) or not np.isfinite(rows).all():
        return None
    return rows


def _value(cell: str, layout: Layout, unit: str = "") -> float | None:
    """Return what a cell holds: NaN if it says that there is no number, None if it is a text.

    Args:
        unit: That in which it is returned if it has its own.
    """
    decimal = layout.decimal
    number, own = with_its_unit(cell) if unit else ("", "")
    if number and same_dimension(_known(own), _known(unit)):
        value = _value(number, layout)
        return None if value is None else float(convert(value, _known(own), _known(unit)))
    if is_number(cell, decimal) or _GROUPED[decimal].match(cell):
        plain = _joined(cell).replace("." if decimal == "," else ",", "")
        return float(plain.replace(decimal, "."))
    parts = [part for part in instant(cell, day_first=layout.day_first) if part is not None]
    if parts:
        return sum(parts)
    return math.nan if is_missing(cell) else layout.words.get(cell.lower())


def _column(
    cells: Sequence[str], column: int, at: Sequence[int], layout: Layout, tally: _Tally
) -> Vector:
    """Read a column; the same texts come again and again.

    Args:
        at: Numbers of the lines in the file.
    """
    unit = layout.measured[column] if layout.measured else ""
    known = {cell: _value(cell, layout, unit) for cell in set(cells)}
    texts = [k for k, cell in enumerate(cells) if known[cell] is None]
    if texts:
        before, example = tally.unreadable.get(column, (0, ""))
        example = example or f"{cells[texts[0]][:30]!r} in line {at[texts[0]]}"
        tally.unreadable[column] = before + len(texts), example
    values = np.array([known[cell] for cell in cells], dtype=float)
    tally.infinite += int(np.isinf(values).sum())
    return np.where(np.isinf(values), np.nan, values)


def _slow(lines: Sequence[str], layout: Layout, tally: _Tally) -> Vector:
    """Read a block column by column, noting what is no number."""
    rows, at = [], []
    for line in lines:
        tally.line += 1
        if is_comment(line):
            continue
        cells = split_line(line, layout.separator)
        if len(cells) == layout.width + 1 and not cells[-1]:
            cells = cells[:-1]
        if len(cells) != layout.width:
            tally.rows_dropped += 1
            tally.first_dropped = tally.first_dropped or (
                f"line {tally.line} has {len(cells)} cells instead of {layout.width}"
            )
            continue
        rows.append(cells)
        at.append(tally.line)
    columns = zip(*rows, strict=True) if rows else [()] * layout.width
    return np.column_stack([_column(c, k, at, layout, tally) for k, c in enumerate(columns)])


def read_text(path: Path, options: ReadOptions) -> Columns:
    """Read a table of numbers from a text file.

    Separator, decimal sign, header, a row of units, comment lines and compression are recognised.
    The file is read in blocks and thinned by averaging neighbours, so memory stays bounded. Rows
    without a time are left out.
    """
    cut: list[str] = []
    return _read_lines(path, line_blocks(path, cut), options, cut)


def cell_text(value: Any) -> str:
    """Return what a cell of another kind of file holds, as text."""
    if value is None:
        return ""
    value = int(value) if isinstance(value, bool) else value
    return " ".join(str(value.isoformat() if hasattr(value, "isoformat") else value).split())


def read_cells(path: Path, rows: Iterable[Sequence[str]], options: ReadOptions) -> Columns:
    """Read rows of texts, which a file of another kind holds, as those of a text file."""
    return _read_lines(path, iter([["\t".join(row) for row in rows]]), options, [])


def _read_lines(
    path: Path, blocks: Iterator[list[str]], options: ReadOptions, cut: list[str]
) -> Columns:
    first: list[str] = []
    for block in blocks:
        first += block
        if len(first) >= _LOOK_AHEAD:
            break
    if found := _long(first[:_LOOK_AHEAD]):
        separator, long = found
        lines = [line for block in (first, *blocks) for line in block if not is_comment(line)]
        rows = (split_line(line, separator) for line in lines[long.first + 1 :])
        wide = widened(rows, long)
        first = ["\t".join(row) for row in wide]
        cut.append(f"a row per value: {len(lines)} rows became {len(wide) - 1}")
    layout = detect_layout(first[:_LOOK_AHEAD], source=path.name)
    own = {word.lower(): value for word, value in options.words.items()}
    body = first[layout.first :]
    day_first = "/" in body[0] and begins_with_day(body)
    layout = replace(layout, words={**_WORDS, **own}, day_first=day_first)
    return _read_rows(path, first, blocks, layout, options, cut)


def _is_value(decimal: str, cell: str) -> bool:
    return is_number(cell, decimal) or is_missing(cell)


def _long(lines: Sequence[str]) -> tuple[str | None, Long] | None:
    """Return the separator of a long table, and which column is which; None if it is none."""
    body = [line for line in lines if not is_comment(line)]
    for separator, decimal in _candidates(body):
        if separator is not None:
            rows = [split_line(line, separator) for line in body]
            if found := long_table(rows, partial(_is_value, decimal)):
                return separator, found
    return None


def _read_rows(
    file: Path,
    first: list[str],
    blocks: Iterator[list[str]],
    layout: Layout,
    options: ReadOptions,
    cut: list[str],
) -> Columns:
    headers, named = titles(layout.headers, layout.width, options.columns, file.name)
    stamps = [instant(cell) for cell in split_line(first[layout.first], layout.separator)]
    stamps = stamps[: layout.width]
    units = tuple(
        "s" if stamp != NEVER else unit
        for unit, stamp in zip(layout.units or ("",) * layout.width, stamps, strict=True)
    )
    time = options.find_time(headers, units)
    tally, thinner = _Tally(line=layout.first), Thinner(options.max_rows)
    timeless, backwards, last = 0, 0, -math.inf
    for block in chain([first[layout.first :]], blocks):
        rows = _fast(block, layout) if block else None
        if rows is None:
            rows = _slow(block, layout, tally)
        else:
            tally.line += len(block)
        if time is not None and len(rows):
            good = np.isfinite(rows[:, time])
            if not good.all():
                timeless += int((~good).sum())
                rows = rows[good]
            instants = np.concatenate([[last], rows[:, time]])
            backwards += int((np.diff(instants) <= 0).sum())
            last = float(instants[-1])
        thinner.add(rows)
    values = thinner.rows()
    if len(values) == 0 and time in tally.unreadable:
        raise WorkbenchError(
            f"the time column {headers[time]!r} of {file.name} holds text (first: "
            f"{tally.unreadable[time][1]}); write the time in seconds, or as 2024-03-04 06:00:10"
        )
    if len(values) == 0:
        raise WorkbenchError(f"{file.name} holds no complete row of {layout.width} numbers")
    notes = _notes(tally, thinner, timeless, cut, file.name)
    if thinner.factor > 1 and backwards:
        notes.append(f"before averaging, the time stood still or ran backwards {backwards} time(s)")
    notes += start_at_zero(values, stamps)
    found = Columns(headers, units, values, named, layout.metadata, tuple(notes), {}, layout.saved)
    return _lift_scalars(found, tally.unreadable)


def _notes(
    tally: _Tally, thinner: Thinner, timeless: int, cut: list[str], source: str
) -> list[str]:
    notes = []
    if tally.rows_dropped > 0.2 * (thinner.total + tally.rows_dropped):
        raise WorkbenchError(
            f"{source}: {tally.rows_dropped} of {thinner.total + tally.rows_dropped} rows have "
            f"another number of columns ({tally.first_dropped}); the file is damaged or uses its "
            "separator inside the numbers"
        )
    if tally.rows_dropped:
        notes.append(f"{tally.rows_dropped} incomplete row(s) left out ({tally.first_dropped})")
    if timeless:
        notes.append(f"{timeless} row(s) without a time left out")
    if tally.infinite:
        notes.append(f"{tally.infinite} cell(s) too large for a number count as missing")
    return [*notes, *thinner.notes, *cut]


def _lift_scalars(found: Columns, unreadable: Mapping[int, tuple[int, str]]) -> Columns:
    """Take columns with a number in the first row only as settings of the experiment."""
    keep, metadata, values = [], dict(found.metadata), found.values
    for k, header in enumerate(found.headers):
        finite = np.isfinite(values[:, k])
        lonely = len(values) > 4 and bool(finite[0]) and not finite[1:].any()
        if lonely and k not in unreadable and header:
            metadata[header] = float(values[0, k])
        elif header or finite.any():
            keep.append(k)
    return replace(
        found,
        values=values[:, keep],
        headers=tuple(found.headers[k] for k in keep),
        units=tuple(found.units[k] for k in keep),
        metadata=metadata,
        unreadable={found.headers[k]: unreadable[k] for k in keep if k in unreadable},
    )


TEXT = Format("csv", "CSV", (".csv", ".txt", ".tsv", ".dat", ".asc", ".log"), read_text)
