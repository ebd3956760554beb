"""Calls side by side in threads of this process, for C code that runs for long."""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from workbench.work.children import is_worker
from workbench.work.processes import Call

T = TypeVar("T")


def threads() -> int:
    """Return how many threads may work: one per core, but one in a process that is one of many."""
    return 1 if is_worker() else os.cpu_count() or 1


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
