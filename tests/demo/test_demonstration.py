"""The demonstration writes everything or what was finished, and never half a page."""

from __future__ import annotations

import json
import sys
import types
from collections.abc import Callable
from pathlib import Path

import pytest

from workbench.demo.demonstration import run_demo
from workbench.demo.part import Part
from workbench.errors import WorkbenchError
from workbench.reports.page import Section, Words
from workbench.reports.pictures import Picture
from workbench.reports.style import new_figure
from workbench.reports.tables import Cell, Table


def good() -> Part:
    figure, _ = new_figure([1.5])
    table = Table("Numbers", ("what", "value"), (("settling", Cell("0.4 s", "met")),))
    blocks = (Words("Shown."), Picture("steps", figure, "Steps."), table)
    return Part(Section("good", "Good", blocks), {"settling_s": 0.4, "none": float("nan")})


def bad() -> Part:
    raise WorkbenchError("the arm cannot rest there")


def stopped() -> Part:
    raise KeyboardInterrupt


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[tuple[str, str, str], ...]]:
    def build(*functions: Callable[[], Part]) -> tuple[tuple[str, str, str], ...]:
        found = []
        for function in functions:
            name = function.__name__
            module = types.ModuleType(f"workbench.demo.{name}")
            module.part = function  # type: ignore[attr-defined]
            monkeypatch.setitem(sys.modules, module.__name__, module)
            found.append((f"the {name} part", name, "part"))
        return tuple(found)

    return build


def test_everything_is_written(tmp_path: Path, parts: Callable[..., tuple]) -> None:
    steps: list[str] = []
    result = run_demo(tmp_path / "out", parts=parts(good), progress=steps.append)
    assert result.complete and result.met == 1
    assert steps == ["the good part", "page and pictures"]
    names = {p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*")}
    pictures = {"pictures", "pictures/steps.png", "pictures/steps.svg"}
    assert names == {"report.html", "results.json"} | pictures
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["good"] == {"settling_s": 0.4, "none": None}
    assert results["requirements"] == {"met": 1, "missed": 0, "open": 0}


def test_a_part_that_fails_says_why_and_the_others_are_shown(
    tmp_path: Path, parts: Callable[..., tuple]
) -> None:
    result = run_demo(tmp_path, parts=parts(bad, good))
    assert not result.complete
    assert "the arm cannot rest there" in str(result)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "the arm cannot rest there" in text and "Shown." in text


def test_ctrl_c_leaves_what_was_finished(tmp_path: Path, parts: Callable[..., tuple]) -> None:
    result = run_demo(tmp_path, parts=parts(good, stopped, bad))
    assert result.interrupted and not result.complete
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Shown." in text and "interrupted" in text
    assert json.loads((tmp_path / "results.json").read_text())["interrupted"] is True


def test_an_earlier_result_survives_a_crash(
    tmp_path: Path, parts: Callable[..., tuple], monkeypatch: pytest.MonkeyPatch
) -> None:
    run_demo(tmp_path / "out", parts=parts(good))
    before = (tmp_path / "out" / "results.json").read_text()

    def crash() -> Part:
        raise RuntimeError

    with pytest.raises(RuntimeError):
        run_demo(tmp_path / "out", parts=parts(crash))
    assert (tmp_path / "out" / "results.json").read_text() == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
