"""Whole diagnoses of a few cases of the plan: the right name, or silence where it belongs."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.verdict import Verdict
from workbench.evaluation.own_cases.own_case import made
from workbench.evaluation.own_cases.plan import names, plan
from workbench.recordings import read_case

pytestmark = pytest.mark.long

PLANNED = {case.name: case for case in plan()}

SILENT = {
    # The background at its nominal values, and twice as far from them as usual.
    "own-2051": "nothing",
    "own-2059": "nothing",
    "own-2130": "nothing (narrow)",
    # A load that the inertia of the arm can stand for, within its bounds.
    "own-2064": "wrong_load",
}
NAMED = {"own-2035": "valve_deadband x1"}


def diagnosed(name: str, folder: Path) -> Verdict:
    found = read_case(made(PLANNED[name], folder))
    fit_on, hold_out = list(found.fit.values()), list(found.hold_out.values())
    return diagnose(found.model(), fit_on, hold_out, jobs=1).verdict


@pytest.mark.parametrize("name", SILENT)
def test_silence(name: str, tmp_path: Path) -> None:
    assert PLANNED[name].title == SILENT[name]
    verdict = diagnosed(name, tmp_path)
    assert verdict.findings == ()
    assert verdict.kind in ("nothing_missing", "parameter")


@pytest.mark.parametrize("name", NAMED)
def test_the_right_name(name: str, tmp_path: Path) -> None:
    assert PLANNED[name].title == NAMED[name]
    verdict = diagnosed(name, tmp_path)
    (finding,) = verdict.findings
    (hidden,) = PLANNED[name].effects
    assert finding.effect in names().effects[hidden].library
    assert len(finding.alike) <= 3
    assert verdict.fit["extended"]["angle"] < 0.5 * verdict.fit["refitted"]["angle"]
