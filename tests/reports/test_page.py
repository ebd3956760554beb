"""The page needs nothing but itself and says what it was given."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from workbench.errors import WorkbenchError
from workbench.reports.page import (
    LONG_TABLE,
    Answers,
    Commands,
    Method,
    Moving,
    Page,
    Section,
    Words,
    html,
    write_page,
)
from workbench.reports.pictures import Picture, inline_svg, save
from workbench.reports.style import controller_colours, new_figure
from workbench.reports.tables import Cell, Table, interval, number

VOID = {"meta", "br", "img", "link", "hr", "input"}


class Outline(HTMLParser):
    """Collects identifiers and references, and checks that every element is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.stack.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(str(value))
            if name in ("href", "src", "xlink:href"):
                self.links.append(str(value))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.stack.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag


def picture(name: str) -> Picture:
    figure, (axes,) = new_figure([1.5])
    axes.plot([0, 1], [0, 1], "o-", color=controller_colours()["linear MPC"].light)
    return Picture(name, figure, f"What {name} shows.")


def page() -> Page:
    table = Table(
        "Metrics",
        ("controller", "settling", "overshoot", "error"),
        (("PID", Cell("0.6 s", "met"), Cell("7 °", "missed", "limit 5 °"), Cell("–", "open")),),
    )
    blocks = (
        Words("Less than 5 % & more than <b>."),
        picture("first"),
        picture("second"),
        table,
        Method((("settling", "until it stays"),)),
        Commands(("workbench demo --out demo",)),
    )
    return Page("Report", "In short.", (Section("one", "One", blocks), Section("two", "Two", ())))


def outline(text: str) -> Outline:
    found = Outline()
    found.feed(text)
    assert not found.stack
    return found


def test_the_page_needs_nothing_from_elsewhere() -> None:
    text = html(page())
    links = outline(text).links
    assert links and all(link.startswith("#") for link in links)
    assert "<script" not in text
    assert not re.search(r"url\((?!#)|@import|https?://", text)


def test_identifiers_are_unique_and_every_reference_finds_one() -> None:
    text = html(page())
    found = outline(text)
    assert len(set(found.ids)) == len(found.ids)
    targets = {link[1:] for link in found.links} | set(re.findall(r"url\(#([^)]+)\)", text))
    assert targets <= set(found.ids)


def test_words_are_escaped() -> None:
    assert "Less than 5\xa0% &amp; more than &lt;b&gt;." in html(page())


def test_neighbouring_pictures_stand_side_by_side() -> None:
    assert html(page()).count('<div class="beside">') == 1


def test_words_stand_beside_a_single_picture() -> None:
    alone = Page("", "", (Section("one", "One", (Words("Beside."), picture("first"))),))
    beside = html(alone).partition('<div class="beside">')[2]
    assert beside.lstrip().startswith("<p>Beside.</p>")


def test_the_answer_stands_before_the_sections_and_detail_is_folded() -> None:
    answers = Answers((("what", "friction"), ("where", "joint")))
    folded = Section("detail", "Detail", (Words("Long."),), folded=True)
    text = html(Page("", "", (folded, folded), first=(answers, picture("first"))))
    assert text.index("friction") < text.index("<nav") < text.index("Long.")
    assert text.count("<details><summary><h2") == 2


def test_a_long_table_is_folded_and_a_short_one_is_not() -> None:
    rows = tuple((str(i),) for i in range(LONG_TABLE + 1))
    for shown, folds in ((rows, 1), (rows[:-1], 0)):
        section = Section("one", "One", (Table("Numbers", ("n",), shown),))
        assert html(Page("", "", (section,))).count("<details>") == folds


def test_what_was_not_computed_is_absent() -> None:
    rows = (("one", "–", "", "–"), ("two", "–", "", Cell("–", reason="the run failed")))
    told = Table("Numbers", ("run", "a", "b", "c"), rows).told()
    assert told.headings == ("run", "c") and told.rows == (("one", "–"), ("two", rows[1][3]))
    whole = Table("Numbers", ("run", "a"), (("one", "1"), ("two", "–")))
    assert whole.told() is whole


def test_a_script_comes_only_with_what_moves() -> None:
    moving = Moving("<div><script>0</script></div>", "Moves.")
    assert "<script>0</script>" in html(Page("", "", (), first=(moving,)))


def test_marks_are_counted_and_said_in_words() -> None:
    assert page().marks == {"met": 1, "missed": 1, "open": 1}
    text = html(page())
    # A colour alone says nothing to those who cannot tell green from red.
    assert "✓ met" in text and "✗ missed" in text and "limit 5 °" in text


def test_colours_follow_the_ground() -> None:
    drawn = inline_svg(picture("first"))
    assert "var(--linear-mpc, #00805c)" in drawn
    assert not re.search(r"(?:fill|stroke): #", drawn)
    text = html(page())
    assert f"--linear-mpc: {controller_colours()['linear MPC'].dark}" in text
    assert "prefers-color-scheme: dark" in text and "@media print" in text


def test_text_of_pictures_is_text() -> None:
    figure, (axes,) = new_figure([1.5])
    axes.set_xlabel("time in s")
    assert ">time in s</text>" in inline_svg(Picture("labelled", figure, "Labelled."))


def test_the_same_page_is_the_same_text() -> None:
    assert html(page()) == html(page())


def test_pictures_are_saved_as_files(tmp_path: Path) -> None:
    png, svg = save(picture("first"), tmp_path)
    assert png.read_bytes()[:4] == b"\x89PNG" and svg.read_text().startswith("<?xml")


def test_a_page_is_written(tmp_path: Path) -> None:
    assert "In short." in write_page(page(), tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_row_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="row 1 of table 'Metrics' has 1 entries"):
        Table("Metrics", ("a", "b"), (("1",),))


def test_a_picture_name_that_is_no_file_name_is_refused() -> None:
    figure, _ = new_figure([1.5])
    with pytest.raises(WorkbenchError, match="small letters"):
        Picture("../first", figure, "")


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.000123456, 3, "0.000123"),
        (-1.005, 3, "−1.00"),
        (0.9996, 3, "1.00"),
        (12345.6, 3, "12300"),
        (1e-9, 2, "1.0e−09"),
        (float("nan"), 3, "–"),
        (float("inf"), 3, "∞"),
        (0.0, 3, "0"),
        (4, 3, "4"),
    ],
)
def test_numbers_are_written_with_their_digits(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


def test_an_interval_has_both_ends() -> None:
    assert interval(-1.0, 2.0, 2, unit="V") == "−1.0 … 2.0 V"
