"""Tables of a TOML file whose mistakes are told with file and line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError, check_choice
from workbench.study.toml_lines import Path as Place
from workbench.study.toml_lines import line_of


class Located:
    """A table of a file, with the line of each entry.

    Args:
        path: The file.
        table: What the file holds.
        lines: Line by path of the entry.

    Example:
        >>> with Located(Path("study.toml"), {}, {("plant",): 3}).at("plant", "load"):
        ...     raise WorkbenchError("load is 12 kg")
        Traceback (most recent call last):
            ...
        workbench.errors.WorkbenchError: study.toml, line 3: load is 12 kg
    """

    def __init__(self, path: Path, table: dict[str, Any], lines: Mapping[Place, int]) -> None:
        self.path, self.table, self.lines = path, table, lines

    @contextmanager
    def at(self, *path: str | int) -> Iterator[None]:
        """Add file and line to a mistake, unless a place further inside did.

        Args:
            path: Path of the entry that is being read: keys, and indices of arrays.

        Yields:
            Nothing.

        Raises:
            WorkbenchError: The mistake, with its place.
        """
        try:
            yield
        except WorkbenchError as error:
            if str(error).startswith(f"{self.path}, line "):
                raise
            line = line_of(self.lines, path)
            raise WorkbenchError(f"{self.path}, line {line}: {error}") from None

    def keys(self, table: Any, known: Sequence[str], what: str, *path: str | int) -> dict[str, Any]:
        """Return a table whose keys are all known.

        Args:
            table: What stands in the file.
            known: Names of the keys.
            what: What the table describes, as the user knows it.
            path: Path of the table.

        Returns:
            A copy of the table.

        Raises:
            WorkbenchError: If it is no table or has another key.
        """
        with self.at(*path):
            if not isinstance(table, dict):
                raise WorkbenchError(f"{what} is {table!r}; it must be a table")
        for key in table:
            with self.at(*path, key):
                check_choice(f"key of {what}", key, known)
        return dict(table)

    def tables(self, key: str) -> list[tuple[str, Any]]:
        """Return the named tables below a key of the file.

        Args:
            key: The key.

        Returns:
            Pairs of a name and what stands under it.

        Raises:
            WorkbenchError: If the key holds no table.
        """
        table = self.table.get(key, {})
        with self.at(key):
            if not isinstance(table, dict):
                raise WorkbenchError(f"{key} is no table; write [{key}.NAME]")
        return list(table.items())
