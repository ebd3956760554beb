"""A format of recordings, and the registry that a user's own formats join."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError, missing_package
from workbench.recordings.columns import Columns
from workbench.registry import Registry

MAX_ROWS = 2_000_000

FindTime = Callable[[Sequence[str], Sequence[str]], "int | None"]


@dataclass(frozen=True)
class ReadOptions:
    """What a reader is told beside the path.

    Args:
        max_rows: Largest number of rows kept; a longer file is averaged in groups, with a note.
        find_time: Returns the index of the time column, by headers and a row of units; None if
            there is no such column.
        words: Numbers that words in the cells of a text stand for, dimensionless.
    """

    columns: tuple[str, ...] = ()
    max_rows: int = MAX_ROWS
    find_time: FindTime = lambda headers, units: None
    words: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Format:
    """A file format: how it is recognised and how its columns are read.

    Args:
        suffixes: Endings of its files, lower case with the dot; none for a format that is only
            taken where it is named.
        recognises: Tells by the first 520 bytes whether a file is of this format, where several
            share its suffix.
        extra: Extra of the workbench that installs what ``read`` imports; ``""`` for none.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, ReadOptions], Columns]
    recognises: Callable[[bytes], bool] = bool
    extra: str = ""

    def columns(self, path: Path, options: ReadOptions) -> Columns:
        """Read a file as columns."""
        try:
            return self.read(path, options)
        except ImportError as error:
            if not self.extra:
                raise
            raise missing_package(
                f"reading {self.title}", str(error.name), self.extra, "save the recording as CSV"
            ) from None
        except OSError as error:
            raise WorkbenchError(f"{path} cannot be read: {error.strerror or error}") from None


def _from_reader(found: Any, reference: str) -> Format:
    if not callable(found):
        raise WorkbenchError(
            f"recording format {reference!r} is a {type(found).__name__}; give a Format, or a"
            " function of a path and ReadOptions that returns Columns"
        )
    return Format(reference, reference, (), found)


FORMATS = Registry(
    "recording format",
    Format,
    package="workbench.recordings.formats",
    group="workbench.formats",
    adopt=_from_reader,
)


def suffix_of(path: Path) -> str:
    """Return the ending that tells the format, ``.gz`` removed."""
    endings = [s.lower() for s in path.suffixes]
    if endings and endings[-1] == ".gz":
        endings.pop()
    return endings[-1] if endings else ""


def known_suffixes() -> tuple[str, ...]:
    """Return the endings of all formats."""
    return tuple(dict.fromkeys(s for f in FORMATS.members().values() for s in f.suffixes))


def format_of(path: Path) -> Format:
    """Recognise the format of a file by its ending, and by its first bytes where some share it."""
    suffix = suffix_of(path)
    rivals = [f for f in FORMATS.members().values() if suffix in f.suffixes]
    if not rivals:
        raise WorkbenchError(
            f"{path.name} ends in {suffix or 'nothing'!r}, which is no known format; recordings are"
            f" {', '.join(known_suffixes())} (text also as .gz): save it as one, or read it with"
            ' format = "module:object" of your own in its mapping file'
        )
    if len(rivals) == 1:
        return rivals[0]
    with path.open("rb") as stream:
        start = stream.read(520)
    return next((f for f in rivals if f.recognises(start)), rivals[0])
