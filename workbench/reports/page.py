"""One self-contained HTML page: sections of words, tables, pictures and commands."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.files import write_whole
from workbench.reports.pictures import Picture, inline_svg, save
from workbench.reports.style import palette
from workbench.reports.tables import MARKS, Table

if TYPE_CHECKING:
    from jinja2 import Template


@dataclass(frozen=True)
class Words:
    """A paragraph.

    Args:
        weight: ``"plain"``, or ``"note"`` for something the reader should not overlook.
    """

    text: str
    weight: str = "plain"


@dataclass(frozen=True)
class Commands:
    """Command lines that reproduce what the page shows."""

    lines: tuple[str, ...]


@dataclass(frozen=True)
class Method:
    """How numbers were computed, folded away until the reader asks."""

    entries: tuple[tuple[str, str], ...]
    title: str = "How each number was computed"


@cache
def methods(page: str) -> tuple[tuple[str, str], ...]:
    """Return how the numbers of a page are computed, as ``methods.toml`` has it."""
    text = files("workbench.reports").joinpath("methods.toml").read_text(encoding="utf-8")
    return tuple(tomllib.loads(text)[page].items())


@dataclass(frozen=True)
class Answers:
    """Questions that the reader came with, each with its answer."""

    entries: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Moving:
    """A drawing that moves.

    Args:
        markup: HTML with its own style and script, which needs nothing from elsewhere; it stands
            in the page as it is.
    """

    markup: str
    caption: str


Block = Words | Table | Picture | Commands | Method | Answers | Moving


@dataclass(frozen=True)
class Section:
    """A part of a page under its own heading.

    Args:
        name: Name by which links find it, in small letters with hyphens.
        blocks: Its content in order; neighbouring pictures stand side by side where there is room,
            and words before them beside them.
        folded: Whether it is detail that stays closed until the reader opens it.
    """

    name: str
    title: str
    blocks: tuple[Block, ...]
    folded: bool = False


def again(command: str) -> tuple[Section, ...]:
    """Return a section with the command that makes the page again; none without a command."""
    return (Section("again", "Again", (Commands((command,)),), folded=True),) if command else ()


@dataclass(frozen=True)
class Page:
    """A page with a headline, the answer in its first screen, and sections.

    Args:
        first: What the first screen holds under the lead, side by side where there is room: the
            answer, and the picture that carries it.
    """

    title: str
    lead: str
    sections: tuple[Section, ...]
    facts: tuple[tuple[str, str], ...] = ()
    foot: str = ""
    first: tuple[Block, ...] = ()

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Every block of the page, in order."""
        return (*self.first, *(block for section in self.sections for block in section.blocks))

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """Every picture of the page, in order."""
        return tuple(block for block in self.blocks if isinstance(block, Picture))

    @property
    def marks(self) -> dict[str, int]:
        """How many requirements of all tables are met, missed and open."""
        tables = (block for block in self.blocks if isinstance(block, Table))
        counts = Counter(cell.mark for table in tables for row in table.cells for cell in row)
        return {mark: counts[mark] for mark in MARKS if mark}


LONG_TABLE = 14
"""Rows beyond which a table is folded."""


def html(page: Page) -> str:
    """Write a page as HTML that needs nothing but itself.

    Styles and pictures are inside it; it has no links to elsewhere, and no scripts but those of
    drawings that move.
    """
    sections = [(section, _grouped(section.blocks)) for section in page.sections]
    return template("workbench.reports", "page.html").render(
        page=page,
        sections=sections,
        palette=palette(),
        marks=MARKS,
        inline_svg=inline_svg,
        long=LONG_TABLE,
    )


def template(package: str, name: str) -> Template:
    """Return a template of HTML from the folder ``templates`` of a package."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(package, "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["joined"] = joined
    return environment.get_template(name)


_NUMBER = re.compile(
    r"(?<=[\d±…]) (?=[\d±…]|[^\W\d_]{1,3}\b|[%°/])|(?<=\b[^\W\d_]) (?=\d)"
    r"|(?<=\b[ANWms]) (?=[hms]\b)"
)


def joined(text: str) -> str:
    r"""Keep a number in one line with its unit, its symbol and the other end of its interval.

    Example:
        >>> joined("ζ 0.1, 5 ± 0.9 N m of 10 pulses").split(" ")
        ['ζ\xa00.1,', '5\xa0±\xa00.9\xa0N\xa0m', 'of', '10', 'pulses']
    """
    return _NUMBER.sub("\xa0", text)


def _grouped(blocks: Sequence[Block]) -> list[tuple[Block, ...]]:
    """Put neighbouring pictures together, and an odd number of them beside the words before."""
    groups: list[tuple[Block, ...]] = []
    for drawn, run in groupby(blocks, key=lambda block: isinstance(block, Picture)):
        if not drawn:
            groups += [(block,) for block in run]
            continue
        pictures = tuple(run)
        if len(pictures) % 2 and groups and isinstance(groups[-1][0], Words):
            pictures = (*groups.pop(), *pictures)
        groups.append(pictures)
    return groups


def write_page(page: Page, path: Path, *, pictures: Path | None = None) -> Path:
    """Write a page as an HTML file."""
    written = write_whole(path, html(page))
    if pictures is not None:
        for picture in page.pictures:
            save(picture, pictures)
    return written
