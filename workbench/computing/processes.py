"""Calls shared among processes, here or on a cluster, and among threads; counted work is added up.

Processes that work for another end when that one is gone, also after a kill.
"""

from __future__ import annotations

import functools
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, suppress
from operator import itemgetter
from pathlib import Path
from secrets import token_hex
from typing import Any, ClassVar, TypeVar

from workbench.computing.counted import Work, add, done, since
from workbench.errors import WorkbenchError, check_range, missing_package
from workbench.registry import own_modules

T = TypeVar("T")

Call = tuple[Callable[..., T], tuple[Any, ...]]
"""A function and its arguments."""

PAUSE = 0.5
"""Time between two looks for the parent, s."""

THIS_PROCESS = token_hex(8)
"""What tells this process from all others, also on other machines."""

_worker = False
"""Whether this process is one of several that share the work of another."""


def _called(
    place: int, function: Callable[..., T], arguments: tuple[Any, ...]
) -> tuple[int, T, Work, str]:
    """Return the place of a call among others, its result, what it took, and where it was done."""
    before = done()
    return place, function(*arguments), since(before), THIS_PROCESS


def end_with(parent: int, team: int = 0) -> None:  # noqa: ARG001
    """Let this process end when the one that started it has ended.

    Args:
        parent: Number of the process that started it; it may be gone already.
        team: Which processes it belongs to; only those of one team are used again.
    """
    global _worker  # noqa: PLW0603
    _worker = True

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PAUSE)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


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
            count = max(1, sum(client.nthreads().values()))
            settings = {"backend": "dask"}
        stack.enter_context(joblib.parallel_config(**settings))
        workers_pool = joblib.Parallel(
            n_jobs=count, return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs"
        )
        try:
            for place, result, work, process in workers_pool(
                joblib.delayed(_called)(i, *known) for i, known in enumerate(calls)
            ):
                if process != THIS_PROCESS:
                    add(work)
                yield place, result
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


def threads() -> int:
    """Return how many threads may work: one per core, but one in a process that is one of many."""
    return 1 if _worker else os.cpu_count() or 1


def side_by_side(calls: Sequence[Call[T]]) -> list[T]:
    """Return the results of calls in their order; the first runs in this thread.

    Each call works on memory of its own.
    """
    if threads() < 2 or len(calls) < 2:
        return [function(*arguments) for function, arguments in calls]
    (function, arguments), *others = calls
    begun = [_pool().submit(other, *given) for other, given in others]
    # In the order of the calls, so that of several errors always the same one is raised.
    try:
        first = function(*arguments)
    finally:
        for future in begun:
            future.exception()
    return [first, *(future.result() for future in begun)]


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(1, threads() - 1), thread_name_prefix="workbench")


if hasattr(os, "register_at_fork"):
    # The threads of a pool do not come along.
    os.register_at_fork(after_in_child=_pool.cache_clear)
