"""Runs a study: in parallel, with progress, and so that a stopped study goes on."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from workbench.errors import WorkbenchError
from workbench.study.inputs import Seen, seen
from workbench.study.store import Store, code_digest
from workbench.study.study import Study
from workbench.study.tasks import Record, Task, execute
from workbench.verification.metrics import tolerance_of
from workbench.work.counted import Work, done, since
from workbench.work.processes import parallel

FINISHED_BEFORE = "finished before"
"""What progress is told of runs that an earlier study finished."""

Progress = Callable[[int, int, str], None]
"""Called with the number of finished runs, of all runs, and what was finished."""


def run_tasks(
    asked: Sequence[Task],
    store: Store,
    *,
    jobs: int = 1,
    dask: str | None = None,
    progress: Progress | None = None,
) -> tuple[Record, ...]:
    """Do runs that are not finished yet, and keep each as soon as it is.

    Args:
        store: Where finished runs are kept.
        dask: Address of a Dask scheduler that does the work, instead of local processes.

    Returns:
        Records in the order of the runs.

    Raises:
        WorkbenchError: If the number of processes is outside its range or there is no cluster.
    """
    found: dict[int, Record] = {}
    for i, task in enumerate(asked):
        record = store.record(task)
        if record is not None:
            found[i] = record
    open_tasks = [i for i in range(len(asked)) if i not in found]
    if progress and found:
        progress(len(found), len(asked), FINISHED_BEFORE)

    def call(i: int) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return _numbered, (i, asked[i])

    for i, record, read, work in parallel([call(i) for i in open_tasks], jobs=jobs, dask=dask):
        found[i] = record
        store.keep(asked[i], record, read, work)
        if progress:
            progress(len(found), len(asked), " / ".join(str(part) for part in record.key))
    return tuple(found[i] for i in range(len(asked)))


def _numbered(number: int, task: Task) -> tuple[int, Record, Seen, Work]:
    before = done()
    record = execute(task)
    return number, record, seen(), since(before)


SAMPLE = 3
"""Finished runs that `verify_kept` does again at least."""


def verify_kept(asked: Sequence[Task], store: Store) -> None:
    """Do a sample of the finished runs again, 5 % of them, and compare.

    Raises:
        WorkbenchError: If one does not come out as it was kept.
    """
    kept = [(task, record) for task in asked if (record := store.record(task)) is not None]
    count = min(len(kept), max(SAMPLE, len(kept) // 20))
    for task, record in random.sample(kept, count):
        differs = _difference(record, execute(task))
        if differs:
            name = " / ".join(str(part) for part in record.key)
            raise WorkbenchError(
                f"the finished run {name} does not come out as it was kept: {differs}; something"
                " that it depends on is not seen; run the study with --fresh"
            )


def _difference(kept: Record, now: Record) -> str:
    if kept.metrics is None or now.metrics is None:
        return (
            "" if kept.failed == now.failed else f"{kept.reason or 'done'}, {now.reason or 'done'}"
        )
    for metric in now.metrics.values:
        if not tolerance_of(metric.name).repeats:
            continue
        old = kept.metrics[metric.name].value if metric.name in kept.metrics else math.nan
        if not (
            math.isclose(old, metric.value, rel_tol=1e-6, abs_tol=1e-12)
            or (math.isnan(old) and math.isnan(metric.value))
        ):
            return f"{metric.name} was {old:.6g} and is {metric.value:.6g} {metric.unit}"
    return ""


def store_of(study: Study, folder: Path) -> Store:
    """Return the store of a study's runs, in ``runs`` below its folder of results."""
    own = (str(study.path.resolve().parent),) if study.has_own_code else ()
    return Store(Path(folder) / "runs", code_digest(*own), study.path.parent)
