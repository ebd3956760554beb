"""Keep a stream of rows within a fixed size by averaging neighbours."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Rows = npt.NDArray[np.float64]


def average_rows(rows: Rows, factor: int) -> Rows:
    """Average every ``factor`` rows, leaving NaN cells out.

    All columns pass through the same filter, time included, so linear relations between them
    stay as they were.

    Args:
        rows: Shape (m factor, columns).
        factor: Number of rows that become one.

    Returns:
        Shape (m, columns); NaN where all cells were NaN.

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
        self._kept: list[Rows] = []
        self._size = 0
        self._pending: list[Rows] = []
        self._waiting = 0

    def add(self, rows: Rows) -> None:
        """Take more rows.

        Args:
            rows: Shape (m, columns), the same columns every time.
        """
        self.total += len(rows)
        if len(rows) == 0:
            return
        self._pending.append(rows)
        self._waiting += len(rows)
        while self._waiting >= self.factor:
            pending = np.concatenate(self._pending)
            groups = min(len(pending) // self.factor, self.max_rows - self._size)
            used = groups * self.factor
            if groups:
                self._kept.append(average_rows(pending[:used], self.factor))
                self._size += groups
            self._pending, self._waiting = [pending[used:]], len(pending) - used
            if self._size < self.max_rows or not self._waiting:
                break
            self._kept = [average_rows(np.concatenate(self._kept), 2)]
            self._size = len(self._kept[0])
            self.factor *= 2

    def rows(self) -> Rows:
        """Return what is kept, shape (at most max_rows, columns); an incomplete group is left out.

        At a factor of 1 nothing is averaged and nothing left out.
        """
        if not self._kept:
            return np.empty((0, 0))
        return np.concatenate(self._kept)
