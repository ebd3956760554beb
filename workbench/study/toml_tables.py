"""Tables of a TOML file whose mistakes are told with file and line.

The reader of the standard library returns values without their places. An entry stands on the first
line up to which the text, its brackets closed, has it.
"""

from __future__ import annotations

import tomllib
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from workbench.checked_json import Place
from workbench.errors import WorkbenchError

_CLOSED = ("", "]", "]]", "]]]", "]}", "]}]", '"""', "'''")
"""What may be open at the end of a line."""


class TomlTables:
    """A table of a file, with the text that it was read from."""

    def __init__(self, path: Path, table: dict[str, Any], text: str) -> None:
        self.path, self.table, self.text = path, table, text

    @contextmanager
    def at(self, *path: str | int) -> Iterator[None]:
        """Add file and line of an entry to a mistake, unless a place further inside did.

        Raises:
            WorkbenchError: The mistake, with its place.
        """
        try:
            yield
        except WorkbenchError as error:
            if str(error).startswith(f"{self.path}, line "):
                raise
            line = line_of(self.text, path)
            raise WorkbenchError(f"{self.path}, line {line}: {error}") from None


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
