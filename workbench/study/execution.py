"""Runs a study: in parallel, with progress, and so that a stopped study goes on."""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeVar

from workbench.errors import WorkbenchError, check_range
from workbench.study.children import call_within
from workbench.study.inputs import Seen, seen
from workbench.study.store import Store, code_digest
from workbench.study.study import Study
from workbench.study.tasks import Record, Task, execute
from workbench.verification.metrics import tolerance_of

T = TypeVar("T")
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

    for i, record, read in parallel([call(i) for i in open_tasks], jobs=jobs, dask=dask):
        found[i] = record
        store.keep(asked[i], record, read)
        if progress:
            progress(len(found), len(asked), " / ".join(str(part) for part in record.key))
    return tuple(found[i] for i in range(len(asked)))


def _numbered(number: int, task: Task) -> tuple[int, Record, Seen]:
    return number, execute(task), seen()


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


def parallel(
    calls: Sequence[tuple[Callable[..., T], tuple[Any, ...]]],
    *,
    jobs: int = 1,
    dask: str | None = None,
) -> Iterator[T]:
    """Yield the results of calls as they come, from this process, others, or a cluster.

    Args:
        jobs: Number of processes; 1 stays in this one.
        dask: Address of a Dask scheduler such as ``tcp://host:8786``, or None.

    Yields:
        What the calls return, in the order in which they finish.

    Raises:
        WorkbenchError: If the number of processes is outside its range, or Dask is not installed or
            its scheduler not there.

    Example:
        >>> sorted(parallel([(max, (1, 2)), (min, (1, 2))]))
        [1, 2]
    """
    count = int(check_range("number of processes", jobs, 1, 1024))
    if not calls:
        return
    if dask is None and (count == 1 or len(calls) == 1):
        for function, arguments in calls:
            yield function(*arguments)
        return
    import joblib

    with ExitStack() as stack:
        if dask is None:
            # Threads inside a process would only compete with the other processes.
            settings: dict[str, Any] = {"backend": "loky", "inner_max_num_threads": 1}
        else:
            client = stack.enter_context(_client(dask))
            workers = sum(client.nthreads().values())
            count = max(1, workers)
            settings = {"backend": "dask"}
        stack.enter_context(joblib.parallel_config(**settings))
        workers_pool = joblib.Parallel(
            n_jobs=count, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs"
        )
        try:
            yield from workers_pool(
                joblib.delayed(call_within)(os.getpid(), function, given)
                for function, given in calls
            )
        except BrokenProcessPool:
            raise WorkbenchError(
                "a process that did a run ended in the middle of it: it ran out of memory, or a"
                " module of your own ended it; what was finished is kept, and --jobs 1 shows where"
            ) from None


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise WorkbenchError(
            "a Dask cluster needs the package 'distributed'; install it with the extra 'cluster',"
            ' as in pip install "muscle-arm-workbench[cluster]"'
        ) from None
    try:
        return Client(address, timeout=10)
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split())[:120]
        raise WorkbenchError(
            f"there is no Dask scheduler at {address!r} ({reason}); start one with 'dask scheduler'"
            " and give its address, such as tcp://127.0.0.1:8786"
        ) from None


def store_of(study: Study, folder: Path) -> Store:
    """Return the store of a study's runs, in ``runs`` below its folder of results."""
    own = (str(study.path.resolve().parent),) if study.has_own_code else ()
    return Store(Path(folder) / "runs", code_digest(*own), study.path.parent)
