"""The same study on a Dask cluster of two processes: the same numbers."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import pytest

from tests.study.small_study import small_study
from workbench.errors import WorkbenchError
from workbench.study.execution import Store, Workers
from workbench.study.read import load_study
from workbench.study.tasks import tasks

distributed = pytest.importorskip(
    "distributed", reason="the extra 'cluster' (package distributed) is not installed"
)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_two_processes_of_a_cluster(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    with (
        warnings.catch_warnings(),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
    ):
        workers = Workers(Store(tmp_path / "far", "0"), dask=cluster.scheduler_address)
        far = workers.records(tasks(study))
    near = Workers(Store(tmp_path / "near", "0")).records(tasks(study))
    one, other = ([replace(r, seconds=0.0).table() for r in each] for each in (far, near))
    assert one == other


@pytest.mark.filterwarnings("ignore")
def test_no_scheduler_there(tmp_path: Path) -> None:
    study = load_study(small_study(tmp_path))
    with pytest.raises(WorkbenchError, match="no Dask scheduler at 'nonsense://nowhere'"):
        Workers(Store(tmp_path, "0"), dask="nonsense://nowhere").records(tasks(study))
