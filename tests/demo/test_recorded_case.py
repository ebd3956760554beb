"""Recorded cases beside simulations: every model is drawn and told, the nominal one is off."""

from __future__ import annotations

import pytest

from workbench.demo import recorded_case
from workbench.model import Model
from workbench.recordings import Case
from workbench.reports.page import Page


def test_every_model_runs_along_the_held_out_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    # That a refit reaches the noise floor is asserted where refits are; here it keeps the model.
    def kept(model: Model, case: Case) -> Model:
        return model

    monkeypatch.setattr(recorded_case, "_refitted", kept)
    part = recorded_case.recorded_case_part(["practice-07"])
    found = part.results["practice-07"]
    assert set(found) == {"nominal", "refitted", "refitted with muscle hysteresis"}
    assert found["nominal"]["angle_rms_deg"] > 0.3
    assert found["refitted"] == found["nominal"]
    assert found["nominal"]["pressure_1_rms_bar"] > 0.01
    assert [p.name for p in Page("", "", (part.section,)).pictures] == [
        "recorded-practice-07-nominal",
        "recorded-practice-07-refitted",
    ]
