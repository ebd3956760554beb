"""Stages: kept when reached, read again by a later call, done again where they do not fit."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.example_diagnosis import rubbing_runs, sprung_runs
from workbench.diagnosis import diagnose as module
from workbench.diagnosis.conclude import conclude_early
from workbench.diagnosis.diagnose import diagnose, stages
from workbench.diagnosis.stage_files import fingerprint
from workbench.diagnosis.stages import Diagnosis
from workbench.errors import WorkbenchError
from workbench.files import digest_of_code

MOST_FILTERED = 114_500
"""Samples that a diagnosis of `_given` may filter: the 104,100 that it takes, and a tenth more."""

NAMES = ["fitted", "location", "prepared", "scored", "selected", "validated"]


_given = partial(rubbing_runs, 300, "linear_spring")


def _diagnosed(folder: Path) -> Diagnosis:
    model, fit_on, hold_out, options = _given()
    return diagnose(model, fit_on, hold_out, folder=folder, **options)


def _said(found: Diagnosis) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(found.verdict.to_json())
    del data["seconds"]
    # What was compiled before, in whatever test, is not compiled again.
    del data["work"]["compilations"]
    return data


def _never(*_: object, **__: object) -> Any:
    raise AssertionError("this stage was reached before")


def test_a_later_call_reads_what_an_earlier_one_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = _diagnosed(tmp_path)
    assert sorted(p.stem for p in (tmp_path / "stages").iterdir()) == NAMES
    for name in ("prepare", "fit", "locate", "score", "search", "validate"):
        monkeypatch.setattr(module, name, _never)
    again = _diagnosed(tmp_path)
    assert _said(again) == _said(first)
    # The time of stages that are read counts as it was.
    assert again.seconds > 0.5 * first.seconds
    # The work of this small case, which no load of the machine changes.
    assert again.work == first.work
    assert 10_000 < first.work["filtered_samples"] < MOST_FILTERED
    # What a page draws survives too.
    (name,) = first.runs["extended"]
    np.testing.assert_array_equal(
        again.runs["extended"][name].simulated, first.runs["extended"][name].simulated
    )
    np.testing.assert_array_equal(again.extended.model.values, first.extended.model.values)
    np.testing.assert_array_equal(
        again.extended.model.rates([0.1, 0.2], [5.0]), first.extended.model.rates([0.1, 0.2], [5.0])
    )


@pytest.mark.long
def test_a_killed_call_is_continued_from_its_last_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, fit_on, hold_out, options = _given()
    whole = diagnose(model, fit_on, hold_out, **options)
    for found in stages(model, fit_on, hold_out, folder=tmp_path, **options):
        if found.selected is not None:
            break
    with pytest.raises(WorkbenchError, match="as far as a verdict"):
        _said(found)
    early = conclude_early(found, "searching")
    assert early.interrupted and "Interrupted while searching" in early.sentence
    assert early.as_data()["interrupted"] is True
    # What was not proved is not sure.
    assert early.kind == "likely" and {f.belief for f in early.findings} == {"likely"}
    assert early.findings[0].doubts[-1].endswith("before it was proved")
    told = early.sentence.partition("found until then: coulomb friction; not tried: ")[2]
    assert told.endswith("the proof on the held-out recordings.")
    monkeypatch.setattr(module, "fit", _never)
    monkeypatch.setattr(module, "score", _never)
    assert _said(_diagnosed(tmp_path)) == _said(whole)


@pytest.mark.long
def test_other_options_are_used_from_their_stage_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, fit_on, hold_out, options = _given()
    _diagnosed(tmp_path)
    monkeypatch.setattr(module, "fit", _never)
    fewer = options | {"entries": [e for e in options["entries"] if e.law == "linear_spring"]}
    found = diagnose(model, fit_on, hold_out, folder=tmp_path, **fewer)
    assert [s.entry.law for s in found.rounds[0].scores.scores] == ["linear_spring"]
    # Other recordings make every stage another one.
    other = [replace(fit_on[0], name="another")]
    with pytest.raises(AssertionError, match="reached before"):
        diagnose(model, other, hold_out, folder=tmp_path, **options)


def test_what_other_code_reached_is_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    model, fit_on, *_ = _given()
    before = fingerprint(model, fit_on, (), split=1)
    assert fingerprint(model, fit_on, (), split=1) == before
    read = Path.read_bytes
    edited = {"filter.py": b"# edited"}
    monkeypatch.setattr(Path, "read_bytes", lambda path: edited.get(path.name) or read(path))
    digest_of_code.cache_clear()
    assert fingerprint(model, fit_on, (), split=1) != before
    digest_of_code.cache_clear()


@pytest.mark.long
def test_a_file_that_cannot_be_read_is_done_again(tmp_path: Path) -> None:
    first = _diagnosed(tmp_path)
    (tmp_path / "stages" / "fitted.json").write_text('{"format": "workbench.stage/2"')
    # Nor is a class that is none of the workbench's looked up, or one that is gone.
    for stage, begin in (("located", "elsewhere"), ("scored", "workbench.gone")):
        file = tmp_path / "stages" / f"{stage}.json"
        file.write_text(file.read_text().replace('"#": "workbench.', f'"#": "{begin}.'))
    assert _said(_diagnosed(tmp_path)) == _said(first)


@pytest.mark.long
def test_a_term_without_a_name_is_built_again(tmp_path: Path) -> None:
    model, fit_on, hold_out, options = sprung_runs()
    first = diagnose(model, fit_on, hold_out, folder=tmp_path, **options)
    again = diagnose(model, fit_on, hold_out, folder=tmp_path, **options)
    assert first.nonparametric is not None and first.nonparametric.accepted
    assert _said(again) == _said(first)
    x = [0.1, 0.2]
    np.testing.assert_array_equal(
        again.extended.model.rates(x, [5.0]), first.extended.model.rates(x, [5.0])
    )
