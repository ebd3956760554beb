"""Processes that do runs end when the one that asked for them is gone, also after a kill."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any

PAUSE = 0.5
"""Time between two looks for the parent, s."""


def call_within(parent: int, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Call a function in a process that must not outlive another.

    Args:
        parent: Number of the process that asked for it.
    """
    # On a machine of a cluster the process has another parent, and lives by its own rules.
    if os.getpid() != parent and os.getppid() == parent:
        _end_with(parent)
    return function(*arguments)


@lru_cache(maxsize=1)
def _end_with(parent: int) -> None:
    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PAUSE)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
