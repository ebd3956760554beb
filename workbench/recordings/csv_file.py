"""Read tables of numbers from text files, plain or compressed, of any length."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns
from workbench.recordings.csv_layout import (
    Layout,
    detect_layout,
    is_comment,
    is_missing,
    is_number,
    split_line,
)
from workbench.recordings.recording import Scalar
from workbench.recordings.text_lines import line_blocks
from workbench.recordings.thinning import Thinner

_LOOK_AHEAD = 400

FindTime = Callable[[Columns], "int | None"]


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


def read_csv(
    path: str | Path,
    *,
    columns: Sequence[str] = (),
    max_rows: int = 2_000_000,
    find_time: FindTime | None = None,
) -> Columns:
    r"""Read a table of numbers from a text file.

    Separator, decimal sign, header, a row of units, comment lines and compression are recognised.
    The file is read in blocks; a longer one than ``max_rows`` is thinned by averaging neighbours,
    so memory stays bounded.

    Args:
        path: File, plain or gzip.
        columns: Names of the columns, for a file without header.
        max_rows: Largest number of rows kept.
        find_time: Function that returns the index of the time column, given the headers; rows
            without time are left out.

    Returns:
        The columns with notes on what was left out.

    Raises:
        WorkbenchError: If the file cannot be read or holds no table of numbers.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "trial.csv"
        >>> _ = file.write_text("\n".join(["time_s,valve_V", "0,5.0", "0.1,5.1", "0.2,5.2"]))
        >>> read_csv(file).headers
        ('time_s', 'valve_V')
    """
    file = Path(path)
    cut: list[str] = []
    try:
        blocks = line_blocks(file, cut)
        first: list[str] = []
        for block in blocks:
            first += block
            if len(first) >= _LOOK_AHEAD:
                break
        layout = detect_layout(first[:_LOOK_AHEAD], source=file.name)
        return _read_rows(file, first, blocks, layout, columns, max_rows, find_time, cut)
    except OSError as error:
        raise WorkbenchError(f"{file} cannot be read: {error}") from None


def _read_rows(
    file: Path,
    first: list[str],
    blocks: Iterator[list[str]],
    layout: Layout,
    columns: Sequence[str],
    max_rows: int,
    find_time: FindTime | None,
    cut: list[str],
) -> Columns:
    headers, named = _headers(layout, columns, file.name)
    units = layout.units or ("",) * layout.width
    empty = Columns(headers, units, np.empty((0, layout.width)), named, layout.metadata)
    time = find_time(empty) if find_time is not None else None
    tally, thinner = _Tally(line=layout.first), Thinner(max_rows)
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
    if len(values) == 0:
        raise WorkbenchError(f"{file.name} holds no complete row of {layout.width} numbers")
    notes = _notes(tally, thinner, timeless, cut, file.name)
    if thinner.factor > 1 and backwards:
        notes.append(f"before averaging, the time stood still or ran backwards {backwards} time(s)")
    metadata = dict(layout.metadata)
    values, headers, units, tally_columns = _lift_scalars(values, headers, units, metadata, tally)
    return Columns(
        headers, units, values, named, metadata, tuple(notes), tally_columns, layout.saved
    )


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
    """Take columns with a number in the first row only as settings of the trial."""
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
