"""The columns of a file as they were read, and how a reader of long files keeps them small."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.recordings.recording import Scalar

LARGEST = 1e100
"""Numbers beyond this are damage."""


@dataclass(frozen=True, eq=False)
class Columns:
    """What a reader found in a file, before units and names are settled.

    Args:
        headers: Header texts, one per column; ``column_1`` ... where the file has none.
        units: Units from a row of units, one per column; ``""`` where there is none.
        values: Numbers in the units of the file, shape (n, number of columns), NaN where a cell
            held none.
        named: Whether the headers come from the file or the caller.
        unreadable: Number of cells with text, and the first one, by header.
        saved: Description that a recording wrote of itself; None for foreign files.
    """

    headers: tuple[str, ...]
    units: tuple[str, ...]
    values: Vector
    named: bool = True
    metadata: Mapping[str, Scalar] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unreadable: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    saved: Mapping[str, Any] | None = None


def without_giants(columns: Columns) -> Columns:
    """Take numbers beyond 1e100, which no sensor gives and whose squares overflow, for missing."""
    values = columns.values
    giants = np.isfinite(values) & (np.abs(np.nan_to_num(values)) > LARGEST)
    if not giants.any():
        return columns
    note = f"{int(giants.sum())} number(s) beyond {LARGEST:g} count as missing"
    return replace(columns, values=np.where(giants, np.nan, values), notes=(*columns.notes, note))


def without_marks(columns: Columns) -> Columns:
    """Take numbers such as -9999 for missing, where they are far from all others of their column.

    Loggers write them where they have none.
    """
    seen = np.isin(columns.values, _MARKS)
    if not seen.any():
        return columns
    values, notes = columns.values.copy(), list(columns.notes)
    for own, suspects, header in zip(values.T, seen.T, columns.headers, strict=True):
        for mark in np.unique(own[suspects]):
            marked = own == mark
            others = own[np.isfinite(own) & ~marked]
            if np.count_nonzero(marked) > _MOST_MARKED * len(own) or others.size < 3:
                continue
            if np.abs(mark - others).min() > _APART * np.ptp(others) > 0.0:
                own[marked] = np.nan
                notes.append(
                    f"{np.count_nonzero(marked)} number(s) {mark:g} of {header!r} stand for none"
                )
    return replace(columns, values=values, notes=tuple(notes))


_MARKS = tuple(
    sign * mark
    for sign in (-1.0, 1.0)
    for mark in (99.99, 999.0, 999.9, 999.99, 9999.0, 9999.9, 9999.99, 99999.0, 999999.0, 9999999.0)
)
_APART, _MOST_MARKED = 3.0, 0.2
"""Distance of a mark from all other numbers, over their spread, and the largest part of a column
that is marked."""


def average_rows(rows: Vector, factor: int) -> Vector:
    """Average every ``factor`` rows, leaving NaN cells out; NaN where all were.

    All columns pass through the same filter, time included, so linear relations between them
    stay as they were.

    Example:
        >>> average_rows(np.array([[0.0], [2.0], [4.0], [np.nan]]), 2).ravel()
        array([1., 4.])
    """
    if factor == 1:
        return rows
    groups = rows.reshape(-1, factor, rows.shape[1])
    counts = np.isfinite(groups).sum(axis=1)
    sums = np.where(np.isfinite(groups), groups, 0.0).sum(axis=1)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def titles(
    found: tuple[str, ...], width: int, asked: tuple[str, ...], source: str
) -> tuple[tuple[str, ...], bool]:
    """Return headers, those asked for before those found, and whether anybody wrote them."""
    if asked and len(asked) != width:
        raise WorkbenchError(
            f"columns names {len(asked)} columns but {source} has {width}; name them all"
        )
    told = asked or found
    return told or tuple(f"column_{k + 1}" for k in range(width)), bool(told)


class Thinner:
    """A store of rows that never holds more than ``max_rows``.

    When it is full, neighbours are averaged in pairs and the factor doubles.

    Args:
        max_rows: Largest number of rows kept, 2 or more.

    Example:
        >>> thinner = Thinner(4)
        >>> thinner.add(np.arange(10.0).reshape(-1, 1))
        >>> thinner.rows().ravel(), thinner.factor
        (array([1.5, 5.5]), 4)
    """

    def __init__(self, max_rows: int) -> None:
        self.max_rows = max(2, max_rows - max_rows % 2)
        self.factor = 1
        self.total = 0
        self._kept: list[Vector] = []
        self._pending: list[Vector] = []

    def add(self, rows: Vector) -> None:
        """Take more rows."""
        self.total += len(rows)
        if len(rows) == 0:
            return
        pending = np.concatenate([*self._pending, rows])
        while len(pending) >= self.factor:
            room = self.max_rows - sum(map(len, self._kept))
            groups = min(len(pending) // self.factor, room)
            if groups:
                self._kept.append(average_rows(pending[: groups * self.factor], self.factor))
            pending = pending[groups * self.factor :]
            if groups < room or not len(pending):
                break
            self._kept = [average_rows(np.concatenate(self._kept), 2)]
            self.factor *= 2
        self._pending = [pending]

    @property
    def notes(self) -> tuple[str, ...]:
        """Say how many rows were averaged, if any."""
        if self.factor == 1:
            return ()
        return (
            f"{self.total} rows were averaged in groups of {self.factor}, all columns alike, to"
            f" keep at most {self.max_rows}",
        )

    def rows(self) -> Vector:
        """Return what is kept, shape (at most max_rows, columns); an incomplete group is left out.

        At a factor of 1 nothing is averaged and nothing left out.
        """
        if not self._kept:
            return np.empty((0, 0))
        return np.concatenate(self._kept)
