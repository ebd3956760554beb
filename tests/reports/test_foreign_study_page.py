"""The page of a study on a plant of the user's own: its words, and the user's own figures."""

from __future__ import annotations

import re
from pathlib import Path
from unittest.mock import Mock

import pytest

from workbench.model import Output
from workbench.reports.figures import tracking
from workbench.reports.page import Page, Words, html
from workbench.reports.pictures import Picture
from workbench.reports.study_page import study_page
from workbench.reports.tables import Cell, Table
from workbench.study.read import load_study
from workbench.study.result import run_study

MODULE = '''
from controllers.plain.transfer_law import pid_by_hand
from workbench.plants.servo_axis import servo_axis
from workbench.reports.style import new_figure

def rig():
    return servo_axis()

def design(linear, specification):
    ends = {"measured": "position", "actuator": "force", "lower": -350.0, "upper": 350.0}
    return pid_by_hand(4000.0, 0.0, 700.0, **ends)

def errors(result):
    """How large the largest error is."""
    figure, (axes,) = new_figure([1.5])
    axes.bar([0], [result.scores[0].worst])
    return figure
'''
STUDY = """
schema = 1
name = "axis"

[plant]
kind = "axis_rig:rig"

[controllers."proportional"]
design = "axis_rig:design"
at = { position = 0.0 }

[scenarios.step]
duration = "2 s"

[scenarios.step.references.position]
kind = "steps"
unit = "mm"
times = [0.0, 0.2]
values = [0, 20]

[[requirements]]
metric = "steady_error"
limit = 3.0
unit = "mm"

[report]
figures = ["axis_rig:errors", "axis_rig:nowhere"]
"""
ARM = re.compile(r"\b(arms?|muscles?|valves?|swings?|stops?|air|angles?|pressures?|loads?)\b")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    place: Path = tmp_path_factory.mktemp("axis")
    (place / "axis_rig.py").write_text(MODULE)
    (place / "axis.toml").write_text(STUDY)
    return study_page(run_study(load_study(place / "axis.toml"), place / "out", jobs=1))


@pytest.mark.usefixtures("undrawn")
def test_it_speaks_the_words_of_its_plant(page: Page) -> None:
    text = re.sub(r"<(style|head).*?</\1>", "", html(page), flags=re.DOTALL)
    assert "position" in text and "mm" in text
    said = {m.group() for m in ARM.finditer(re.sub(r"<[^>]*>", " ", text))}
    assert said == set(), sorted(said)


def test_figures_of_the_users_own_stand_on_it(page: Page) -> None:
    own = {s.name: s.blocks[0] for s in page.sections if s.name.startswith("own")}
    picture, note = own["own-errors"], own["own-2"]
    assert isinstance(picture, Picture) and picture.caption == "How large the largest error is."
    assert isinstance(note, Words) and "nowhere" in note.text


def test_where_no_requirement_is_hard_the_others_decide_the_score(tmp_path: Path) -> None:
    (tmp_path / "axis_rig.py").write_text(MODULE)
    text = STUDY.replace('unit = "mm"\n\n[report]', 'unit = "mm"\nhard = false\n\n[report]')
    assert text != STUDY
    text += '[variations.heavier]\nparameters = { mass = "110 kg" }\n'
    (tmp_path / "axis.toml").write_text(text)
    page = study_page(run_study(load_study(tmp_path / "axis.toml"), tmp_path / "out", jobs=1))
    tables = [b for s in page.sections for b in s.blocks if isinstance(b, Table)]
    (scores,) = (t for t in tables if "score on every plant" in t.title)
    assert [isinstance(row[1], Cell) and row[1].mark for row in scores.rows] == ["missed", "missed"]


def test_errors_of_temperatures_are_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "steady_limit", lambda *_: 0.5)
    warm = Output("warm", "K", display_unit="degC")
    monkeypatch.setattr(tracking, "output_of", lambda *_: warm)
    picture = tracking._picture(Mock(), "step", "warm", Mock(), "step", "nominal plant", "")
    assert "error (dotted: ± 0.5 K)" in picture.caption
