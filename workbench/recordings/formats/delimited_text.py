"""Tables of numbers in text files: any separator and encoding, plain or compressed, any length."""

from __future__ import annotations

import codecs
import gzip
import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns, Thinner
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.text_layout import (
    NEVER,
    Instant,
    Layout,
    detect_layout,
    instant,
    is_comment,
    is_missing,
    is_number,
    split_line,
)
from workbench.recordings.recording import Scalar

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
        raise WorkbenchError(
            f"{source} is not a text file; recordings are CSV, MATLAB .mat, Parquet or JSON"
        )
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
            while True:
                try:
                    piece = unpacked.read1(_PIECE)
                except (EOFError, OSError, zlib.error):
                    cut.append(
                        "the compressed file is damaged from some point on; what came before was "
                        "read"
                    )
                    return
                if not piece:
                    return
                yield piece


def line_blocks(path: Path, cut: list[str]) -> Iterator[list[str]]:
    r"""Yield the lines of a text file, without their ends, in blocks of about 4 MB."""
    decoder: codecs.IncrementalDecoder | None = None
    waiting: list[str] = []
    size, rest = 0, ""
    for piece in _pieces(path, cut):
        if decoder is None:
            decoder = codecs.getincrementaldecoder(guess_encoding(piece, path.name))("replace")
        text = decoder.decode(piece)
        waiting.append(text)
        size += len(text)
        if size < _BLOCK:
            continue
        lines, rest = _split(rest + "".join(waiting))
        waiting, size = [], 0
        if len(rest) > _MAX_LINE or any(len(line) > _MAX_LINE for line in lines):
            raise WorkbenchError(
                f"{path.name} has a line of more than {_MAX_LINE} characters; it is not a table of "
                "numbers"
            )
        yield lines
    lines, rest = _split(rest + "".join(waiting))
    if rest.rstrip("\r"):
        lines.append(rest.rstrip("\r"))
    if any(len(line) > _MAX_LINE for line in lines):
        raise WorkbenchError(f"{path.name} has a line too long for a table of numbers")
    if lines:
        yield lines


def _split(text: str) -> tuple[list[str], str]:
    """Split into complete lines and the rest; a carriage return at the end may be half an end."""
    if "\r" in text:
        half = "\r" if text.endswith("\r") else ""
        text = text[: len(text) - len(half)].replace("\r\n", "\n").replace("\r", "\n") + half
    lines = text.split("\n")
    return lines[:-1], lines[-1]


@dataclass
class _Tally:
    """What the slow path found in cells that hold no number."""

    rows_dropped: int = 0
    first_dropped: str = ""
    unreadable: dict[int, tuple[int, str]] = field(default_factory=dict)
    infinite: int = 0
    line: int = 0

    def text(self, column: int, cell: str) -> None:
        count, example = self.unreadable.get(column, (0, ""))
        self.unreadable[column] = (count + 1, example or f"{cell[:30]!r} in line {self.line}")


def _fast(lines: Sequence[str], layout: Layout) -> npt.NDArray[np.float64] | None:
    """Read a block in which every cell is a number; None if one is not."""
    if layout.decimal == ",":
        lines = [line.replace(",", ".") for line in lines]
    try:
        rows = np.loadtxt(lines, delimiter=layout.separator, comments=None, ndmin=2)
    except (ValueError, IndexError, OverflowError):
        return None
    if rows.shape != (len(lines), layout.width) or not np.isfinite(rows).all():
        return None
    return rows


def _cell(cell: str, column: int, layout: Layout, tally: _Tally) -> float:
    if is_number(cell, layout.decimal):
        value = float(cell.replace(",", ".") if layout.decimal == "," else cell)
        if math.isfinite(value):
            return value
        tally.infinite += 1
        return math.nan
    parts = [part for part in instant(cell) if part is not None]
    if parts:
        return sum(parts)
    if not is_missing(cell):
        tally.text(column, cell)
    return math.nan


def _slow(lines: Sequence[str], layout: Layout, tally: _Tally) -> npt.NDArray[np.float64]:
    """Read a block cell by cell, noting what is no number."""
    rows = []
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
        rows.append([_cell(c, k, layout, tally) for k, c in enumerate(cells)])
    return np.array(rows, dtype=float).reshape(-1, layout.width)


def _headers(layout: Layout, names: Sequence[str], source: str) -> tuple[tuple[str, ...], bool]:
    if names:
        if len(names) != layout.width:
            raise WorkbenchError(
                f"columns names {len(names)} columns but {source} has {layout.width}; name them all"
            )
        return tuple(names), True
    if layout.headers:
        return layout.headers, True
    return tuple(f"column_{k + 1}" for k in range(layout.width)), False


def read_text(path: Path, options: ReadOptions) -> Columns:
    """Read a table of numbers from a text file.

    Separator, decimal sign, header, a row of units, comment lines and compression are recognised.
    The file is read in blocks and thinned by averaging neighbours, so memory stays bounded. Rows
    without a time are left out.
    """
    cut: list[str] = []
    blocks = line_blocks(path, cut)
    first: list[str] = []
    for block in blocks:
        first += block
        if len(first) >= _LOOK_AHEAD:
            break
    layout = detect_layout(first[:_LOOK_AHEAD], source=path.name)
    return _read_rows(path, first, blocks, layout, options, cut)


def _read_rows(
    file: Path,
    first: list[str],
    blocks: Iterator[list[str]],
    layout: Layout,
    options: ReadOptions,
    cut: list[str],
) -> Columns:
    headers, named = _headers(layout, options.columns, file.name)
    stamps = [instant(cell) for cell in split_line(first[layout.first], layout.separator)]
    stamps = stamps[: layout.width]
    units = tuple(
        "s" if stamp != NEVER else unit
        for unit, stamp in zip(layout.units or ("",) * layout.width, stamps, strict=True)
    )
    empty = Columns(headers, units, np.empty((0, layout.width)), named, layout.metadata)
    time = options.find_time(empty)
    tally, thinner = _Tally(line=layout.first), Thinner(options.max_rows)
    timeless, backwards, last = 0, 0, -math.inf
    block: list[str] | None = first[layout.first :]
    while block is not None:
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
        block = next(blocks, None)
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
    _count_from_the_first(values, stamps)
    metadata = dict(layout.metadata)
    values, headers, units, tally_columns = _lift_scalars(values, headers, units, metadata, tally)
    return Columns(
        headers, units, values, named, metadata, tuple(notes), tally_columns, layout.saved
    )


def _count_from_the_first(values: npt.NDArray[np.float64], stamps: Sequence[Instant]) -> None:
    """Let instants begin at zero: a date and a time of day beside it are one, in both columns."""
    dates = [k for k, (day, clock) in enumerate(stamps) if day is not None and clock is None]
    clocks = [k for k, (day, clock) in enumerate(stamps) if day is None and clock is not None]
    if dates and clocks:
        values[:, dates[0]] += values[:, clocks[0]]
        values[:, clocks[0]] = values[:, dates[0]]
    for k in () if dates else clocks:
        midnights = np.diff(values[:, k], prepend=values[0, k]) < -43200.0
        values[:, k] += 86400.0 * np.cumsum(midnights)
    for k, stamp in enumerate(stamps):
        if stamp != NEVER:
            values[:, k] -= values[0, k]


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
    if thinner.factor > 1:
        notes.append(
            f"{thinner.total} rows were averaged in groups of {thinner.factor}, all columns alike, "
            f"to keep at most {thinner.max_rows}"
        )
    return notes + cut


def _lift_scalars(
    values: npt.NDArray[np.float64],
    headers: tuple[str, ...],
    units: tuple[str, ...],
    metadata: dict[str, Scalar],
    tally: _Tally,
) -> tuple[npt.NDArray[np.float64], tuple[str, ...], tuple[str, ...], dict[str, tuple[int, str]]]:
    """Take columns with a number in the first row only as settings of the experiment."""
    keep = []
    for k, header in enumerate(headers):
        finite = np.isfinite(values[:, k])
        lonely = len(values) > 4 and bool(finite[0]) and not finite[1:].any()
        if lonely and k not in tally.unreadable and header:
            metadata[header] = float(values[0, k])
        elif header or finite.any():
            keep.append(k)
    unreadable = {headers[k]: tally.unreadable[k] for k in keep if k in tally.unreadable}
    return (
        values[:, keep],
        tuple(headers[k] for k in keep),
        tuple(units[k] for k in keep),
        unreadable,
    )


TEXT = Format(
    "csv", "CSV", (".csv", ".txt", ".tsv", ".dat", ".asc", ".log"), read_text, packed=True
)
