"""A study file that says something impossible is refused, with the line and the reason."""

from __future__ import annotations

import copy
import random
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.study.gate import STUDY
from workbench.errors import WorkbenchError
from workbench.study.read import StudyFile, load_study, resolve

WRONG = {
    "a reference beyond the stop": ("values = [25, 35]", "values = [25, 450]", "is 450 deg"),
    "a sine beyond the stop": ("amplitude = 5\n", "amplitude = 500\n", "valid range"),
    "a sine faster than the samples": ("frequency_Hz = 1.0", "frequency_Hz = 400",
        "must be below 250 Hz"),
    "a step after the end": ("times = [0.0, 0.1]", "times = [0.0, 5]", "would never happen"),
    "a sine after the end": ("frequency_Hz = 1.0", "frequency_Hz = 1.0\nbegin = 3", "never happen"),
    "a change after the end": ('duration = "1 s"',
        'duration = "1 s"\nchanges = [{ time = 2, parameter = "load", value = 2 }]',
        "would never happen"),
    "a disturbance after the end": ('duration = "1 s"',
        'duration = "1 s"\ndisturbances = [{ time = 2, port = "joint.torque", level = 2 }]',
        "would never happen"),
    "hard in words": ("hard = false", 'hard = "no"', "hard is 'no'; it must be true or false"),
    "a negative bandwidth": ("bandwidth = 30.0", "bandwidth = -30.0", "-30"),
    "true as a bandwidth": ("bandwidth = 30.0", "bandwidth = true", "give a number"),
    "true as a load": ('[plant]\nload = "3 kg"', "[plant]\nload = true", "load"),
    "true as a limit": ("limit = 0.6", "limit = true", "limit is True; it must be a number"),
    "text as a limit": ("limit = 0.6", 'limit = "soon"', "'soon' is not a number"),
    "a number as a unit": ('unit = "s"', "unit = 1", "unit is 1; it must be text"),
    "a list as a unit": ('unit = "s"', 'unit = ["s"]', "it must be text"),
    "text as times": ("times = [0.0, 0.1]", 'times = "soon"', "times"),
    "true among times": ("times = [0.0, 0.1]", "times = [0.0, true]", "must be a number"),
    "a number as a reference": (
        '[scenarios.sine.references.angle]\nkind = "sine"\nunit = "deg"\nmean = 30\namplitude = 5\n'
        "frequency_Hz = 1.0\n",
        "[scenarios.sine.references]\nangle = 3\n", "angle is 3; it must be a table"),
    "a list as a kind": ('kind = "sine"', 'kind = ["sine"]', "kind is ['sine']; it must be text"),
    "a number as a scenario": ('scenario = "sine"', "scenario = 1", "it must be text"),
    "a table as angles": ("[robustness]\n", "[linear]\nangles = { a = 1 }\n[robustness]\n",
        "a list"),
    "an unknown plane": ('[plant]\nload = "3 kg"', '[plant]\nplane = "up"', "plane"),
    "a plane that is a number": ('[plant]\nload = "3 kg"', "[plant]\nplane = 1", "plane"),
    "another rate than the controller": ('settle = "0.1 s"',
        'settle = "0.1 s"\nsample_time = "1 ms"', "steps every 0.002 s and scenario"),
    "a box of one number": ("load = [2, 6]", "load = 2", "it must be a list of 2"),
    "a box of text": ("load = [2, 6]", 'load = ["light", "heavy"]', "load"),
    "a size that no step has": ('metric = "settling_time"',
        'metric = "settling_time"\nstep = "45 deg"', "has a step of 45 deg"),
    "a negative duration": ('duration = "1 s"', 'duration = "-1 s"', "-1"),
    "an endless duration": ('duration = "1 s"', "duration = inf", "a number, or text with a unit"),
    "seeds that are no list": ("[plant]\n", "seeds = 3\n[plant]\n", "seeds is 3"),
    "half a seed": ("[plant]\n", "seeds = [1.5]\n[plant]\n", "whole number"),
    "a requirement that judges no run": ('unit = "s"',
        'unit = "s"\nscenario = "step"\nvariations = ["5 kg"]\n[variations."5 kg"]\n'
        'parameters = { load = "5 kg" }\nscenarios = ["sine"]',
        "judges no run of this study"),
    "names that are no list": ('load = "4 kg" }', 'load = "4 kg" }\nscenarios = "sine"', "a list"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_it_is_refused_with_line_and_reason(name: str, tmp_path: Path) -> None:
    before, after, reason = WRONG[name]
    head = "" if "seeds" in after else 'name = "small"\n\n'
    text = STUDY if head else STUDY.replace('name = "small"\n\n', "")
    assert before in text
    changed = text.replace(before, after, 1)
    path = tmp_path / "study.toml"
    path.write_text(changed, encoding="utf-8")
    with pytest.raises(WorkbenchError) as caught:
        load_study(path)
    said = str(caught.value)
    line = re.search(r", line (\d+): ", said)
    assert line is not None and reason in said, said
    first = changed[: changed.index(after)].count("\n") + 1
    last = first + after.count("\n") + before.count("\n")
    # The line is that of the entry, or of the table that the mistake stands in.
    assert first - 8 <= int(line.group(1)) <= last


def test_requirements_on_what_is_not_judged_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace('design = "pid"', 'design = "pid"\njudged = false'))
    with pytest.raises(WorkbenchError, match="line 24: .* judges no run of this study"):
        load_study(path)


def test_tables_nested_too_deep_are_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    for depth in (50, 400, 5000):
        path.write_text(f"a = {'[' * depth}{']' * depth}\n", encoding="utf-8")
        with pytest.raises(WorkbenchError):
            load_study(path)


VALUES: tuple[Any, ...] = (
    True, -1, 0, 1e9, float("nan"), "x", "", [], {}, [[]], [{}], [1, "a"], {"a": {"b": [1]}},
    [[[["deep"]]]], "3 furlongs", "-2 s", 10**400,
)  # fmt: skip


def _places(table: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items = table.items() if isinstance(table, dict) else enumerate(table)
    found = []
    for key, value in items:
        found.append((*place, key))
        if isinstance(value, (dict, list)):
            found += _places(value, (*place, key))
    return found


def test_whatever_stands_somewhere_is_accepted_or_a_sentence(tmp_path: Path) -> None:
    table = tomllib.loads(STUDY)
    every = [(place, value) for place in _places(table) for value in VALUES]
    refused = 0
    for place, value in random.Random(1).sample(every, 150):
        changed = copy.deepcopy(table)
        inner: Any = changed
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = copy.deepcopy(value)
        try:
            resolve(StudyFile(tmp_path / "study.toml", changed, STUDY))
        except WorkbenchError as error:
            refused += 1
            assert ", line " in str(error)
    assert refused > 100
