"""How objects show themselves: a line, tables of text or in a notebook, a picture, a data frame."""

from __future__ import annotations

import html
import math
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from workbench.errors import missing_package

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FOLDED = 14
"""A table with more rows than this is shown folded."""

_LONGEST = 80
"""Characters of a text beside a progress bar."""


@dataclass(frozen=True)
class Rows:
    """Rows under headings, as an object lists them; a notebook folds a long table.

    Args:
        rows: One sequence per row, as long as the headings.
    """

    title: str
    headings: tuple[str, ...]
    rows: Sequence[Sequence[object]]

    def _repr_html_(self) -> str:
        rows = [[_escaped(cell) for cell in row] for row in self.rows]
        # A column in which nothing stands would only take room.
        told = [i for i in range(len(self.headings)) if any(row[i] for row in rows)]
        head = "".join(f"<th>{_escaped(self.headings[i])}</th>" for i in told)
        body = "".join(
            "<tr>" + "".join(f"<td>{row[i]}</td>" for i in told) + "</tr>" for row in rows
        )
        opened = "" if len(self.rows) > _FOLDED else " open"
        return (
            f"<details{opened}><summary>{_escaped(self.title)}</summary><table>"
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></details>"
        )


def aligned_table(
    header: Sequence[str], rows: Sequence[Sequence[object]], *, width: int | None = 100
) -> str:
    """Return a table with aligned columns; the last one wraps, unless `width` is None.

    Example:
        >>> print(aligned_table(("signal", "unit"), [("angle", "rad"), ("valve", "V")]))
        signal  unit
        angle   rad
        valve   V
    """
    lines = [tuple(header), *(tuple(str(cell) for cell in row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header) - 1)]
    indent = sum(widths) + 2 * len(widths)
    room = 10**6 if width is None else max(30, width - indent)
    out = []
    for line in lines:
        start = "".join(cell.ljust(w) + "  " for cell, w in zip(line[:-1], widths, strict=True))
        wrapped = textwrap.wrap(line[-1], room) or [""]
        out.append((start + wrapped[0]).rstrip())
        out.extend(" " * indent + more for more in wrapped[1:])
    return "\n".join(out)


class Shown:
    r"""An object that shows itself by the tables that it lists.

    Example:
        >>> class Room(Shown):
        ...     def __str__(self):
        ...         return "room 3\n  two chairs"
        ...
        ...     def tables(self):
        ...         return (Rows("things", ("name", "count"), [("chair", 2)]),)
        >>> Room()
        <room 3>
        >>> "<td>chair</td><td>2</td>" in Room()._repr_html_()
        True
    """

    def tables(self) -> Iterable[Rows]:
        """Return what a notebook lists of the object, the most telling table first."""
        raise NotImplementedError

    def columns(self) -> Mapping[str, Any]:
        """Return the columns of `to_dataframe`; those of the first table by default."""
        first = next(iter(self.tables()))
        return {name: [row[i] for row in first.rows] for i, name in enumerate(first.headings)}

    def __repr__(self) -> str:
        return f"<{str(self).partition(chr(10))[0]}>"

    def _repr_html_(self) -> str:
        head = _escaped(str(self).partition("\n")[0])
        return f"<p><b>{head}</b></p>" + "".join(table._repr_html_() for table in self.tables())

    def to_dataframe(self) -> Any:
        """Return the object's main table as a ``pandas.DataFrame``."""
        try:
            pandas = import_module("pandas")
        except ImportError:
            raise missing_package("a data frame", "pandas", "notebooks") from None
        return pandas.DataFrame(dict(self.columns()))


class Drawn(Shown):
    """An object that has a picture of its own beside its tables."""

    def plot(self, *what: Any) -> Figure:
        """Draw the object.

        Args:
            what: What `workbench.notebook.plot` takes for an object of this kind.
        """
        # The pictures stand in a room above this one, which knows how each kind is drawn.
        figure: Figure = import_module("workbench.notebook").plot(self, *what)
        return figure


def in_notebook() -> bool:
    """Tell whether the interpreter is the kernel of a notebook."""
    # Programs may import a kernel's package and be none.
    shell = sys.modules.get("IPython")
    return shell is not None and hasattr(shell.get_ipython(), "kernel")


def notebook_progress() -> Callable[..., None]:
    """Return a function that shows a text, and how much is done, in a notebook's progress bar.

    Returns:
        Called with a text and, where they are known, the finished steps, all of them and the last
        one's name; does nothing outside of notebooks.

    Example:
        >>> show = notebook_progress()
        >>> show("fitting")
        >>> show("runs", 3, 12)
    """
    if not in_notebook() or find_spec("ipywidgets") is None:
        return lambda *_: None
    from tqdm.notebook import tqdm

    bar = tqdm(bar_format="{desc} {bar} {elapsed}", leave=False)

    def show(text: str, done: int = 0, total: int = 0, *_: str) -> None:
        if total and bar.total != total:
            bar.reset(total)
        bar.n = done
        bar.set_description_str(text[:_LONGEST])

    return show


def _escaped(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.4g}"
    return html.escape(str(value))
