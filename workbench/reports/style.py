"""Colours, type and lines of every picture: one colour per controller everywhere.

Each colour has a value on light paper and one on a dark screen. Pictures are drawn with the light
values; `workbench.reports.pictures` lets a page replace them when it is shown dark.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy.typing as npt

from workbench.errors import check_range

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


@dataclass(frozen=True)
class Colour:
    """A colour on light paper and on a dark screen."""

    name: str
    light: str
    dark: str


FURTHER: tuple[Colour, ...] = (
    Colour("further-1", "#b36df6", "#8f4cc0"),
    Colour("further-2", "#939453", "#fee665"),
    Colour("further-3", "#255240", "#048a1f"),
    Colour("further-4", "#601903", "#b48788"),
    Colour("further-5", "#ea55a4", "#bc3576"),
    Colour("further-6", "#132e75", "#5e7ef5"),
)
"""For controllers without a colour of their own, laws, and other things to be told apart: by their
lightness too, as those see them who tell no red from green, or no blue from yellow."""

INK = Colour("ink", "#1d2226", "#e8eaed")
MEASURED = Colour("measured", "#30373d", "#d5d9de")
SIMULATED = Colour("simulated", "#b01f63", "#ff86bd")
REFERENCE = Colour("reference", "#70777d", "#9aa2a9")
LINK = Colour("link", "#0060a6", "#5fb6f4")
FAINT = Colour("faint", "#b3bac0", "#59626b")
GRID = Colour("grid", "#dde1e4", "#343b42")
BAND = Colour("band", "#eaf1e4", "#26332a")
PAPER = Colour("paper", "#fefefe", "#15191d")

ROLES: tuple[Colour, ...] = (INK, MEASURED, SIMULATED, REFERENCE, LINK, FAINT, GRID, BAND, PAPER)
"""Everything that is no controller."""

RAMP: tuple[Colour, ...] = (
    Colour("ramp-1", "#3b2f80", "#a99bff"),
    Colour("ramp-2", "#2f5f9e", "#77b0f0"),
    Colour("ramp-3", "#1f8a94", "#5fd0d4"),
    Colour("ramp-4", "#3fa35c", "#8ae09a"),
    Colour("ramp-5", "#8d9a1c", "#d3dc62"),
    Colour("ramp-6", "#c27b12", "#f5b95c"),
    Colour("ramp-7", "#b8442b", "#ff9077"),
)
"""An ordered family, such as angles or contractions, from the smallest to the largest."""


@cache
def controller_colours() -> dict[str, Colour]:
    """Return the colours that designs state of their families, by family."""
    from controllers.design import DESIGNS

    found: dict[str, Colour] = {}
    for design in DESIGNS.members().values():
        if design.colour is not None and design.family not in found:
            name = re.sub(r"[^a-z0-9]+", "-", design.family.lower()).strip("-")
            found[design.family] = Colour(name, *design.colour)
    return found


def _own(name: str) -> Colour | None:
    """Return the colour of a family, or of the family of a design; None if it has none."""
    from controllers.design import DESIGNS

    design = DESIGNS.members().get(name)
    return controller_colours().get(name if design is None else design.family)


def palette() -> tuple[Colour, ...]:
    """Return every colour that a page may show."""
    return (*controller_colours().values(), *FURTHER, *ROLES, *RAMP)


WIDTH_INCHES = 5.2
"""One width for all pictures: readable on a phone, and two stand side by side on a screen."""

FONT_POINTS = 11.0

_POINTS_PER_LETTER = 0.58 * FONT_POINTS
_INCHES_PER_ROW = 1.5 * (FONT_POINTS - 1.0) / 72.0
_ROWS = 2
"""Rows of a legend that a picture has room for, and the height of a further one."""


def colours(names: Iterable[str]) -> dict[str, Colour]:
    """Return one colour per controller, the same in every picture.

    Families of the workbench's designs have their own, and so have their designs; any other name
    always takes the same one of the further colours, unless a name before it has taken that.

    Example:
        >>> [colour.name for colour in colours(["cascade PID", "mine", "plain-mpc"]).values()]
        ['cascade-pid', 'further-2', 'linear-mpc']
    """
    given: dict[str, Colour] = {}
    for name in dict.fromkeys(names):
        own = _own(name)
        if own is not None and own not in given.values():
            given[name] = own
            continue
        further = 1 + sum(c in FURTHER for c in given.values())
        check_range("number of curves to tell apart", further, 0, len(FURTHER))
        first = crc32(name.encode()) % len(FURTHER)
        order = (*FURTHER[first:], *FURTHER[:first])
        given[name] = next(c for c in order if c not in given.values())
    return given


def shades(names: Iterable[str]) -> dict[str, Colour]:
    """Return a colour for each of any number of names: `colours`, begun anew where all are given.

    Example:
        >>> len(set(shades(f"design {i}" for i in range(10)).values()))
        6
    """
    listed = list(dict.fromkeys(names))
    known = {name: own for name in listed if (own := _own(name)) is not None}
    further = [name for name in listed if name not in known]
    size = len(FURTHER)
    given = [colours(further[i : i + size]) for i in range(0, len(further), size)]
    return {n: c for some in (known, *given) for n, c in some.items()}


def told_apart(shades: Mapping[str, Colour]) -> list[list[str]]:
    """Return names in groups, as they come, in which no colour is there twice.

    Example:
        >>> [len(group) for group in told_apart(shades(f"design {i}" for i in range(10)))]
        [6, 4]
    """
    groups: list[list[str]] = []
    for name, shade in shades.items():
        free = (g for g in groups if shade not in {shades[other] for other in g})
        if (group := next(free, None)) is None:
            groups.append(group := [])
        group.append(name)
    return groups


def ramp(count: int) -> tuple[Colour, ...]:
    """Return colours for an ordered family, spread over the ramp."""
    check_range("number of curves in a family", count, 1, len(RAMP))
    last = len(RAMP) - 1
    return tuple(RAMP[round(i * last / max(count - 1, 1))] for i in range(count))


def new_figure(heights: Iterable[float], *, share_x: bool = True) -> tuple[Figure, list[Axes]]:
    """Return an empty figure of the common width with panels above each other, labels in line.

    Args:
        heights: Height of each panel, in inches of 25.4 mm.
    """
    from matplotlib.figure import Figure

    rows = list(heights)
    figure = Figure(figsize=(WIDTH_INCHES, sum(rows) + 0.55), layout="constrained")
    figure.patch.set_facecolor(PAPER.light)
    grid = figure.subplots(
        len(rows), 1, sharex=share_x, squeeze=False, gridspec_kw={"height_ratios": rows}
    )
    panels = [row[0] for row in grid]
    for axes in panels:
        _dress(axes)
    figure.align_ylabels()
    return figure, panels


def _dress(axes: Axes) -> None:
    axes.set_facecolor("none")
    axes.grid(True, color=GRID.light, linewidth=0.8)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(FAINT.light)
    axes.tick_params(colors=INK.light, labelsize=FONT_POINTS - 1, color=FAINT.light)
    axes.margins(x=0)


def label(axes: Axes, *, x: str | None = None, y: str | None = None) -> None:
    """Write the labels of a panel, with their units; a ratio has none.

    What is drawn over a ``time in s`` of hours or days is labelled in those.
    """
    from matplotlib.ticker import ScalarFormatter

    x, y = (text and re.sub(r"(\s+in 1|/1)$", "", text) for text in (x, y))
    if x is not None:
        if x.startswith("time in s"):
            x = f"time in {time_ticks(axes)}{x.removeprefix('time in s')}"
        axes.set_xlabel(x, fontsize=FONT_POINTS, color=INK.light)
        if isinstance(axes.xaxis.get_major_formatter(), ScalarFormatter):
            # Microseconds and days alike: a power of ten at the axis, lest numbers meet.
            numbers = ScalarFormatter(useMathText=True)
            numbers.set_powerlimits((-3, 5))
            axes.xaxis.set_major_formatter(numbers)
    if y is not None:

        class Powers(ScalarFormatter):
            """Numbers with a power of ten of their own, which at the axis lies in the legend."""

            def format_ticks(self, values: list[float]) -> list[str]:
                texts = super().format_ticks(values)
                far = super().get_offset()
                return [self.fix_minus(f"{v:g}") for v in values] if far else texts

            def get_offset(self) -> str:
                return ""

        if isinstance(axes.yaxis.get_major_formatter(), ScalarFormatter):
            axes.yaxis.set_major_formatter(Powers(useOffset=False))
        axes.set_ylabel(_broken(y, axes), fontsize=FONT_POINTS, color=INK.light)


def decades(axes: Axes) -> None:
    """Write plain numbers on a logarithmic axis, three per decade where it spans few of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    within = (1.0, 2.0, 5.0) if high < 100 * low else (1.0,)
    axes.yaxis.set_major_locator(LogLocator(subs=within, numticks=6))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(which="minor", left=False)


def bars(
    axes: Axes,
    places: npt.ArrayLike,
    lengths: npt.ArrayLike,
    texts: Sequence[str],
    shade: Colour,
    *,
    height: float,
    name: str,
) -> None:
    """Draw bars that lie, with a text behind each.

    Args:
        places: Where they lie, shape (n,), in units of the axis.
        lengths: Their lengths, shape (n,), in units of the other axis.
        height: Height of one, in units of the axis.
    """
    drawn = axes.barh(places, lengths, height, color=shade.light, label=name)
    axes.bar_label(drawn, texts, padding=4, fontsize=FONT_POINTS - 1, color=INK.light)


def time_ticks(axes: Axes) -> str:
    """Place round ticks on an axis of time, in s, in the unit that suits its end; return it."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

    from workbench.model.units import time_unit

    low, high = axes.get_xlim()
    unit, size = time_unit(high)
    if unit != "s":
        ticks = MaxNLocator(7).tick_values(low / size, high / size)
        inside = [size * float(tick) for tick in ticks if low <= size * tick <= high]
        axes.xaxis.set_major_locator(FixedLocator(inside))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / size:g}"))
    return unit


def _broken(text: str, axes: Axes) -> str:
    """Break a label before its unit where it is longer than its panel, lest two labels meet."""
    spec = axes.get_subplotspec()
    if spec is None:
        return text
    ratios: Any = spec.get_gridspec().get_height_ratios()
    room = 72.0 * ratios[spec.rowspan.start]
    words, unit = text.rpartition(" in ")[::2]
    if len(text) * _POINTS_PER_LETTER <= room or not words:
        return text
    return f"{words}\nin {unit}"


def key(axes: Axes, *, columns: int = 3, handles: list[Line2D] | None = None) -> None:
    """Write the legend above a panel, where it covers no curve.

    Args:
        columns: Entries side by side; fewer where they are too long for that.
    """
    named = axes.get_legend_handles_labels()[0] if handles is None else handles
    columns = _fitting([len(str(line.get_label())) for line in named], columns)
    figure = axes.get_figure(root=True)
    if figure is not None and (more := math.ceil(len(named) / columns) - _ROWS) > 0:
        # The picture grows, lest the panels shrink.
        width, height = figure.get_size_inches()
        figure.set_size_inches(width, height + more * _INCHES_PER_ROW)
    axes.legend(
        handles=named,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0, 1.0, 0.1),
        borderaxespad=0.2,
        ncols=columns,
        frameon=False,
        fontsize=FONT_POINTS - 1,
        labelcolor=INK.light,
        handlelength=1.6,
        columnspacing=1.2,
        handletextpad=0.5,
    )


def named_line(
    name: str,
    shade: Colour,
    *,
    width: float = 1.2,
    style: Any = "-",
    alpha: float | None = None,
    marker: str = "",
) -> Line2D:
    """Return an entry of a legend that stands for curves of a colour and look.

    Args:
        width: Width of the line, in units of a point.
        style: Its dashes; none with a marker.
        alpha: Share of the ground that it covers, a fraction.
    """
    from matplotlib.lines import Line2D

    dashes = "none" if marker else style
    return Line2D(
        [], [], color=shade.light, label=name, lw=width, ls=dashes, alpha=alpha, marker=marker, ms=4
    )


def _fitting(letters: list[int], columns: int) -> int:
    """Return how many columns of a legend fit, filled from above; a line takes five letters."""
    for count in range(min(columns, len(letters)), 1, -1):
        rows = math.ceil(len(letters) / count)
        widths = [5 + max(letters[i : i + rows]) for i in range(0, len(letters), rows)]
        if sum(widths) * _POINTS_PER_LETTER <= 0.87 * 72.0 * WIDTH_INCHES:
            return count
    return 1
