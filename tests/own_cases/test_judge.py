"""The plan covers every effect, and a verdict is judged by what was hidden."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.own_cases.judge import judge, table
from tests.own_cases.plan import ANSWERS, PAIRS, plan
from tests.rig.effects import EFFECTS
from workbench.physics.library import library
from workbench.plants.arm import arm


def found(effect: str, where: str, *alike: str) -> dict[str, object]:
    return {"effect": effect, "where": [where], "class": [effect, *alike]}


def verdict(*findings: dict[str, object]) -> dict[str, object]:
    return {"verdict": "named" if findings else "nothing_missing", "findings": list(findings)}


def test_every_answer_is_an_effect_of_the_rig_and_of_the_library() -> None:
    assert set(ANSWERS) <= set(EFFECTS)
    names = {entry.name for entry in library(arm(3))} | {"lugre_friction"}
    for answers, _ in ANSWERS.values():
        assert set(answers) <= names


def test_the_plan_has_a_hundred_cases_and_hides_nothing_in_one_of_four() -> None:
    cases = plan()
    assert len(cases) > 100
    assert len({case.seed for case in cases}) == len(cases)
    counts = Counter(case.effects for case in cases)
    assert counts[()] >= len(cases) // 5
    assert all(counts[(name,)] == 3 for name in ANSWERS)
    assert all(counts[pair] == 3 for pair in PAIRS)


@pytest.mark.parametrize(
    ("effects", "findings", "named", "located", "wrong"),
    [
        (("tilt",), [found("tilt_gravity", "joint.torque")], 1, 1, 0),
        (("tilt",), [found("ripple", "joint.torque", "tilt_gravity")], 1, 1, 0),
        (("tilt",), [found("ripple", "joint.torque")], 0, 1, 1),
        (("tilt",), [found("valve_offset", "valve.command")], 0, 0, 1),
        (("tilt",), [], 0, 0, 0),
        ((), [found("tilt_gravity", "joint.torque")], 0, 0, 1),
        (
            ("tilt", "valve_offset"),
            [found("valve_offset", "valve.command"), found("tilt_gravity", "joint.torque")],
            2,
            2,
            0,
        ),
    ],
)
def test_names_and_places_are_counted(
    effects: tuple[str, ...],
    findings: list[dict[str, object]],
    named: int,
    located: int,
    wrong: int,
) -> None:
    row = judge(effects, verdict(*findings))
    assert (row["named"], row["located"], row["wrong"]) == (named, located, wrong)
    assert row["silent"] == (not findings)


def test_the_table_counts_false_alarms_apart() -> None:
    rows = [judge((), verdict(found("ripple", "joint.torque"))), judge((), verdict())]
    assert "a name all the same          1" in table(rows)
