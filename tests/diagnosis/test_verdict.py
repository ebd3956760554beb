"""Verdicts: what is written reads back, and nothing that is not a number gets in."""

from __future__ import annotations

import json
import math

from workbench.diagnosis.verdict import SCHEMA, Finding, Value, Verdict
from workbench.plants.servo_axis import servo_axis


def _verdict() -> Verdict:
    return Verdict(
        "named",
        "Missing: friction.",
        servo_axis(),
        findings=(
            Finding(
                ("axis.force",),
                "stribeck_friction",
                ("stribeck_friction", "local_friction"),
                "Missing: friction.",
                {"break_away": Value(25.0, "N", 0.5)},
                0.97,
                120.0,
                1e-9,
            ),
        ),
        fit={"refitted": {"position": 0.01}, "extended": {"position": math.inf}},
        units={"position": "m"},
        next_experiment={"sentence": "Move slowly.", "separation_sigma": math.nan},
        seconds=12.5,
    )


def test_verdict_reads_back_from_json() -> None:
    data = json.loads(_verdict().to_json())
    assert data["schema"] == SCHEMA == "workbench.verdict/2"
    assert data["verdict"] == "named" and data["seconds"] == 12.5
    (finding,) = data["findings"]
    assert finding["where"] == ["axis.force"]
    assert finding["effect"] == "stribeck_friction"
    assert finding["class"] == ["stribeck_friction", "local_friction"]
    assert finding["parameters"] == {"break_away": {"value": 25.0, "unit": "N", "std": 0.5}}
    assert finding["excess_explained"] == 0.97 and finding["p_value"] == 1e-9
    assert data["fit"]["units"] == {"position": "m"}


def test_numbers_that_are_not_finite_become_null() -> None:
    text = _verdict().to_json()
    assert "NaN" not in text and "Infinity" not in text
    data = json.loads(text)
    assert data["fit"]["held_out"]["extended"]["position"] is None
    assert data["next_experiment"]["separation_sigma"] is None


def test_a_printed_verdict_holds_its_numbers() -> None:
    text = str(_verdict())
    assert text.startswith("named: Missing: friction.")
    assert "break_away" in text and "25" in text and "Move slowly." in text
