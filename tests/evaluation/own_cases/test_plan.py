"""The plan: what it covers, how it begins, and that a case is the same each time."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest

from workbench.evaluation.answer_key import NOTHING
from workbench.evaluation.own_cases.own_case import made
from workbench.evaluation.own_cases.plan import (
    COUNTERPARTS,
    FACTORS,
    OUTSIDE,
    PAIRS,
    SINGLE,
    SIZES,
    TRIPLES,
    names,
    plan,
    sizes,
)
from workbench.evaluation.rig.parameters import EFFECTS, PARAMETERS, nominal
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.arm import arm

WHOLE = plan()


def test_every_effect_of_the_rig_is_planned_and_has_a_meaning() -> None:
    known = {
        e.name
        for entry in library(arm(3), RecordedFacts(period=0.3))
        for e in (entry, *entry.alone)
    }
    for name in EFFECTS:
        assert set(names().effects[name].library) <= known
    assert NOTHING not in SINGLE


def test_true_sizes_have_a_parameter_in_the_library() -> None:
    known = {entry.name: entry for entry in library(arm(3))}
    p = nominal() | {"load_error": 0.8}
    for (effect, name), counterpart in COUNTERPARTS.items():
        assert name in names().effects[effect].library
        assert counterpart.parameter in {q.name for q in known[name].effect.parameters}
        assert counterpart.size == (known[name].size_parameter == counterpart.parameter)
        true = counterpart.true(p | EFFECTS[effect].parameters)
        assert true != 0.0
        assert abs(true) < max(
            abs(q.upper) for q in known[name].effect.parameters if q.name == counterpart.parameter
        )


def test_the_whole_plan() -> None:
    assert len({case.seed for case in WHOLE}) == len(WHOLE) >= 200
    counts = Counter((case.effects, case.factor) for case in WHOLE if case.kind == "single")
    for name in SINGLE:
        sized = name in SIZES or name == "wrong_load"
        assert {f for (e, f) in counts if e == (name,)} == ({1.0, 0.4, 2.0} if sized else {1.0})
    assert {c.effects for c in WHOLE if c.kind == "pair"} == set(PAIRS)
    assert {c.effects for c in WHOLE if c.kind == "triple"} == set(TRIPLES)
    outside = [c.effects[0] for c in WHOLE if c.kind == "outside"]
    assert sorted(outside) == sorted(OUTSIDE)
    nothing = [case for case in WHOLE if case.kind == "nothing"]
    assert Counter(case.spread for case in nothing) == {0.0: 18, 2.0: 18}
    assert {case.recorded for case in WHOLE} == {"all", "closed", "narrow"}
    assert {case.load for case in WHOLE} == {1.0, 3.0, 5.0}


def test_any_beginning_is_a_fair_sample() -> None:
    for count in (20, 40, 60, 80):
        begun = plan()[:count]
        nothing = sum(case.kind == "nothing" for case in begun)
        assert 0.1 * count <= nothing <= 0.3 * count
        hidden = (names().effects[effect] for case in begun for effect in case.effects)
        groups = {truth.groups[0] for truth in hidden}
        assert {"motion", "valve", "supply", "angle sensor"} <= groups


def test_sizes_grow_with_their_factor() -> None:
    absent = nominal()
    for name, size in SIZES.items():
        small, usual, large = (sizes(name, f) for f in sorted(FACTORS))
        full = EFFECTS[name].parameters
        assert usual == {k: pytest.approx(full[k]) for k in usual}
        for key in usual:
            assert key in PARAMETERS
            if size.inverse:
                assert small[key] > usual[key] > large[key] > 0.0
            else:
                away = [abs(s[key] - absent[key]) for s in (small, usual, large)]
                assert away[0] < away[1] < away[2]


def test_a_case_is_the_same_each_time(tmp_path: Path) -> None:
    case = next(c for c in plan() if c.recorded == "narrow" and c.effects)
    one, two = (made(case, tmp_path / name, seconds=2.0) for name in ("one", "two"))
    files = ["identify_closed.csv", "validate_closed.csv"]
    assert sorted(p.name for p in one.glob("*.csv")) == files
    for path in one.glob("*.csv"):
        assert path.read_bytes() == (two / path.name).read_bytes()
    truth = json.loads((one / "truth.json").read_text())
    assert [t["effect"] for t in truth["effects"]] == list(case.effects)
    for key, value in case.changes.items():
        assert truth["parameters"][key] == value
