"""Shapes of files that users keep, JSON and TOML: a wrong entry is a sentence with its place."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError, check_choice

Place = tuple[str | int, ...]
Shape = Callable[[Any, Place], Any]
"""Takes a value and where it stands; returns the value or raises `ShapeError`."""


class ShapeError(WorkbenchError):
    """An entry that is not what it must be.

    Args:
        place: Keys and indices that lead to it.
    """

    def __init__(self, place: Place, text: str) -> None:
        self.place, self.text = place, text
        named = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in place).lstrip(".")
        super().__init__(f"{named or 'its content'} {text}")


_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def read_json(path: str | Path, what: str, shape: Shape, *, fix: str = "") -> Any:
    """Read a JSON file and check its content.

    Args:
        what: What it holds, as the user knows it: ``"baseline"``.
        fix: What to do about a file that is not there or wrong.
    """
    place, tail = Path(path), f"; {fix}" if fix else ""
    name = f"{what} {str(place)!r}"
    try:
        written = place.read_text(encoding="utf-8")
        content = json.loads(written)
        if _SURROGATE.search(written):
            # Half a character cannot be written again.
            json.dumps(content, ensure_ascii=False).encode()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise WorkbenchError(f"{name} cannot be read: {reason}{tail}") from None
    except (ValueError, RecursionError) as error:
        raise WorkbenchError(f"{name} is no JSON: {str(error)[:120]}{tail}") from None
    try:
        return shape(content, ())
    except WorkbenchError as error:
        raise WorkbenchError(f"{name}: {error}{tail}") from None


def read_toml(path: str | Path, what: str, shape: Shape | None = None) -> dict[str, Any]:
    """Read a TOML file and check its content.

    Args:
        what: What it holds, as the user knows it: ``"mapping file"``.
    """
    name = f"{what} {str(path)!r}"
    try:
        # Editors of Windows put a mark of the encoding before all else.
        content = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise WorkbenchError(f"{name} cannot be read: {reason}") from None
    except (ValueError, RecursionError) as error:
        raise WorkbenchError(f"{name} is not valid TOML: {str(error)[:200]}") from None
    try:
        return content if shape is None else dict(shape(content, ()))
    except ShapeError as error:
        raise WorkbenchError(f"{name}: {error}") from None


def _wrong(value: Any, place: Place, wanted: str) -> ShapeError:
    try:
        text = repr(value)
    except ValueError:  # more digits than Python writes
        text = "a number of very many digits"
    shown = text if len(text) <= 60 else f"{text[:57]}..."
    return ShapeError(place, f"is {shown}; it must be {wanted}")


def _accepting(fits: Callable[[Any], bool], wanted: str) -> Shape:
    def check(value: Any, place: Place) -> Any:
        if not fits(value):
            raise _wrong(value, place, wanted)
        return value

    return check


def _is_number(value: Any) -> bool:
    """Tell whether it is a number that a float can hold; true and false are none."""
    known = isinstance(value, (int, float)) and not isinstance(value, bool)
    return known and not (isinstance(value, int) and abs(value) > 1 << 1000)


number = _accepting(_is_number, "a number")
size = _accepting(
    lambda value: isinstance(value, str) or (_is_number(value) and math.isfinite(value)),
    'a number, or text with a unit such as "20 ms"',
)
whole = _accepting(
    lambda value: isinstance(value, int) and not isinstance(value, bool), "a whole number"
)
text = _accepting(lambda value: isinstance(value, str), "text")
flag = _accepting(lambda value: isinstance(value, bool), "true or false")


def anything(value: Any, _place: Place) -> Any:
    """Accept whatever stands there."""
    return value


def scalar(value: Any, place: Place) -> Any:
    """Accept text, true, false or a number."""
    return value if isinstance(value, (str, bool)) else number(value, place)


def one_of(*words: Any) -> Shape:
    """Return a shape that accepts some words or numbers."""
    fits = f"one of {', '.join(map(repr, words))}"
    return _accepting(lambda value: not isinstance(value, (list, dict)) and value in words, fits)


def within(low: float, high: float, shape: Shape = number) -> Shape:
    """Return a shape that accepts numbers from one to another, in the unit of the entry."""

    def check(value: Any, place: Place) -> Any:
        if not low <= shape(value, place) <= high:
            raise _wrong(value, place, f"from {low:g} to {high:g}")
        return value

    return check


def optional(shape: Shape) -> Shape:
    """Return a shape that accepts null too."""
    return lambda value, place: None if value is None else shape(value, place)


@dataclass(frozen=True)
class ListShape:
    """A list whose items have one shape, of a length if one is given."""

    item: Shape
    length: int | None = None

    def __call__(self, value: Any, place: Place) -> Any:
        """Accept such a list."""
        if not isinstance(value, list) or self.length not in (None, len(value)):
            raise _wrong(value, place, "a list" + (f" of {self.length}" if self.length else ""))
        return [self.item(item, (*place, i)) for i, item in enumerate(value)]


@dataclass(frozen=True)
class NamedShape:
    """A table of any names whose entries have one shape."""

    item: Shape

    def __call__(self, value: Any, place: Place) -> Any:
        """Accept such a table."""
        if not isinstance(value, dict):
            raise _wrong(value, place, "a table")
        return {name: self.item(item, (*place, name)) for name, item in value.items()}


listed, named = ListShape, NamedShape


@dataclass(frozen=True)
class TableShape:
    """A table whose entries are known.

    Args:
        needed: Shapes of entries that must be there.
        usual: Shapes of entries that may be left out.
        others: Whether other entries pass unread, for a later version may add some.
    """

    needed: Mapping[str, Shape]
    usual: Mapping[str, Shape] = field(default_factory=dict)
    others: bool = True

    def __call__(self, value: Any, place: Place) -> Any:
        """Accept a table that has every needed entry."""
        if not isinstance(value, dict):
            raise _wrong(value, place, "a table")
        lacking: Sequence[str] = [name for name in self.needed if name not in value]
        if lacking:
            raise ShapeError(place, f"has no {lacking[0]!r}")
        shapes = {**self.needed, **self.usual}
        for name in () if self.others else value:
            try:
                check_choice("key", name, shapes)
            except WorkbenchError as error:
                raise ShapeError(place, f"has the {error}".replace(" is ", " ", 1)) from None
        return {
            name: shapes[name](item, (*place, name)) if name in shapes else item
            for name, item in value.items()
        }
