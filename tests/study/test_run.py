"""Runs of a study: kept one by one, resumed after a kill, the same in every process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from tests.study.small_study import BY_BANDWIDTH, small_study
from workbench.study.execution import Store, Workers, kept, store_of
from workbench.study.read import load_study
from workbench.study.result import run_study
from workbench.study.tasks import tasks

OWN = (BY_BANDWIDTH,
       'design = "pid"\n[controllers.broken]\ndesign = "tests.study.own_designs:fails"\n'
       '[controllers.refused]\ndesign = "tests.study.own_designs:impossible"')  # fmt: skip


def test_every_combination_is_one_run(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path, ('name = "small"', "seeds = [1, 2]")))
    keys = [task.key for task in tasks(study)]
    assert len(keys) == len(set(keys)) == 1 * 2 * 1 * 2
    assert [task.traces for task in tasks(study)] == [True, False, False, False]


def test_a_failed_run_is_a_row_with_its_reason(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path, OWN))
    outcome = run_study(study, tmp_path / "out")
    rows = {r.key[:2]: r for r in outcome.records}
    assert len(rows) == 6
    assert not rows[("pid", "nominal")].failed
    assert "ZeroDivisionError: gain is zero" in rows[("broken", "nominal")].reason
    assert "no gain meets the specification" in rows[("refused", "4 kg")].reason
    assert not outcome.passed and len(outcome.failed) == 4
    missed = {j.controller: j for j in outcome.missed}
    assert "the run failed" in missed["broken"].excess()
    # The linear analysis says why it has nothing instead of ending the study.
    assert all(a.reason for a in outcome.loops if a.controller == "refused")


def test_same_seed_same_numbers_in_one_process_and_in_two(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    tables = []
    for jobs in (1, 2):
        records = Workers(Store(tmp_path / str(jobs), "0"), jobs=jobs).records(tasks(study))
        tables.append([replace(r, seconds=0.0).table() for r in records])
    assert tables[0] == tables[1]


def test_another_seed_gives_other_noise(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path, ('name = "small"', "seeds = [1, 2]")))
    first, second = Workers(Store(tmp_path / "out", "0")).records(tasks(study)[:2])
    assert first.metrics and second.metrics
    assert first.metrics["chatter"].value != second.metrics["chatter"].value


def test_finished_runs_are_not_done_again(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    said: list[tuple[int, int, str]] = []
    store = store_of(study, tmp_path / "out")
    first = Workers(store).records(tasks(study), lambda *a: said.append(a))
    again = Workers(store).records(tasks(study), lambda *a: said.append(a))
    assert [r.seconds for r in again] == [r.seconds for r in first]
    assert said[-1] == (2, 2, "finished before")


def test_a_changed_controller_or_other_code_is_run_again(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    other = load_study(small_study(tmp_path, ("bandwidth = 30.0", "bandwidth = 29.0")))
    store = store_of(study, tmp_path / "out")
    (task, *_), (changed, *_) = tasks(study), tasks(other)
    assert store.key(task) != store.key(changed)
    assert store.key(task) != Store(tmp_path / "out", "other code").key(task)


def test_only_runs_of_another_study_are_removed(tmp_path: Path) -> None:
    store = Store(tmp_path, "0")
    store.put("0" * 32, {})
    store.put("1" * 32, {})
    (tmp_path / "mine.json").write_text("{}")
    again = Store(tmp_path, "0")
    again.get("0" * 32)
    again.prune()
    assert {p.name for p in tmp_path.iterdir()} == {"0" * 32 + ".json", "mine.json"}


def test_a_plant_and_a_design_beside_the_study(tmp_path: Path) -> None:
    (tmp_path / "own_rig_of_this_test.py").write_text(
        "from controllers.pid import design_pid\n"
        "from workbench.plants.arm import arm\n"
        "def rig():\n    return arm(2.0)\n"
        "def design(linear, specification):\n    return design_pid(linear)\n"
    )
    own = ('[plant]\nload = "3 kg"', '[plant]\nkind = "own_rig_of_this_test:rig"')
    design = (BY_BANDWIDTH, 'design = "own_rig_of_this_test:design"')
    study = load_study(small_study(tmp_path, own, design))
    assert study.plant.build().parameter("load").value == 2.0
    records = Workers(store_of(study, tmp_path / "out"), jobs=2).records(tasks(study))
    assert [r.reason for r in records] == ["", ""]


def test_a_damaged_file_is_run_again(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    store = store_of(study, tmp_path / "out")
    task = tasks(study)[0]
    Workers(store).records([task])
    path = store.folder / f"{store.key(task)}.json"
    path.write_text(path.read_text()[:100])
    (record,) = Workers(store).records([task])
    stored = kept(store, task)
    assert not record.failed and stored is not None and stored.table() == record.table()


@pytest.mark.system
def test_a_killed_study_goes_on_where_it_was(tmp_path: Path) -> None:
    seeds = ('name = "small"', f"seeds = {list(range(60))}")
    path = small_study(tmp_path, seeds)
    study = load_study(path)
    out = tmp_path / "out"
    command = [sys.executable, "-m", "workbench", "compare", str(path), "--out", str(out), "--jobs"]
    with (tmp_path / "log").open("w") as log:
        child = subprocess.Popen([*command, "1"], stdout=log, stderr=log, start_new_session=True)
        end = time.monotonic() + 60.0
        while time.monotonic() < end and len(list(out.glob("runs/*.json"))) < 3:
            time.sleep(0.02)
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()
    files = {p.name: p.stat().st_mtime_ns for p in out.glob("runs/*.json")}
    assert 3 <= len(files) < 120 and not (out / "results.json").exists()
    store = store_of(study, out)
    wanted = tasks(study)
    finished = [kept(store, task) for task in wanted]
    assert sum(r is not None for r in finished) == len(files)
    # What was finished is taken as it is; the rest would be done now.
    said: list[int] = []
    done = [t for t, r in zip(wanted, finished, strict=True) if r]
    Workers(store).records(done, lambda count, total, what: said.append(count))
    assert said == [len(files)]
    assert {p.name: p.stat().st_mtime_ns for p in out.glob("runs/*.json")} == files


def test_a_guard_answers_the_faults_of_a_scenario(tmp_path: Path) -> None:
    faulty = """values = [25, 35]

[[scenarios.step.faults]]
time = 0.2
until = 0.22
signal = "angle"
kind = "missing"
"""
    changes = ('design = "pid"', 'design = "pid"\nguard = true'), ("values = [25, 35]\n", faulty)
    study = load_study(small_study(tmp_path, *changes))
    found = Workers(Store(tmp_path, "0")).records(tasks(study)[:1])[0].metrics
    assert found is not None
    # Ten samples are missing; the law steps on with what the pressures say of them.
    assert found["guard_estimated"].value == 10.0
    for what in ("clamped", "held", "inner", "safe"):
        assert found[f"guard_{what}"].value == 0.0
