"""The page of a diagnosis: one sentence, the proof, the numbers of the diagnosis itself."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.diagnosis.axis_case import diagnosed
from workbench.diagnosis.comparison import Proof, proof_of
from workbench.diagnosis.estimation.free_run import FreeRun
from workbench.reports.diagnosis_page import diagnosis_page
from workbench.reports.figure import FIGURES, Figure
from workbench.reports.figures.diagnosis import diagnosis_location, diagnosis_runs, moving_rms
from workbench.reports.page import Answers, Page, Section, Words, html
from workbench.reports.tables import Table


@lru_cache(maxsize=2)
def _page(hidden: bool) -> Page:
    found = diagnosed(hidden)
    return diagnosis_page(found, proof_of(found), name="axis")


def _table(page: Page, title: str) -> Table:
    tables = [b for s in page.sections for b in s.blocks if isinstance(b, Table)]
    return next(table for table in tables if table.title.startswith(title))


def _answers(page: Page) -> dict[str, str]:
    answers = page.first[0]
    assert isinstance(answers, Answers)
    return dict(answers.entries)


def test_the_first_screen_answers_what_a_reader_asks() -> None:
    said = _answers(_page(True))
    assert said["what"].startswith("Stribeck friction, break away ")
    assert re.match(r"axis.force, with speed \(\d+ % of its variance\), most at", said["where"])
    assert said["how sure"].startswith("named: gains")
    assert re.match(r"from [\d.]+ to [\d.]+.* s of axis-3.*up to [\d.]+ N rms", said["when"])
    assert "what else it could be" in said
    errors = diagnosed(True).verdict
    assert errors is not None
    before, after = (1e3 * errors.fit[label]["position"] for label in ("refitted", "extended"))
    told = re.search(r"position ([\d.]+) → ([\d.]+) mm", said["how much better"])
    assert told is not None
    assert float(told[1]) == pytest.approx(before, rel=0.01)
    assert float(told[2]) == pytest.approx(after, rel=0.01)


def test_of_several_ports_the_first_picture_shows_that_where_most_was_found() -> None:
    diagnosis = diagnosed(True)
    proof = proof_of(diagnosis)
    (one,) = proof.located
    # At a port that nothing measures what is missing is told elsewhere.
    elsewhere = [
        replace(one, port=f"wall_{k}.rate", explained=e) for k, e in enumerate((-9, np.nan))
    ]
    page = diagnosis_page(diagnosis, replace(proof, located=(*elsewhere, one)), name="axis")
    answer = next(p for p in page.pictures if p.name == "answer")
    assert answer.caption.endswith(f"the signal that is missing at {one.port}.")


def test_measured_and_both_models_share_their_axes() -> None:
    figure = next(p for p in _page(True).pictures if p.name == "runs-1").figure
    for axes in figure.axes:
        assert len(axes.lines) == 3
    run = diagnosed(True).runs["extended"]["axis-3"]
    drawn = np.asarray(figure.axes[0].lines[0].get_ydata(), dtype=float)
    assert drawn.max() == pytest.approx(1e3 * run.measured.max(), rel=0.02)


def test_the_page_has_every_part_of_the_proof() -> None:
    page = _page(True)
    names = ["answer", "runs-1", "residuals-1", "location", "law-1", "signal-1"]
    assert [p.name for p in page.pictures] == names
    for title in ("Errors of free runs", "Values with", "What else it could be"):
        assert _table(page, title).rows
    text = html(page)
    assert "<script" not in text and "http" not in text.replace("http://www.w3.org", "")
    for word in ("nominal", "refitted", "extended", "collinear", "break away", "accepted"):
        assert word in text


def test_a_figure_of_an_installed_package_stands_on_the_page(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = Figure("mine", lambda found: Words(found.nominal.name), takes="diagnosis", title="Mine")
    monkeypatch.setattr(FIGURES, "members", lambda: {"mine": own})
    found = diagnosed(True)
    page = diagnosis_page(found, proof_of(found), name="axis")
    assert Section("mine", "Mine", (Words("servo axis"),)) in page.sections


@pytest.mark.long
def test_the_located_group_stands_first_among_what_can_be_told_apart() -> None:
    table = _table(_page(True), "What these sensors")
    assert table.cells[0][0].text.startswith("axis.force")
    assert table.cells[0][0].reason == "located here"
    assert "axis.force" in table.note or "position" in table.note
    quiet = _table(_page(False), "What these sensors")
    assert not any(row[0].reason for row in quiet.cells)


def test_the_last_panel_shows_where_the_models_differ() -> None:
    time = 0.01 * np.arange(1200.0)
    angle = np.where(time < 6.0, 40.0 * np.sin(time), 1.0)[:, None]
    # Two degrees while it moves by tens, half a degree where it stands still.
    wrong = angle + np.where(time < 6.0, 2.0, 0.0)[:, None]
    wrong += np.where((time > 8.0) & (time < 9.5), 4.5, 0.0)[:, None]
    run = FreeRun("trial", ("angle",), ("N",), time, angle, wrong)
    drawn = np.asarray(diagnosis_runs({"refitted": run}).axes[-1].lines[0].get_xdata(), dtype=float)
    assert drawn.min() > 7.5 and drawn.max() < 10.0


def test_the_next_experiment_stands_with_its_separation() -> None:
    found = diagnosed(False)
    step = {"sentence": "A slow triangle would tell a from b.", "separation_sigma": 5.1}
    verdict = replace(found.verdict, next_experiment=step)
    page = diagnosis_page(replace(found, concluded=verdict), Proof((), ()), name="axis")
    said = _answers(page)["record next"]
    assert said.endswith("Predicted separation: 5.10 standard deviations.")


def test_parameters_stand_with_their_intervals() -> None:
    table = _table(_page(True), "Values with")
    assert table.headings == ("parameter", "before the data", "refitted", "extended", "distance")
    rows = {row[0].text: row for row in table.cells}
    found = diagnosed(True)
    size = found.extended.refit.estimate("stribeck_friction.break_away")
    text = rows["Stribeck friction, break away in N (new)"][3].text
    assert float(text.split("±")[0]) == pytest.approx(size.value, rel=0.01)
    assert float(text.split("±")[1]) == pytest.approx(size.std, rel=0.1)


def test_a_page_without_findings_claims_none() -> None:
    page = _page(False)
    said = _answers(page)
    assert said["what"].startswith("Nothing is missing")
    # What was not found has no place, no time, no alternatives.
    assert not {"where", "when", "what else it could be", "how much better"} & set(said)
    assert "law-1" not in {p.name for p in page.pictures}
    assert _table(page, "Errors of").headings == ("output", "nominal", "refitted", "sensor's noise")
    # What the data could not have shown is the price of every silence.
    assert "constant force" in {row[0].text for row in _table(page, "What these recordings").cells}


def test_bars_are_as_long_as_the_gains() -> None:
    axes = diagnosis_location({"joint": 900.0, "chamber": 20.0}, {"joint": 3.0}).axes[0]
    widths = sorted(patch.get_width() for patch in axes.patches)  # type: ignore[attr-defined]
    assert widths == [0.0, 3.0, 20.0, 900.0]


def test_moving_error_leaves_out_samples_without_measurement() -> None:
    # A converter's run and a reactor's alike: the windows are a share of the run.
    time = 1e-6 * np.arange(1200)
    error = np.full(1200, 3.0)
    error[10:15] = np.nan
    error[40:60] = np.nan
    middle, rms = moving_rms(time, error)
    assert len(middle) == 60 and rms[0] == pytest.approx(3.0)
    assert np.isnan(rms[2])
