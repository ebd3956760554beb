"""Aligned tables of text, as recordings and check reports print themselves."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence


def aligned_table(
    header: Sequence[str], rows: Sequence[Sequence[object]], *, width: int | None = 100
) -> str:
    """Return a table with aligned columns; the last one wraps, unless `width` is None.

    Example:
        >>> print(aligned_table(("signal", "unit"), [("angle", "rad"), ("valve", "V")]))
        signal  unit
        angle   rad
        valve   V
    """
    lines = [tuple(header), *(tuple(str(cell) for cell in row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header) - 1)]
    indent = sum(widths) + 2 * len(widths)
    room = 10**6 if width is None else max(30, width - indent)
    out = []
    for line in lines:
        start = "".join(cell.ljust(w) + "  " for cell, w in zip(line[:-1], widths, strict=True))
        wrapped = textwrap.wrap(line[-1], room) or [""]
        out.append((start + wrapped[0]).rstrip())
        out.extend(" " * indent + more for more in wrapped[1:])
    return "\n".join(out)
