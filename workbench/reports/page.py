"""One self-contained HTML page: sections of words, tables, pictures and commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from workbench.files import write_whole
from workbench.reports.pictures import Picture, inline_svg
from workbench.reports.style import palette
from workbench.reports.tables import MARKS, Table


@dataclass(frozen=True)
class Words:
    """A paragraph.

    Args:
        text: Plain words; the page escapes them.
        weight: ``"plain"``, or ``"note"`` for something the reader should not overlook.
    """

    text: str
    weight: str = "plain"


@dataclass(frozen=True)
class Commands:
    """Command lines that reproduce what the page shows.

    Args:
        lines: One command each.
    """

    lines: tuple[str, ...]


@dataclass(frozen=True)
class Method:
    """How numbers were computed, folded away until the reader asks.

    Args:
        entries: Pairs of a quantity and how it was computed.
        title: What the entries are about.
    """

    entries: tuple[tuple[str, str], ...]
    title: str = "How each number was computed"


Block = Words | Table | Picture | Commands | Method


@dataclass(frozen=True)
class Section:
    """A part of a page under its own heading.

    Args:
        name: Name by which links find it, in small letters with hyphens.
        blocks: Its content in order; neighbouring pictures stand side by side where there is room.
    """

    name: str
    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Page:
    """A page with a headline, what it says in short, and sections.

    Args:
        lead: What the page is, in a sentence or two.
        facts: Pairs of words shown under the lead: duration, version, plant.
        foot: Last line.
    """

    title: str
    lead: str
    sections: tuple[Section, ...]
    facts: tuple[tuple[str, str], ...] = ()
    foot: str = ""

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """Every picture of the page, in order."""
        return tuple(b for s in self.sections for b in s.blocks if isinstance(b, Picture))

    @property
    def marks(self) -> dict[str, int]:
        """How many requirements of all tables are met, missed and open."""
        found: dict[str, int] = {mark: 0 for mark in MARKS if mark}
        for section in self.sections:
            for block in section.blocks:
                if isinstance(block, Table):
                    for row in block.cells:
                        for cell in row:
                            if cell.mark:
                                found[cell.mark] += 1
        return found


def html(page: Page) -> str:
    """Write a page as HTML that needs nothing but itself.

    Returns:
        The document: styles and pictures inside it, no scripts, no links to elsewhere.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("workbench.reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    sections = [(section, _grouped(section.blocks)) for section in page.sections]
    return environment.get_template("page.html").render(
        page=page, sections=sections, palette=palette(), marks=MARKS, inline_svg=inline_svg
    )


def _grouped(blocks: Sequence[Block]) -> list[tuple[str, list[Block]]]:
    """Put neighbouring pictures together, so that the page can set them side by side."""
    groups: list[tuple[str, list[Block]]] = []
    for block in blocks:
        kind = type(block).__name__.lower()
        if kind == "picture" and groups and groups[-1][0] == "picture":
            groups[-1][1].append(block)
        else:
            groups.append((kind, [block]))
    return groups


def write_page(page: Page, path: Path) -> Path:
    """Write a page as an HTML file.

    Raises:
        WorkbenchError: If the file cannot be written.
    """
    return write_whole(path, html(page))
