"""Answers to many cases: kept as soon as they are there, the same however they are shared."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from workbench.errors import WorkbenchError
from workbench.evaluation.foreign.foreign_case import answer as diagnosed
from workbench.evaluation.foreign.foreign_case import plan
from workbench.evaluation.kept_answers import answered, chosen_cases, read_kept


@dataclass(frozen=True)
class _Case:
    seed: int

    @property
    def name(self) -> str:
        return f"case-{self.seed}"


def _answer(case: _Case, jobs: int) -> dict[str, Any]:
    return {"case": case.name, "jobs": jobs, "process": os.getpid(), "verdict": {}}


def _refuse(case: _Case, jobs: int) -> dict[str, Any]:
    raise AssertionError(f"{case.name} was answered before")


CASES = [_Case(seed) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster'")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as started:
        yield started.scheduler_address


def test_what_is_kept_is_not_answered_again(tmp_path: Path) -> None:
    first = list(answered(CASES[:2], tmp_path, _answer))
    # What is left of three is one case, which has all processes to itself.
    again = list(answered(CASES, tmp_path, _answer, jobs=2))
    assert again[:2] == first
    assert [row["jobs"] for row in again] == [1, 1, 2]
    assert list(answered(CASES, tmp_path, _refuse)) == read_kept(tmp_path) == again


def test_a_part_of_a_plan_or_the_cases_that_are_named() -> None:
    def chosen(**asked: Any) -> list[str]:
        return [case.name for case in chosen_cases(CASES, **asked)]

    assert chosen(part=(2, 2)) == ["case-2"]
    assert chosen(only=["case-3"]) == ["case-3"]
    with pytest.raises(WorkbenchError, match="case is 'case-4'"):
        chosen(only=["case-4"])


def test_cases_are_answered_side_by_side(tmp_path: Path) -> None:
    rows = list(answered(CASES, tmp_path, _answer, jobs=2))
    assert {row["case"] for row in rows} == {case.name for case in CASES}
    assert os.getpid() not in {row["process"] for row in rows}
    assert {row["jobs"] for row in rows} == {1}


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_answers_and_the_folder_is_here(tmp_path: Path, cluster: str) -> None:
    next(answered(CASES, tmp_path, _answer))
    rows = list(answered(CASES, tmp_path, _answer, dask=cluster))
    assert sorted(row["case"] for row in rows) == [case.name for case in CASES]
    assert sum(row["process"] == os.getpid() for row in rows) == 1
    assert len(list(tmp_path.glob("*.json"))) == 3


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_finds_what_one_process_finds(tmp_path: Path, cluster: str) -> None:
    cases = [c for c in plan(60) if c.machine.name == "circuit"][:2]
    here = {r["case"]: r for r in answered(cases, tmp_path / "here", diagnosed)}
    there = {r["case"]: r for r in answered(cases, tmp_path / "there", diagnosed, dask=cluster)}
    for row in (*here.values(), *there.values()):
        for key in ("seconds", "work"):
            row["verdict"].pop(key)
        for key in ("seconds", "processor_seconds"):
            row.pop(key)
    assert here == there
