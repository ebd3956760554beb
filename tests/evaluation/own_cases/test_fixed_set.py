"""Whole diagnoses of a few cases of the plan: the right name, or silence where it belongs."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.diagnosis.diagnose import diagnose
from workbench.diagnosis.verdict import Verdict
from workbench.evaluation.own_cases.own_case import made
from workbench.evaluation.own_cases.plan import Planned, names, plan
from workbench.recordings import read_case

pytestmark = pytest.mark.long

PLANNED = plan()


def first(title: str, spread: float) -> Planned:
    """Return the first case of the plan that hides this, its background as far from nominal."""
    return next(case for case in PLANNED if (case.title, case.spread) == (title, spread))


def diagnosed(case: Planned, folder: Path) -> Verdict:
    found = read_case(made(case, folder))
    fit_on, hold_out = list(found.fit.values()), list(found.hold_out.values())
    return diagnose(found.model(), fit_on, hold_out, jobs=1).verdict


@pytest.mark.parametrize(
    ("title", "spread"),
    [
        # The background at its nominal values, and twice as far from them as usual.
        ("nothing", 0.0),
        ("nothing", 2.0),
        ("nothing (narrow)", 2.0),
        # A load that the inertia of the arm can stand for, within its bounds.
        ("wrong_load", 1.0),
    ],
)
def test_silence(title: str, spread: float, tmp_path: Path) -> None:
    verdict = diagnosed(first(title, spread), tmp_path)
    assert verdict.findings == ()
    assert verdict.kind in ("nothing_missing", "parameter")


def test_the_right_name(tmp_path: Path) -> None:
    case = first("valve_deadband x1", 1.0)
    verdict = diagnosed(case, tmp_path)
    (finding,) = verdict.findings
    (hidden,) = case.effects
    assert finding.effect in names().effects[hidden].library
    assert len(finding.alike) <= 3
    assert verdict.fit["extended"]["angle"] < 0.5 * verdict.fit["refitted"]["angle"]


@pytest.mark.parametrize(
    ("first_seed", "number", "effect"),
    [
        # 25th by its score: other laws bend the same way while it is small.
        (83000, 78, "sensor_gain_angle"),
        # In a narrow band, seen late in the recording, where others were tried on more of it.
        (83000, 87, "linear_spring"),
        # Beside a stop that touches 52 rad away, and was tried on more samples.
        (84000, 3, "constant_torque"),
    ],
)
def test_the_right_name_although_others_seem_to_gain_more(
    first_seed: int, number: int, effect: str, tmp_path: Path
) -> None:
    (finding,) = diagnosed(plan(first_seed)[number], tmp_path).findings
    assert finding.effect == effect
    assert len(finding.alike) <= 3
