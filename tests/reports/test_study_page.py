"""The page of a study in a real browser: nothing overflows, overlaps or is missing."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.reports.browser import BROWSER, MEASURE, measured, painted
from workbench.reports.page import Page, html
from workbench.reports.study_page import study_page
from workbench.reports.style import PAPER
from workbench.reports.tables import number
from workbench.study import physical_limit
from workbench.study.read import load_study, shipped_study
from workbench.study.result import StudyResult, run_study


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> StudyResult:
    """The shipped study with fewer runs, one of which fails, and one requirement that is missed."""
    place = tmp_path_factory.mktemp("study")
    text = shipped_study("arm").read_text(encoding="utf-8")
    text = re.sub(r'\[variations\."(?:3\.5 kg|4\.5 bar|late .*)"\]\n(?:.+\n)+', "", text)
    text = re.sub(r"\[scenarios\.sine[^\0]*?(?=\[scenarios\.disturbed\])", "", text)
    text = text.replace('scenario = "sine"\n', "").replace("draws = 16", "draws = 4")
    text = text.replace("search = 8", "search = 1").replace("limit = 0.8", "limit = 0.29")
    broken = '[controllers.broken]\ndesign = "tests.study.own_designs:fails"\n\n[scenarios.st'
    text = text.replace("[scenarios.st", broken, 1)
    path = place / "arm.toml"
    path.write_text(text, encoding="utf-8")
    baseline = shipped_study("arm").with_name("arm.baseline.json")
    # A limit takes seconds to find; what a page shows of it does not depend on its value.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            physical_limit, "physical_limit", lambda *_, **__: SimpleNamespace(seconds=0.11)
        )
        return run_study(load_study(path), place / "out", baseline=baseline)


@pytest.fixture(scope="module")
def page(outcome: StudyResult) -> Page:
    return study_page(outcome)


@pytest.mark.system
def test_every_part_is_there(outcome: StudyResult, page: Page) -> None:
    # The scores and a picture stand on the first screen.
    assert [type(block).__name__ for block in page.first] == ["Table", "Picture"]
    names = [section.name for section in page.sections]
    assert names == ["verdict", "baseline", "scenario-1", "scenario-2", "limit", "sliding",
                     "solver", "linear", "robustness", "requirements", "how"]  # fmt: skip
    pictures = {picture.name for picture in page.pictures}
    assert {"tracking-1", "outputs-1", "portrait-2", "surface-2", "solver", "plant-bode",
            "plant-map", "physical-limit", "bode-1", "nyquist-3",
            "box-scores"} <= pictures  # fmt: skip
    text = html(page)
    assert "ZeroDivisionError: gain is zero" in text and "✗" in text
    assert page.marks["missed"] > 0 and not outcome.passed
    (limit,) = [section for section in page.sections if section.name == "limit"]
    said = "\n".join(str(block) for block in limit.blocks)
    record = outcome.record("cascade PID", "staircase")
    assert record is not None
    for step in record.steps:
        assert f"{number(step.settling.value, unit='s')}" in said
    assert "15° to 30°" in said and "the load and the supply pressure change" in said
    # Every metric by one name, and no unit behind a count.
    assert "_time" not in re.sub(r"<pre.*?</pre>", "", text, flags=re.DOTALL)
    assert "at most 0 1" not in text
    assert "src=" not in text and "http" not in text.replace("http-equiv", "")


@pytest.mark.system
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")
@pytest.mark.parametrize(("width", "dark"), [(390, True), (1280, False)])
def test_in_a_browser(page: Page, width: int, dark: bool, tmp_path: Path) -> None:
    found = measured(html(page), MEASURE, width, tmp_path, dark=dark)
    assert found["outside"] == []
    assert found["cells"] == [] and found["overlap"] == []
    assert found["content"] == found["width"]
    assert found["pictures"] == len(page.pictures) and found["empty"] == 0
    # The smallest text of a picture, exponents of ten, on a phone.
    assert float(str(found["text"])) > 6.0
    assert found["ground"] == painted(PAPER.dark if dark else PAPER.light)
