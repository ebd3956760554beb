"""The columns of a file as they were read: numbers, header texts, what went wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.recordings.recording import Scalar


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
