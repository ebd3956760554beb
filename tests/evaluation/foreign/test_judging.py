"""Kept foreign cases are judged by name, by place, and by what was refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from workbench.cli.main import run as command
from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.verdict import SCHEMA
from workbench.evaluation.foreign import foreign_case as foreign
from workbench.evaluation.foreign.foreign_case import plan

TRUTH = {
    "word": "rail_friction",
    "library": ["coulomb_friction_cart"],
    "groups": ["cart"],
    "sensor": False,
}


def row(
    number: int, hidden: list[dict[str, Any]], *names: str, error: float = 1.0, **refused: float
) -> dict[str, Any]:
    """A kept case; `refused` are the lower ends of held-out gains."""
    findings = [
        {"effect": name, "where": ["cart.force"], "class": [name], "parameters": {}}
        for name in names
    ]
    fit = {"extended": {"position": error}, "refitted": {"position": 9.0}}
    return {
        "schema": foreign.SCHEMA,
        "case": f"foreign-{number}",
        "title": "crane: " + ("+".join(t["word"] for t in hidden) or "nothing"),
        "machine": "crane",
        "hidden": hidden,
        "limit": {"position": 1.0},
        "version": "none",
        "seconds": 1.0,
        "verdict": {
            "schema": SCHEMA,
            "verdict": "named" if names else "nothing_missing",
            "findings": findings,
            "fit": {"held_out": fit},
            "refused": [
                {"effect": n, "reason": "too small", "held_out_gain": [2 * low, low, 3 * low]}
                for n, low in refused.items()
            ],
        },
    }


ROWS = [
    row(1, [TRUTH], "coulomb_friction_cart", error=1.2),
    row(2, [TRUTH], error=9.0, coulomb_friction_cart=50.0, linear_spring_cart=80.0),
    row(3, [TRUTH], "linear_spring_cart", error=1.6),
    row(4, []),
    row(5, [], "linear_spring_cart"),
    row(6, [TRUTH | {"word": "odd", "library": []}], error=1.4),
]


def test_rates() -> None:
    rates = foreign.rates_of(ROWS)
    counts = {name: (rate.count, rate.total) for name, rate in rates.items()}
    assert counts == {
        "false names": (1, 2),
        "right name or class": (1, 4),
        "right name or class, what the library has": (1, 3),
        "right place": (2, 4),
        "wrong name": (1, 4),
        "held-out error within 1.5 of the truth": (4, 6),
        "gains but is refused": (1, 4),
        "diagnosis failed": (0, 6),
    }
    assert set(counts) == set(foreign.BARS)
    # What was refused counts only if it is right.
    assert foreign.refused_right(ROWS[1]) == ["coulomb_friction_cart (too small)"]


def test_report_of_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for content in ROWS:
        (tmp_path / f"{content['case']}.json").write_text(json.dumps(content))
    summary = tmp_path / "out" / "summary.json"
    words = ["evaluate", "report", str(tmp_path), "--cases", "--summary", str(summary)]
    assert command(words) == 0
    said = capsys.readouterr().out
    assert foreign.tables(ROWS) in said and foreign.line_of(ROWS[1]) in said
    kept = json.loads(summary.read_text())
    assert kept["cases"] == 6 and kept["each"][2]["remark"] == "wrong name"
    assert command(["evaluate", "report", str(tmp_path), "--figure", "f.png"]) == 2
    assert command(["evaluate", "report", str(tmp_path / "none")]) == 2


def test_parts_are_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["evaluate", "foreign", str(tmp_path), "--part", "3/2"]) == 2
    assert "must be K/N" in capsys.readouterr().err


@pytest.mark.long
def test_what_was_found_first_is_chosen_again_beside_what_was_found_since() -> None:
    # A wrong zero of the angle looks like a torque at the pivot until the rail's friction is known.
    case = next(c for c in plan(60, 9000) if c.title == "crane: rail_friction+angle_offset")
    made = case.recordings()
    fit = [r for name, r in made.items() if name.startswith("fit")]
    held_out = [r for name, r in made.items() if name.startswith("hold")]
    verdict = diagnose(case.build(), fit, held_out, advise=False).verdict
    names = [f.effect for f in verdict.findings]
    assert names[0] == "sensor_offset_angle" and len(names) == 2
    assert verdict.findings[1].where == ("cart.force",)
    size = verdict.findings[0].parameters["amount"].value
    assert size == pytest.approx(case.parameters()["angle_offset"], rel=0.02)
