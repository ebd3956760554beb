"""Lines of a TOML file at which its entries stand.

The reader of the standard library returns values without their places. An entry stands on the first
line up to which the text, its brackets closed, has it.
"""

from __future__ import annotations

import tomllib
from bisect import bisect_left
from functools import lru_cache
from typing import Any

from workbench.checked_json import Place

_CLOSED = ("", "]", "]]", "]]]", "]}", "]}]", '"""', "'''")
"""What may be open at the end of a line."""


def line_of(text: str, path: Place) -> int:
    """Return the line, from 1 on, of an entry of TOML, or of the innermost table that holds it."""
    count = len(text.splitlines())
    while path and not _has(text, count, path):
        path = path[:-1]
    return 1 + bisect_left(range(1, count), True, key=lambda n: _has(text, n, path))


def _has(text: str, count: int, path: Place) -> bool:
    table: Any = _read(text, count)
    for key in path:
        try:
            table = table[key]
        except (KeyError, IndexError, TypeError):
            return False
    return True


@lru_cache(maxsize=64)
def _read(text: str, count: int) -> dict[str, Any]:
    """Read the first lines; lines inside a value that cannot be closed belong to its last one."""
    lines = text.splitlines(keepends=True)
    for last in range(count, len(lines) + 1):
        for closed in _CLOSED:
            try:
                return tomllib.loads("".join(lines[:last]) + closed)
            except tomllib.TOMLDecodeError:
                continue
    return {}
