"""Calls shared among processes, here or on a cluster; the work that they count is added up."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, suppress
from operator import itemgetter
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from workbench.errors import WorkbenchError, check_range, missing_package
from workbench.registry import own_modules
from workbench.work.children import THIS_PROCESS, call, end_with
from workbench.work.counted import add

T = TypeVar("T")

Call = tuple[Callable[..., T], tuple[Any, ...]]
"""A function and its arguments."""


class _Team:
    """The processes that do one set of calls after another.

    Args:
        number: Which team it is, counted from 0.
        code: Time, in ns, and size, in bytes, of the user's own modules that it may have imported.
    """

    number: int = 0
    code: ClassVar[dict[str, tuple[int, int]]] = {}


def processes(asked: int | None, most: int = 1024) -> int:
    """Return a number of processes: what is asked for, or one per core of this machine.

    Args:
        most: How many there are at the most where nobody asks.
    """
    return min(os.cpu_count() or 1, most) if asked is None else asked


def begin_anew() -> None:
    """Let other processes do what comes next: those that are there have read what has changed."""
    _Team.number += 1


def _team() -> int:
    """Return which processes do what comes next: others where own code was rewritten since."""
    now = {}
    for module in own_modules().values():
        with suppress(OSError):
            found = Path(module).stat()
            now[module] = found.st_mtime_ns, found.st_size
    if any(_Team.code.get(path, stamp) != stamp for path, stamp in now.items()):
        begin_anew()
    _Team.code |= now
    return _Team.number


def parallel(
    calls: Sequence[Call[T]], *, jobs: int = 1, dask: str | None = None
) -> Iterator[tuple[int, T]]:
    """Yield the results of calls as they come, from this process, others, or a cluster.

    Each with the place, counted from 0, at which its call stands.

    Args:
        jobs: Number of processes; 1 stays in this one.
        dask: Address of a Dask scheduler such as ``tcp://host:8786``, or None.

    Example:
        >>> sorted(parallel([(max, (1, 2)), (min, (1, 2))]))
        [(0, 2), (1, 1)]
    """
    count = int(check_range("number of processes", jobs, 1, 1024))
    if not calls:
        return
    if dask is None and (count == 1 or len(calls) == 1):
        for i, (function, arguments) in enumerate(calls):
            yield i, function(*arguments)
        return
    import joblib

    with ExitStack() as stack:
        if dask is None:
            # Threads inside a process would only compete with the other processes.
            settings: dict[str, Any] = {"backend": "loky", "inner_max_num_threads": 1}
            # From its first moment on a process knows whose it is.
            settings |= {"initializer": end_with, "initargs": (os.getpid(), _team())}
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
            for returned in workers_pool(
                joblib.delayed(call)(i, *known) for i, known in enumerate(calls)
            ):
                if returned.process != THIS_PROCESS:
                    add(returned.work)
                yield returned.place, returned.result
        except BrokenProcessPool:
            raise WorkbenchError(
                "a process that did a run ended in the middle of it: it ran out of memory, or a"
                " module of your own ended it; what was finished is kept, and --jobs 1 shows where"
            ) from None


def in_order(calls: Sequence[Call[T]], *, jobs: int = 1) -> list[T]:
    """Return the results of calls in their order, however `parallel` shared them."""
    return [result for _, result in sorted(parallel(calls, jobs=jobs), key=itemgetter(0))]


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise missing_package("a Dask cluster", "distributed", "cluster") from None
    try:
        return Client(address, timeout=10)
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split())[:120]
        raise WorkbenchError(
            f"there is no Dask scheduler at {address!r} ({reason}); start one with 'dask scheduler'"
            " and give its address, such as tcp://127.0.0.1:8786"
        ) from None
