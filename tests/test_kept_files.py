"""Files that users keep: whatever stands in one, it reads or is one sentence, never a traceback."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from workbench.errors import WorkbenchError
from workbench.evaluation.answer_key import commitments, read_key, read_names, words_of
from workbench.evaluation.claims import read_answer
from workbench.plants.registry import PLANTS
from workbench.plants.saved import plant_of_file
from workbench.study.baseline import changes, read_baseline
from workbench.study.bless import bless
from workbench.study.conditions import condition_changes
from workbench.study.shipped import shipped_study
from workbench.verification.metrics import tolerance_of

COUNT = 100
"""Damaged files of each kind; each is drawn anew from the seed below."""

VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1.5, 1e300, 10**400, float("nan"), float("inf"), "", "x", "\ud800", [], {},
    [[]], [1, "a"], {"a": 1}, {"a": {"b": [None]}}, "../x", "verdict.json",
)  # fmt: skip

RUN = {
    "controller": "pid",
    "variation": "nominal",
    "scenario": "step",
    "seed": 1,
    "status": "done",
    "reason": "",
    "seconds": 0.1,
    "metrics": {
        "rmse": {"value": 0.02, "unit": "rad", "reason": "", "display_unit": "deg"},
        "settling_time": {"value": None, "unit": "s", "reason": "it never settles"},
    },
    "steps": [
        {"output": "angle", "begin_s": 0.5, "from": 0.1, "to": 0.2, "settling_s": 0.3, "reason": ""}
    ],
    "events": [{"output": "angle", "time": 1.0, "what": "load", "peak": 0.1, "left": None}],
    "margins": {"Ms": 1.5},
}
VERDICT = {
    "schema": "workbench.verdict/1",
    "verdict": "named",
    "findings": [
        {"where": ["joint.torque"], "effect": "quadratic_drag", "class": ["quadratic_drag"]}
    ],
    "fit": {"held_out": {"extended": {"angle": 1e-5}, "refitted": {"angle": 1e-2},
                         "noise_floor": {"angle": 1e-5}}},
}  # fmt: skip
KEY = {"one": {"truth": [{"effect": "tilt"}], "salt": "3f"}}
PLANT = {
    "plant": {
        "name": "servo_axis",
        "options": {},
        "effects": ["joint_hysteresis"],
        "without": [],
        "parameters": {"mass": 99.0},
    }
}


def _conditions() -> dict[str, Any]:
    path = shipped_study("arm").with_name("arm.baseline.json")
    return dict(json.loads(path.read_text(encoding="utf-8"))["conditions"])


def _baseline(path: Path) -> None:
    found = read_baseline(path)
    names = {n for r in found.records.values() if r.metrics for n in r.metrics}
    rules = {name: tolerance_of(name) for name in names}
    changes(rules, found.records.values(), found)
    if found.conditions is not None:
        condition_changes(found.conditions, _conditions())
        condition_changes(_conditions(), found.conditions)


def _bless(path: Path) -> None:
    folder = path.parent / "results"
    folder.mkdir(exist_ok=True)
    path.replace(folder / "results.json")
    bless(folder, path.parent / "kept.json")
    (path.parent / "kept.json").unlink()


def _verdict(path: Path) -> None:
    read_answer(path, "one", read_names())


def _key(path: Path) -> None:
    names = read_names()
    for case, answer in read_key(path).items():
        commitments(answer)
        names.truths(case, words_of(answer))


def _plant(path: Path) -> None:
    plant_of_file(path, PLANTS.get).model({})


KINDS: dict[str, tuple[dict[str, Any], str, Callable[[Path], None]]] = {
    "baseline": (
        {"kind": "workbench baseline", "schema": 2, "study": "s", "conditions": _conditions(),
         "runs": [RUN]},
        "b.json",
        _baseline,
    ),
    "results": (
        {"kind": "workbench results", "schema": 1, "study": "s", "runs": [RUN],
         "conditions": _conditions(), "tolerances": {"rmse": {"relative": 0.1}},
         "requirements": [{"hard": True, "met": False}]},
        "results.json",
        _bless,
    ),
    "verdict": (VERDICT, "one.json", _verdict),
    "key": (KEY, "key.json", _key),
    "plant": (PLANT, "verdict.json", _plant),
}  # fmt: skip


def _places(table: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    if not isinstance(table, (dict, list)) or not table:
        return [place]
    items = table.items() if isinstance(table, dict) else enumerate(table)
    return [place, *(p for key, value in items for p in _places(value, (*place, key)))]


def damaged(table: dict[str, Any], rng: random.Random) -> str:
    """Return the text of the file with one entry replaced, removed or renamed, or cut."""
    changed: Any = copy.deepcopy(table)
    place = rng.choice(_places(table)[1:])
    inner: Any = changed
    for key in place[:-1]:
        inner = inner[key]
    way = rng.random()
    if way < 0.8:
        inner[place[-1]] = copy.deepcopy(rng.choice(VALUES))
    elif way < 0.9 or isinstance(inner, list):
        del inner[place[-1]]
    else:
        inner[rng.choice(("x", "", "\n", "../x", "a" * 300))] = inner.pop(place[-1])
    text = json.dumps(changed)
    return text[: rng.randrange(len(text))] if rng.random() < 0.05 else text


@pytest.mark.parametrize("kind", KINDS)
def test_it_reads_or_is_one_sentence(kind: str, tmp_path: Path) -> None:
    table, name, read = KINDS[kind]
    (tmp_path / name).write_text(json.dumps(table))
    read(tmp_path / name)
    rng, refused = random.Random(f"{kind} 1"), 0
    for _ in range(COUNT):
        (tmp_path / name).write_text(damaged(table, rng))
        try:
            read(tmp_path / name)
        except WorkbenchError as error:
            refused += 1
            assert 20 < len(str(error)) < 2000
    assert refused > COUNT // 4


@pytest.mark.parametrize("text", ["", "[" * 5000, "\x00", "null", "[]", "3", '{"a": NaN}', "<<<<"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_such_file_is_a_sentence(kind: str, text: str, tmp_path: Path) -> None:
    _, name, read = KINDS[kind]
    (tmp_path / name).write_text(text)
    with pytest.raises(WorkbenchError):
        read(tmp_path / name)
    (tmp_path / name).write_bytes(b"\xff\xfe{}")
    with pytest.raises(WorkbenchError, match=r"is no JSON|UTF-8"):
        read(tmp_path / name)


def test_a_run_that_stands_twice_is_refused(tmp_path: Path) -> None:
    table = {"schema": 2, "study": "s", "runs": [RUN, RUN]}
    (tmp_path / "b.json").write_text(json.dumps(table))
    with pytest.raises(WorkbenchError, match="has the run pid, nominal, step, 1 twice"):
        read_baseline(tmp_path / "b.json")


def test_a_number_of_another_unit_is_no_number_to_compare_with(tmp_path: Path) -> None:
    path = tmp_path / "b.json"
    rules = partial(changes, {n: tolerance_of(n) for n in ("rmse", "settling_time")})
    for unit, ways in (("rad", []), ("mrad", ["worse"]), ("bar", ["worse"])):
        run = copy.deepcopy(RUN)
        run["metrics"]["rmse"] |= {"unit": unit, "display_unit": unit}  # type: ignore[index]
        path.write_text(json.dumps({"schema": 2, "study": "s", "runs": [run]}))
        stored = read_baseline(path)
        path.write_text(json.dumps({"schema": 2, "study": "s", "runs": [RUN]}))
        now = read_baseline(path).records.values()
        assert [c.way for c in rules(now, stored)] == ways
