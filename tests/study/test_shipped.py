"""The shipped study: its baseline holds here, with a compiler and without."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.study.baseline import Baseline, changes, read_baseline
from workbench.study.conditions import condition_changes, conditions
from workbench.study.execution import Store, Workers
from workbench.study.judgements import judge_records
from workbench.study.read import load_study, shipped_study
from workbench.study.study import NOMINAL
from workbench.study.tasks import record_from_table, tasks

BASELINE = shipped_study("arm").with_name("arm.baseline.json")

INTERPRETED = """
import json, sys
from workbench.study.read import load_study
from workbench.study.read import shipped_study
from workbench.study.tasks import execute, tasks
wanted = [t for t in tasks(load_study(shipped_study("arm")))
          if t.variation.nominal and t.scenario.name == "staircase"]
print(json.dumps([execute(t).table() for t in wanted]))
"""


@pytest.mark.system
def test_the_shipped_study_meets_its_requirements_and_its_baseline(tmp_path: Path) -> None:
    study = load_study(shipped_study("arm"))
    records = Workers(Store(tmp_path, "0"), jobs=2).records(tasks(study))
    before = read_baseline(BASELINE)
    rules = {name: study.tolerance(name) for r in records if r.metrics for name in r.metrics}
    found = changes(rules, records, before)
    # Accept an intended change with: workbench bless DIR --baseline arm.baseline.json
    assert not [str(c) for c in found if c.fails]
    assert {r.key for r in records} == set(before.records)
    assert all(j.met for j in judge_records(study, records) if j.hard)


@pytest.mark.long
@pytest.mark.system
def test_without_a_compiler_the_numbers_are_the_same_within_tolerances() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERPRETED],
        env={**os.environ, "WORKBENCH_CC": "none"},
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    records = [record_from_table(row) for row in json.loads(done.stdout)]
    assert len(records) == 3 and not any(r.failed for r in records)
    study = load_study(shipped_study("arm"))
    stored = read_baseline(BASELINE).records
    own = {key: r for key, r in stored.items() if key[1:3] == (NOMINAL, "staircase")}
    rules = {name: study.tolerance(name) for r in records if r.metrics for name in r.metrics}
    found = changes(rules, records, Baseline(own, "arm", BASELINE))
    assert not [str(c) for c in found]


def test_the_conditions_are_those_that_were_blessed() -> None:
    blessed = read_baseline(BASELINE).conditions
    assert blessed is not None
    assert condition_changes(blessed, conditions(load_study(shipped_study("arm")))) == ()
