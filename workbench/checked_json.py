"""JSON files that users keep, read through a shape: a wrong entry is a sentence with its place."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError

Shape = Callable[[Any, str], Any]
"""Takes a value and where it stands; returns the value or raises `WorkbenchError`."""


def read_json(path: str | Path, what: str, shape: Shape, *, fix: str = "") -> Any:
    """Read a JSON file and check its content.

    Args:
        path: The file.
        what: What it holds, as the user knows it: ``"baseline"``.
        shape: What its content must be.
        fix: What to do about a file that is not there or wrong.

    Raises:
        WorkbenchError: If it cannot be read, is no JSON, or an entry is not what it must be.
    """
    place, tail = Path(path), f"; {fix}" if fix else ""
    name = f"{what} {str(place)!r}"
    try:
        content = json.loads(place.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise WorkbenchError(f"{name} cannot be read: {reason}{tail}") from None
    except (ValueError, RecursionError) as error:
        raise WorkbenchError(f"{name} is no JSON: {str(error)[:120]}{tail}") from None
    try:
        return shape(content, "")
    except WorkbenchError as error:
        raise WorkbenchError(f"{name}: {error}{tail}") from None


def _wrong(value: Any, place: str, wanted: str) -> WorkbenchError:
    text = repr(value)
    shown = text if len(text) <= 60 else f"{text[:57]}..."
    return WorkbenchError(f"{place or 'its content'} is {shown}; it must be {wanted}")


def number(value: Any, place: str) -> Any:
    """Accept a number; true and false are none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise _wrong(value, place, "a number")
    return value


def whole(value: Any, place: str) -> Any:
    """Accept a whole number."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise _wrong(value, place, "a whole number")
    return value


def text(value: Any, place: str) -> Any:
    """Accept text."""
    if not isinstance(value, str):
        raise _wrong(value, place, "text")
    return value


def flag(value: Any, place: str) -> Any:
    """Accept true or false."""
    if not isinstance(value, bool):
        raise _wrong(value, place, "true or false")
    return value


def anything(value: Any, _place: str) -> Any:
    """Accept whatever stands there."""
    return value


def one_of(*words: Any) -> Shape:
    """Return a shape that accepts some words or numbers."""

    def check(value: Any, place: str) -> Any:
        if isinstance(value, (list, dict)) or value not in words:
            raise _wrong(value, place, f"one of {', '.join(map(repr, words))}")
        return value

    return check


def optional(shape: Shape) -> Shape:
    """Return a shape that accepts null too."""
    return lambda value, place: None if value is None else shape(value, place)


def listed(shape: Shape, *, length: int | None = None) -> Shape:
    """Return a shape that accepts a list, of a given length if one is given."""

    def check(value: Any, place: str) -> Any:
        if not isinstance(value, list) or length not in (None, len(value)):
            raise _wrong(value, place, "a list" + (f" of {length}" if length else ""))
        return [shape(item, f"{place}[{i}]") for i, item in enumerate(value)]

    return check


def named(shape: Shape) -> Shape:
    """Return a shape that accepts a table of any names."""

    def check(value: Any, place: str) -> Any:
        if not isinstance(value, dict):
            raise _wrong(value, place, "a table")
        return {name: shape(item, _inner(place, name)) for name, item in value.items()}

    return check


@dataclass(frozen=True)
class TableShape:
    """A table whose entries are known; others pass unread, for a later version may add some.

    Args:
        needed: Shapes of entries that must be there.
        usual: Shapes of entries that may be left out.
    """

    needed: Mapping[str, Shape]
    usual: Mapping[str, Shape] = field(default_factory=dict)

    def __call__(self, value: Any, place: str) -> Any:
        """Accept a table that has every needed entry."""
        if not isinstance(value, dict):
            raise _wrong(value, place, "a table")
        lacking: Sequence[str] = [name for name in self.needed if name not in value]
        if lacking:
            raise WorkbenchError(f"{place or 'it'} has no {lacking[0]!r}")
        found = dict(value)
        for name, shape in {**self.needed, **self.usual}.items():
            if name in value:
                found[name] = shape(value[name], _inner(place, name))
        return found


def _inner(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name
