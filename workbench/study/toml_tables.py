"""Tables of a TOML file whose mistakes are told with file and line.

The reader of the standard library returns values without their places. The scanner here walks a
text that the reader has accepted, and so needs no checks of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from workbench.checked_json import Place
from workbench.errors import WorkbenchError


class TomlTables:
    """A table of a file, with the line of each entry."""

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


def toml_lines(text: str) -> dict[Place, int]:
    """Return the line of every table and entry of a TOML text.

    Returns:
        Line, counted from 1, by path: keys, and indices of arrays.
    """
    return _Scanner(text).scan()


def line_of(lines: Mapping[Place, int], path: Place) -> int:
    """Return the line of an entry, or of the innermost table that holds it.

    Args:
        path: Place of the entry, which need not exist.
    """
    while path and path not in lines:
        path = path[:-1]
    return lines.get(path, 1)


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text.replace("\r\n", "\n")
        self.at = 0
        self.line = 1
        self.lines: dict[Place, int] = {}
        self.counts: dict[Place, int] = {}

    def scan(self) -> dict[Place, int]:
        prefix: Place = ()
        self.space(newlines=True)
        while self.at < len(self.text):
            if self.text.startswith("[[", self.at):
                prefix = self.header(2, array=True)
            elif self.text[self.at] == "[":
                prefix = self.header(1, array=False)
            else:
                self.entry(prefix)
            self.space(newlines=True)
        return self.lines

    def step(self, count: int = 1) -> None:
        self.line += self.text.count("\n", self.at, self.at + count)
        self.at += count

    def space(self, *, newlines: bool) -> None:
        """Pass blanks and comments, and ends of lines if wanted."""
        while self.at < len(self.text):
            c = self.text[self.at]
            if c == "#":
                end = self.text.find("\n", self.at)
                self.at = len(self.text) if end < 0 else end
            elif c in " \t" or (newlines and c == "\n"):
                self.step()
            else:
                return

    def header(self, brackets: int, *, array: bool) -> Place:
        line = self.line
        self.step(brackets)
        keys = self.keys()
        self.step(brackets)
        path: Place = ()
        for i, name in enumerate(keys):
            path = (*path, name)
            last = i == len(keys) - 1
            if last and array:
                self.lines.setdefault(path, line)
                self.counts[path] = self.counts.get(path, -1) + 1
            if path in self.counts:
                path = (*path, self.counts[path])
            self.lines.setdefault(path, line)
        self.lines[path] = line
        return path

    def keys(self) -> list[str]:
        """Read a key such as a."b c".d; ends before = or ]."""
        found = []
        while True:
            self.space(newlines=False)
            if self.text[self.at] in "\"'":
                begin = self.at
                self.string()
                found.append(self.text[begin + 1 : self.at - 1])
            else:
                begin = self.at
                while self.text[self.at] not in " \t.=]":
                    self.at += 1
                found.append(self.text[begin : self.at])
            self.space(newlines=False)
            if self.text[self.at] != ".":
                return found
            self.at += 1

    def entry(self, prefix: Place) -> None:
        line = self.line
        path = prefix
        for name in self.keys():
            path = (*path, name)
            self.lines.setdefault(path, line)
        self.step()  # the sign =
        self.value(path)

    def value(self, path: Place) -> None:
        self.space(newlines=False)
        c = self.text[self.at]
        self.lines.setdefault(path, self.line)
        if c in "\"'":
            self.string()
        elif c == "[":
            self.items(path, "]")
        elif c == "{":
            self.items(path, "}")
        else:
            while self.at < len(self.text) and self.text[self.at] not in ",]}#\n":
                self.at += 1

    def items(self, path: Place, close: str) -> None:
        self.step()
        index = 0
        while True:
            self.space(newlines=True)
            if self.text[self.at] == close:
                self.step()
                return
            if self.text[self.at] == ",":
                self.step()
            elif close == "]":
                self.lines[(*path, index)] = self.line
                self.value((*path, index))
                index += 1
            else:
                self.entry(path)

    def string(self) -> None:
        quote = self.text[self.at]
        fence = quote * 3 if self.text.startswith(quote * 3, self.at) else quote
        self.step(len(fence))
        while not self.text.startswith(fence, self.at):
            self.step(2 if quote == '"' and self.text[self.at] == "\\" else 1)
        self.step(len(fence))
        while len(fence) == 3 and self.text.startswith(quote, self.at):
            self.step()  # a multi-line string may end with quotes of its own
