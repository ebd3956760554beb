"""Figures as files and as parts of a page that follow its light or dark ground."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.errors import WorkbenchError
from workbench.files import write_whole
from workbench.reports.style import FONT_POINTS, palette

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FONTS = "system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', 'DejaVu Sans', sans-serif"
"""Fonts of the page; the picture is laid out with DejaVu Sans, which is wider than all of them."""

_PIXELS_PER_INCH = 160


@dataclass(frozen=True)
class Picture:
    """A figure on a page, with what it shows in words.

    Args:
        name: Name of its files, in small letters with hyphens.
    """

    name: str
    figure: Figure
    caption: str
    alternative: str = ""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z][a-z0-9-]*", self.name):
            raise WorkbenchError(
                f"picture name {self.name!r} may hold small letters, digits and hyphens only"
            )

    @cached_property
    def document(self) -> str:
        """The picture as an SVG document, drawn once: a page and a file need the same."""
        from matplotlib import rc_context

        stream = io.StringIO()
        _plain_words(self.figure)
        with rc_context(_settings(self.name)):  # type: ignore[arg-type]
            self.figure.savefig(
                stream, format="svg", metadata={"Date": None, "Creator": None}, dpi=72
            )
        # Laid out once; the layout takes longer than the drawing.
        self.figure.set_layout_engine("none")
        return stream.getvalue()


def _plain_words(figure: Figure) -> None:
    """Take words as they stand: a dollar sign in a name is no formula, nor is a power of ten."""
    from matplotlib.text import Text
    from matplotlib.ticker import Formatter

    class Worded(Formatter):
        """What another formatter writes, with its powers of ten in words."""

        def __init__(self, wrapped: Formatter) -> None:
            self.set_axis = wrapped.set_axis  # type: ignore[method-assign]
            self.set_locs = wrapped.set_locs  # type: ignore[method-assign]
            self.wrapped = wrapped

        def __call__(self, x: float, pos: int | None = None) -> str:
            return _worded(self.wrapped(x, pos))

        def format_ticks(self, values: list[float]) -> list[str]:
            return [_worded(text) for text in self.wrapped.format_ticks(values)]

        def get_offset(self) -> str:
            return _worded(self.wrapped.get_offset())

    for text in figure.findobj(Text):
        text.set_parse_math(False)
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            for ticks in (axis.major, axis.minor):
                if ticks.formatter and not isinstance(ticks.formatter, Worded):
                    ticks.formatter = Worded(ticks.formatter)


def _worded(text: str) -> str:
    r"""Write a tick's formula as words.

    Example:
        >>> _worded(r"$\mathdefault{2\times10^{-3}}$")
        '2×10⁻³'
    """
    if r"\mathdefault" not in text:
        return text
    text = re.sub(r"\^\{(.*?)\}", lambda power: power[1].translate(_RAISED), text)
    return re.sub(r"\\mathdefault|[${}]", "", text.replace(r"\times", "×"))


_RAISED = str.maketrans("-−0123456789", "⁻⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def _settings(name: str) -> dict[str, object]:
    return {
        "font.family": ["DejaVu Sans"],
        "font.size": FONT_POINTS,
        "axes.unicode_minus": True,
        "svg.fonttype": "none",
        "svg.hashsalt": name,
        "path.simplify": True,
        "path.simplify_threshold": 0.3,
    }


def inline_svg(picture: Picture) -> str:
    """Draw a picture as an SVG element that takes its colours from the page around it.

    Each colour of the palette becomes a CSS variable with its light value as fall-back, and all
    identifiers carry the picture's name, so that several pictures stand on one page.
    """
    text = picture.document
    text = text[text.index("<svg") :]
    text = re.sub(r"<(metadata|style)\b.*?</\1>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{picture.name}-', text)
    text = text.replace('xlink:href="#', f'href="#{picture.name}-')
    text = text.replace("url(#", f"url(#{picture.name}-")
    text = re.sub(r'\s+xmlns(?::xlink)?="[^"]*"', "", text)
    # A fixed size would overflow a phone; the view box keeps the proportions.
    head, rest = text.split(">", 1)
    head = re.sub(r'\s(?:width|height)="[^"]*"', "", head)
    title = picture.alternative or picture.caption
    head += f' role="img" aria-label="{escape(title)}"'
    for colour in palette():
        rest = rest.replace(f": {colour.light}", f": var(--{colour.name}, {colour.light})")
    rest = rest.replace("'DejaVu Sans'", FONTS.replace('"', "'"))
    # Text without a colour of its own is black, which a dark page would swallow.
    rest = rest.replace("<text ", '<text fill="currentColor" ')
    return f"{head}>{rest}"


def save(picture: Picture, folder: Path) -> tuple[Path, Path]:
    """Write a picture as ``NAME.png`` and ``NAME.svg`` into a folder."""
    from matplotlib import rc_context

    document = picture.document
    stream = io.BytesIO()
    with rc_context(_settings(picture.name)):  # type: ignore[arg-type]
        picture.figure.savefig(
            stream, format="png", dpi=_PIXELS_PER_INCH, metadata={"Software": None}
        )
    return (
        write_whole(folder / f"{picture.name}.png", stream.getvalue()),
        write_whole(folder / f"{picture.name}.svg", document),
    )
