"""The page in a real browser: nothing overflows, wide or narrow, and the dark ground is dark."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.reports.browser import BROWSER, measured
from workbench.reports.page import Commands, Method, Page, Section, Words, html
from workbench.reports.pictures import Picture
from workbench.reports.style import PAPER, new_figure
from workbench.reports.tables import Cell, Table

pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")

MEASURE = """
<script>
addEventListener("load", () => {
  const inner = document.querySelector("iframe").contentDocument;
  // What is folded must fit too.
  for (const folded of inner.querySelectorAll("details")) folded.open = true;
  const width = inner.documentElement.clientWidth;
  const outside = [...inner.querySelectorAll("body *")].filter(e => {
    const box = e.getBoundingClientRect();
    // A table scrolls in its own box, under its title.
    return (e.matches("caption *") || !e.closest("svg *, .table *")) && box.width > 0
      && (box.right > width + 1 || box.left < -1);
  }).map(e => e.tagName + ": " + e.textContent.trim().slice(0, 40));
  // Of an overflowing cell the box fits but its content does not.
  const cells = [...inner.querySelectorAll("td, th, p, pre, h1, h2")].filter(
    e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline");
  const text = inner.querySelector("svg text").getBoundingClientRect().height;
  document.body.textContent = JSON.stringify({
    width, content: inner.documentElement.scrollWidth, outside,
    cells: cells.map(e => e.textContent.trim().slice(0, 40)), text,
    ground: getComputedStyle(inner.querySelector("section")).backgroundColor,
  });
});
</script>
"""


def page() -> Page:
    figure, (axes,) = new_figure([1.5])
    axes.plot([0, 1], [0, 1])
    axes.set_xlabel("time in s")
    picture = Picture("steps", figure, "A step. " * 8)
    wide = Table(
        "Steps between 15° and 45° on the full plant, with what each of them costs",
        (
            "controller",
            "plant",
            "settling",
            "overshoot",
            "steady error",
            "still moving",
            "stop impacts",
            "error, rms",
            "command moves",
            "air",
            "solve, 99th percentile",
        ),
        (
            (
                "sliding mode",
                "with muscle hysteresis",
                *(Cell("0.00439 °", "met", "no longer than the limit") for _ in range(9)),
            ),
        ),
    )
    long = "workbench verify " + "--controller sliding-mode " * 6 + "--parameter " + "a" * 70
    blocks = (
        Words("Words. " * 60),
        picture,
        wide,
        Method((("settling", "until " * 40),)),
        Commands((long,)),
    )
    return Page(
        "Antagonistic pneumatic-muscle arm",
        "In short. " * 20,
        (Section("one", "A heading of some length for a narrow screen", blocks),),
        facts=(("requirements", "69 met, 0 missed"), ("workbench", "0.1.0")),
    )


@pytest.mark.system
@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_overflows(width: int, tmp_path: Path) -> None:
    found = measured(html(page()), MEASURE, width, tmp_path)
    assert found["content"] == found["width"]
    assert found["outside"] == [] and found["cells"] == []
    # Text of pictures on a phone: no smaller than 8 px, with the height of its line.
    assert float(str(found["text"])) > 8.0


@pytest.mark.system
def test_the_dark_page_is_dark(tmp_path: Path) -> None:
    channels = [int(PAPER.dark[i : i + 2], 16) for i in (1, 3, 5)]
    expected = f"rgb({channels[0]}, {channels[1]}, {channels[2]})"
    found = measured(html(page()), MEASURE, 1280, tmp_path, dark=True)
    assert found["ground"] == expected
