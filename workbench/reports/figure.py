"""Figures: what a page may draw of a result, each one object, a user's own included."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from workbench.errors import WorkbenchError
from workbench.registry import Registry, user_code
from workbench.reports.page import Block, Commands, Method, Section, Words
from workbench.reports.pictures import Picture
from workbench.reports.tables import Table

Takes = Literal["study", "scenario", "diagnosis"]
"""What a figure is drawn of: a study's result; that and the name of a scenario; a diagnosis."""

_BLOCKS = (Words, Table, Picture, Commands, Method)


@dataclass(frozen=True)
class Figure:
    """Something that pages show of a result: pictures, with the words and tables beside them.

    Args:
        name: Name of its section and its files, in small letters with hyphens.
        draw: Called with what ``takes`` says; returns blocks of a page or figures of matplotlib,
            one or several, and nothing where there is nothing to show.
        folded: Whether its section is detail that stays closed until the reader opens it.
        methods: How its numbers are computed: pairs of a quantity and an explanation.
    """

    name: str
    draw: Callable[..., Any]
    takes: Takes = "study"
    title: str = ""
    caption: str = ""
    order: int = 1000
    folded: bool = False
    methods: tuple[tuple[str, str], ...] = ()

    def blocks(self, *result: Any) -> tuple[Block, ...]:
        """Draw it; a figure that fails leaves a note, for the runs behind a page are costly."""
        try:
            with user_code(f"figure {self.name!r}"):
                drawn = self.draw(*result)
                return tuple(self._block(item, i) for i, item in enumerate(_several(drawn)))
        except WorkbenchError as error:
            return (Words(f"Not drawn: {error}.", "note"),)

    def _block(self, item: Any, index: int) -> Block:
        if isinstance(item, _BLOCKS):
            return item
        if hasattr(item, "savefig"):
            name = self.name if index == 0 else f"{self.name}-{index + 1}"
            return Picture(name, item, self.caption or self.title or self.name)
        raise WorkbenchError(
            f"figure {self.name!r} returned a {type(item).__name__}; it must return figures of"
            " matplotlib or blocks of a page"
        )


def _several(drawn: Any) -> Sequence[Any]:
    if drawn is None:
        return ()
    return drawn if isinstance(drawn, (list, tuple)) else (drawn,)


def _from_function(found: Any, reference: str) -> Figure:
    if not callable(found):
        raise WorkbenchError(
            f"figure {reference!r} is a {type(found).__name__}; give a Figure, or a function of the"
            " result that returns a figure of matplotlib"
        )
    words = (found.__doc__ or "").strip().split("\n")[0]
    name = re.sub(r"[^a-z0-9]+", "-", reference.rpartition(":")[2].lower()).strip("-")
    title = name.replace("-", " ").capitalize()
    return Figure(f"own-{name}", found, title=title, caption=words)


FIGURES = Registry(
    "figure",
    Figure,
    package="workbench.reports.figures",
    group="workbench.figures",
    adopt=_from_function,
)


def figures_of(takes: Takes) -> list[Figure]:
    """Return the figures of the workbench and of installed packages for one kind of result."""
    found = [f for f in FIGURES.members().values() if f.takes == takes]
    return sorted(found, key=lambda f: (f.order, f.name))


def sections(figures: Iterable[Figure], *result: Any) -> list[Section]:
    """Return a section for every figure that has something to show of a result."""
    drawn = [(figure, figure.blocks(*result)) for figure in figures]
    return [Section(f.name, f.title or f.name, blocks, f.folded) for f, blocks in drawn if blocks]


def own_figures(names: Iterable[str], *, folder: Path | None = None) -> list[Figure]:
    """Return the figures that a study names, by name or as ``module:object``."""
    return [FIGURES.get(name, folder=folder) for name in names]
