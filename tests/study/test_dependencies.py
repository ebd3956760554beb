"""Stale runs do not pass: whatever a run opened, imported or used must be as it was."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from tests.study.small_study import BY_BANDWIDTH, small_study
from workbench.errors import WorkbenchError
from workbench.study import execution
from workbench.study.dependencies import new_study, watched
from workbench.study.execution import FINISHED_BEFORE, Store, Workers, store_of, verify_kept
from workbench.study.read import load_study
from workbench.study.result import run_study
from workbench.study.tasks import tasks

KEY = "0" * 32


def kept(folder: Path) -> bool:
    """Tell whether the result is found by a later study."""
    return Store(folder / "out" / "runs", "0", folder).get(KEY) is not None


def keep(folder: Path, *read: Path) -> None:
    new_study(folder)
    with watched():
        for path in read:
            path.read_bytes()
    Store(folder / "out" / "runs", "0", folder).put(KEY, {"value": 1})


@pytest.mark.parametrize("name", ["gains.json", "tuning/gains.bin", "../elsewhere-{}/map.dat"])
def test_a_file_that_was_opened_is_part_of_the_run(tmp_path: Path, name: str) -> None:
    path = tmp_path / name.format(tmp_path.name)
    path.parent.mkdir(exist_ok=True)
    path.write_text("1")
    keep(tmp_path, path)
    assert kept(tmp_path)
    path.write_text("2")
    assert not kept(tmp_path)
    path.unlink()
    assert not kept(tmp_path)


def test_a_file_that_was_looked_for_in_vain_is_part_of_the_run(tmp_path: Path) -> None:
    new_study(tmp_path)
    with watched(), pytest.raises(FileNotFoundError):
        (tmp_path / "gains.json").read_bytes()
    Store(tmp_path / "out" / "runs", "0", tmp_path).put(KEY, {"value": 1})
    assert kept(tmp_path)
    (tmp_path / "gains.json").write_text("1")
    assert not kept(tmp_path)


def test_a_folder_that_moved_keeps_its_runs(tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    (here / "gains.json").write_text("1")
    keep(here, here / "gains.json")
    here.rename(tmp_path / "there")
    assert kept(tmp_path / "there")


def test_another_version_of_a_package_is_another_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(tmp_path)
    assert kept(tmp_path)
    monkeypatch.setattr(execution, "installed", lambda _: "99")
    assert not kept(tmp_path)


def test_a_file_that_is_only_written_is_no_input(tmp_path: Path) -> None:
    with watched():
        (tmp_path / "log.txt").write_text("1")
    keep(tmp_path)
    (tmp_path / "log.txt").write_text("2")
    assert kept(tmp_path)


@pytest.mark.parametrize("damage", ["{", "[]", '{"value": 1}', '{"inputs": {"files": 3}}', "null"])
def test_a_damaged_result_is_none(tmp_path: Path, damage: str) -> None:
    keep(tmp_path)
    (tmp_path / "out" / "runs" / f"{KEY}.json").write_text(damage)
    assert not kept(tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("jobs", [1, 2])
def test_what_is_edited_between_two_studies_of_a_session(tmp_path: Path, jobs: int) -> None:
    place, gains = tmp_path / "study", tmp_path / "tuning" / "gains.txt"
    place.mkdir()
    gains.parent.mkdir()
    own = place / f"edited_with_{jobs}.py"
    file = small_study(place, (BY_BANDWIDTH, f'design = "{own.stem}:design"'))

    def rmse(gain: float, factor: float) -> tuple[list[float], list[str]]:
        text = (
            "from pathlib import Path\n"
            "from controllers.pid import PIDSpecification, design_pid\n"
            "def design(linear, specification):\n"
            f"    bandwidth = {factor} * float(Path({str(gains)!r}).read_text())\n"
            "    return design_pid(linear, PIDSpecification(bandwidth=bandwidth))\n"
        )
        for path, content in ((own, text), (gains, str(gain))):
            if not path.exists() or path.read_text() != content:
                path.write_text(content)
        said: list[str] = []
        study = load_study(file)
        workers = Workers(store_of(study, tmp_path / "out"), jobs=jobs)
        records = workers.records(tasks(study), lambda *told: said.append(told[2]))
        return [r.metrics["rmse"].value for r in records if r.metrics is not None], said

    before, _ = rmse(30.0, 1.0)
    # The module first, then what it reads.
    for gain, factor in ((30.0, 0.45), (22.0, 0.45)):
        slower, said = rmse(gain, factor)
        assert len(slower) == 2
        assert all(a > 1.01 * b for a, b in zip(slower, before, strict=True))
        assert FINISHED_BEFORE not in said
        before = slower
    # What is as it was is not done again.
    assert rmse(22.0, 0.45) == (before, [FINISHED_BEFORE])
    for path in (tmp_path / "out" / "runs").glob("*.json"):
        assert json.loads(path.read_text())["work"], "what a run has cost is kept with it"


def test_a_sample_of_the_finished_runs_is_done_again(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    run_study(study, tmp_path / "out", verify_cache=True)
    verify_kept(tasks(study), store_of(study, tmp_path / "out"))
    for path in (tmp_path / "out" / "runs").glob("*.json"):
        table = json.loads(path.read_text())
        table["metrics"]["rmse"]["value"] *= 0.9
        path.write_text(json.dumps(table))
    with pytest.raises(WorkbenchError, match=r"does not come out .*: rmse was .* with --fresh"):
        run_study(study, tmp_path / "out", verify_cache=True)


def test_gains_in_a_data_base_are_part_of_the_run(tmp_path: Path) -> None:
    path = tmp_path / "gains.db"

    def write(value: float) -> None:
        path.unlink(missing_ok=True)
        with closing(sqlite3.connect(path)) as base:
            base.execute("create table gains (bandwidth real)")
            base.execute("insert into gains values (?)", (value,))
            base.commit()

    write(30.0)
    new_study(tmp_path)
    with watched(), closing(sqlite3.connect(path)) as base:
        assert base.execute("select bandwidth from gains").fetchone() == (30.0,)
    Store(tmp_path / "out" / "runs", "0", tmp_path).put(KEY, {"value": 1})
    assert kept(tmp_path)
    write(20.0)
    assert not kept(tmp_path)
