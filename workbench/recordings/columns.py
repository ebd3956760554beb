"""The columns of a file as they were read: numbers, header texts, what went wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

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
        metadata: Scalars that stand in the file beside the columns.
        notes: What was left out or repaired.
        unreadable: Number of cells with text, and the first one, by header.
        saved: Description that a recording wrote of itself; None for foreign files.
    """

    headers: tuple[str, ...]
    units: tuple[str, ...]
    values: npt.NDArray[np.float64]
    named: bool = True
    metadata: Mapping[str, Scalar] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unreadable: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    saved: Mapping[str, Any] | None = None


def without_giants(columns: Columns) -> Columns:
    """Take numbers that no sensor gives, and whose squares overflow, for missing.

    Args:
        columns: Columns of a file.

    Returns:
        The columns with NaN in place of numbers beyond 1e100, and a note if there were any.

    Example:
        >>> file = Columns(("u",), ("V",), np.array([[1.0], [1e305]]))
        >>> without_giants(file).values.ravel()
        array([ 1., nan])
    """
    values = columns.values
    giants = np.isfinite(values) & (np.abs(np.nan_to_num(values)) > LARGEST)
    if not giants.any():
        return columns
    note = f"{int(giants.sum())} number(s) beyond {LARGEST:g} count as missing"
    return replace(columns, values=np.where(giants, np.nan, values), notes=(*columns.notes, note))
