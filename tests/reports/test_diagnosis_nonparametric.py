"""Pages of diagnoses without a name: a curve, mere noise, a wrong value, unfit recordings."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest

from tests.diagnosis.example_diagnosis import example_diagnosis, shaken, sprung
from tests.reports.test_diagnosis_page import _answers, _table
from workbench.diagnosis.comparison import Proof, proof_of
from workbench.diagnosis.conclude import conclude
from workbench.diagnosis.selection.selected import Withdrawn
from workbench.diagnosis.stages import Diagnosis, Fitted, Prepared
from workbench.diagnosis.verdict import Verdict
from workbench.evaluation.blind_round import score_verdicts
from workbench.plants.servo_axis import servo_axis
from workbench.reports.diagnosis_page import diagnosis_page, taken_back
from workbench.reports.page import Page, Words


@lru_cache(maxsize=2)
def _page(curve: bool) -> Page:
    found = sprung() if curve else shaken()
    step = {"sentence": "Read the position twice."}
    found = replace(found, concluded=replace(found.verdict, next_experiment=step))
    return diagnosis_page(found, proof_of(found), name="axis")


def _words(page: Page) -> str:
    return " ".join(b.text for s in page.sections for b in s.blocks if isinstance(b, Words))


def test_a_curve_without_a_name_leads_the_page() -> None:
    found = sprung()
    assert found.verdict.kind == "located_unnamed"
    said = _answers(_page(True))
    share = 100 * found.verdict.findings[0].excess_explained
    assert "Missing at axis.force" in said["what"] and "a curve over position" in said["what"]
    assert f"removes {share:.3g} % of the excess error" in said["how sure"]
    assert "empirical: valid inside its data hull, position from 0 to" in said["how sure"]
    assert said["record next"] == "Read the position twice."


def test_the_curve_is_shown_with_its_argument_and_the_improved_run() -> None:
    found = sprung()
    page = _page(True)
    names = ["answer", "runs-1", "residuals-1", "location", "nonparametric-1", "law-1", "signal-1"]
    assert [picture.name for picture in page.pictures] == names
    # Measured, refitted and extended.
    assert len(page.pictures[0].figure.axes[0].lines) == 3
    assert "extended" in _table(page, "Errors of").headings
    (row,) = _table(page, "Arguments").rows
    assert row[0] == "position in mm" and str(row[-1]).startswith("x (")
    ordinates = [r[0].text for r in _table(page, "Values with").cells if "curve at" in r[0].text]
    assert len(ordinates) == 6
    assert ordinates[0] == "nonparametric term, curve at position 0 mm, in N (new)"
    (located,) = proof_of(found).located
    assert located.argument.name == "position" and located.law is not None
    # The made-up spring pulls with 200 N/m; the curve is constant beyond its hull.
    low, high = found.nonparametric.arguments[0].hull
    share = float(((located.argument.values < low) | (located.argument.values > high)).mean())
    assert share > 0.5
    caption = next(p.caption for p in page.pictures if p.name == "law-1")
    assert f"{100 * share:.0f} % of these samples lie outside the data hull" in caption


def test_noise_is_shown_where_it_acts_with_what_was_refused() -> None:
    found = shaken()
    assert found.verdict.kind == "unexplained"
    page = _page(False)
    assert [p.name for p in page.pictures][3:] == ["location", "law-1", "signal-1"]
    assert "extended" not in _table(page, "Errors of").headings
    band = next(p for p in page.pictures if p.name == "signal-1").figure.axes[0].collections
    assert len(band) == 1
    said = _words(page)
    assert "A law without a name at axis.force was tried and refused: the signal depends" in said
    assert "a signal at axis.force looks like one at position.reading" in said
    assert _answers(page)["record next"] == "Read the position twice."


def test_what_was_taken_back_stands_with_the_reason() -> None:
    given = example_diagnosis()
    why = "what was found takes away too little on held-out recordings"
    back = (Withdrawn(given.accepted[0].candidate, why),)
    selected = replace(given.selected, accepted=(), extended=given.base, withdrawn=back)
    runs = {**given.runs, "extended": given.runs["refitted"]}
    validated = replace(given.validated, extended=given.base, runs=runs, location=None)
    found = replace(given, selected=selected, validated=validated)
    found = replace(found, concluded=conclude(found))
    assert found.verdict.kind == "unexplained"
    assert "too little" in taken_back(found)["coulomb_friction"]
    page = diagnosis_page(found, Proof((), ()), name="axis")
    assert "Taken back: Coulomb friction" in _words(page)
    row = next(r for r in _table(page, "What the library").cells if r[0].text.startswith("Coulomb"))
    assert row[-1].text == "taken back" and "held-out" in row[-1].reason


def test_a_value_on_its_bound_stands_first() -> None:
    given = sprung()
    estimates = given.base.refit.estimates
    bound = tuple(replace(e, on_bound=e.name == "offset") for e in estimates)
    base = replace(given.base, refit=replace(given.base.refit, estimates=bound), noise_scale=0.0)
    found = replace(
        given,
        fitted=Fitted(base, given.prepared),
        selected=replace(given.selected, extended=base, nonparametric=None),
        validated=replace(given.validated, refitted=base, extended=base, wrong=("offset",)),
    )
    found = replace(found, concluded=conclude(found))
    assert found.verdict.kind == "parameter"
    page = diagnosis_page(found, Proof((), ()), name="axis")
    assert page.sections[0].name == "parameters"
    first, *others = _table(page, "Values with").cells
    assert first[0].text.startswith("offset") and first[2].mark == "missed"
    assert not any(cell.mark for row in others for cell in row)


def test_unfit_recordings_come_with_the_usual_fix() -> None:
    axis = servo_axis()
    rows = (
        {"recording": "one", "check": "gaps", "result": "corrected", "note": "one gap bridged"},
        {"recording": "two", "check": "clipping", "result": "unfit", "note": "half is clipped"},
    )
    verdict = Verdict("data_unfit", "Recording two cannot be judged: half", axis, data=rows)
    found = Diagnosis(axis, Prepared((), (), (), rows, verdict.sentence), concluded=verdict)
    page = diagnosis_page(found, Proof((), ()), name="x")
    assert [section.name for section in page.sections] == ["recordings"]
    assert page.lead.endswith("half.")
    assert "two fails the check of clipping: half is clipped. Usual fix: widen" in _words(page)
    assert _table(page, "Checks").cells[0][2].mark == "missed"


@pytest.mark.parametrize(("curve", "points"), [(True, 6), (False, 2)])
def test_verdicts_without_a_name_can_be_scored(curve: bool, points: int, tmp_path: Path) -> None:
    found = sprung() if curve else shaken()
    folder, key, names = tmp_path / "verdicts", tmp_path / "key.json", tmp_path / "names.toml"
    folder.mkdir()
    (folder / "one.json").write_text(found.verdict.to_json())
    key.write_text(json.dumps({"one": {"truth": [{"effect": "odd"}]}}))
    names.write_text('[effects.odd]\nlibrary = []\nports = ["axis.force"]\n')
    assert score_verdicts(folder, key, names=names).points == points
