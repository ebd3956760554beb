"""The page in a real browser: nothing overflows, wide or narrow, and the dark ground is dark."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.reports.browser import BROWSER, MEASURE, measured, painted
from workbench.reports.page import Commands, Method, Page, Section, Words, html
from workbench.reports.pictures import Picture
from workbench.reports.style import PAPER, new_figure
from workbench.reports.tables import Cell, Table

pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")


def page() -> Page:
    figure, (axes,) = new_figure([1.5])
    axes.plot([0, 1], [0, 1])
    axes.set_xlabel("time in s")
    picture = Picture("steps", figure, "A step. " * 8)
    costs = ["settling", "overshoot", "steady error", "still moving", "stop impacts", "error, rms"]
    costs += ["command moves", "air", "solve, 99th percentile"]
    cells = [Cell("0.00439 °", "met", "no longer than the limit") for _ in costs]
    wide = Table(
        "Steps between 15° and 45° on the full plant, with what each of them costs",
        ("controller", "plant", *costs),
        (("sliding mode", "with muscle hysteresis", *cells),),
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
    assert found["outside"] == [] and found["cells"] == [] and found["overlap"] == []
    # Text of pictures on a phone: no smaller than 8 px, with the height of its line.
    assert float(str(found["text"])) > 8.0


@pytest.mark.system
def test_the_dark_page_is_dark(tmp_path: Path) -> None:
    found = measured(html(page()), MEASURE, 1280, tmp_path, dark=True)
    assert found["ground"] == painted(PAPER.dark)
