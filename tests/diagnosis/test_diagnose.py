"""A whole diagnosis of an axis whose recordings come from an integrator of their own."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.axis_case import (
    BREAK_AWAY_N,
    COULOMB_N,
    SAMPLE_TIME,
    STRIBECK_SPEED,
    diagnosed,
    excitation,
    held_out,
    positions,
)
from workbench.diagnosis import diagnose as module
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.stages import Prepared


def test_the_truth_is_converged_and_starts_moving_as_it_must() -> None:
    force = excitation(300, 1)
    coarse, fine = (positions(force, hidden=True, substeps=n)[0] for n in (10, 20))
    # A tenth of the encoder's step.
    assert np.max(np.abs(coarse - fine)) < 1e-7
    # At first nothing but friction at rest opposes the force.
    assert positions(np.full(3, 200.0), hidden=False)[0][1] == pytest.approx(
        0.5 * (200.0 - COULOMB_N) / 100.0 * SAMPLE_TIME**2, rel=0.1
    )


def test_hidden_stribeck_friction_is_found_and_named() -> None:
    verdict = diagnosed(True).verdict
    assert verdict.kind in ("named", "named_class")
    finding = verdict.findings[0]
    assert finding.effect == "stribeck_friction" and finding.where == ("axis.force",)
    size = finding.parameters["break_away"]
    # The law of the library is rounded at rest in another way than the truth.
    assert size.value == pytest.approx(BREAK_AWAY_N - COULOMB_N, rel=0.2)
    assert finding.parameters["stribeck_speed"].value == pytest.approx(STRIBECK_SPEED, rel=0.25)
    assert finding.p_value < 1e-3 and finding.gain > 100


def test_the_extended_model_is_better_on_recordings_it_has_not_seen() -> None:
    found = diagnosed(True)
    errors = {label: row["position"] for label, row in found.verdict.fit.items()}
    assert errors["extended"] < 0.7 * errors["refitted"]
    # The same from the measurements themselves.
    (held,) = held_out(True)
    run = found.runs["extended"][held.name]
    again = float(np.sqrt(np.mean((held["position"] - run.simulated[:, 0]) ** 2)))
    assert errors["extended"] == pytest.approx(again, rel=1e-6)


def test_silence_where_only_a_parameter_was_wrong() -> None:
    verdict = diagnosed(False).verdict
    assert verdict.kind == "nothing_missing" and verdict.findings == ()
    # The mass of the model is 95 kg, the true one 100 kg.
    assert verdict.parameters["mass"]["value"] == pytest.approx(100.0, abs=0.5)
    assert any(row["effect"] == "constant_force" for row in verdict.not_testable)


def test_the_verdict_carries_the_improved_model() -> None:
    verdict = diagnosed(True).verdict
    assert "stribeck_friction" in {effect.name for effect in verdict.model.effects}
    data = json.loads(verdict.to_json())
    assert data["findings"][0]["effect"] == "stribeck_friction"


@pytest.mark.parametrize(
    ("doubts", "explained", "left", "hollow"),
    [
        (("it explains little",), 0.1, 0.9, True),
        # What takes most of the error of free runs is there.
        (("it explains little",), 0.8, 0.9, False),
        (("it explains little",), 0.1, 0.5, False),
        ((), 0.1, 0.9, False),
    ],
)
def test_doubted_findings_beside_which_all_is_still_missing_are_no_names(
    monkeypatch: pytest.MonkeyPatch,
    doubts: tuple[str, ...],
    explained: float,
    left: float,
    hollow: bool,
) -> None:
    found: Any = SimpleNamespace(before=Location({"axis": 100.0}), prepared=Prepared((), (), ()))
    chosen: Any = SimpleNamespace(
        accepted=(SimpleNamespace(candidate=SimpleNamespace(doubts=doubts)),),
        extended=SimpleNamespace(model=None),
    )
    task: Any = SimpleNamespace(fitting=(), started=lambda *_: ())
    monkeypatch.setattr(module, "run_freely", lambda *_: (chosen, explained))
    rest = Location({"axis": 100.0 * left})
    monkeypatch.setattr(module, "where", lambda *_: rest)
    assert module._hollow(task, found, chosen) is hollow
