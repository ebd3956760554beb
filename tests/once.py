"""Slow results that several test modules share: computed once per run, whatever the workers."""

from __future__ import annotations

import fcntl
import os
import pickle
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import cloudpickle

SHARED = "WORKBENCH_TESTS_SHARED"
"""Variable that names the folder of a run's shared results; the first process sets it."""

T = TypeVar("T")


def once(function: Callable[[bool], T]) -> Callable[[bool], T]:
    """Let all workers of a run share what a function returns; each loads it for itself."""

    @lru_cache(maxsize=2)
    def shared(choice: bool) -> T:
        file = Path(os.environ[SHARED]) / f"{function.__module__}.{function.__name__}-{choice}"
        with Path(f"{file}.lock").open("w", encoding="utf-8") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not file.exists():
                found = function(choice)
                file.write_bytes(cloudpickle.dumps(found))
                return found
        loaded: T = pickle.loads(file.read_bytes())  # noqa: S301
        return loaded

    return shared
