"""Processes that work for another end when that one is gone, also after a kill."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from secrets import token_hex
from typing import Any, NamedTuple

from workbench.work.counted import Work, done, since

PAUSE = 0.5
"""Time between two looks for the parent, s."""

THIS_PROCESS = token_hex(8)
"""What tells this process from all others, also on other machines."""


class Returned(NamedTuple):
    """What a call returned, and what it took where.

    Args:
        place: That of the call among others.
        process: `THIS_PROCESS` of the one that did it.
    """

    place: int
    result: Any
    work: Work
    process: str


_worker = False


def is_worker() -> bool:
    """Whether this process is one of several that share the work of another."""
    return _worker


def call(place: int, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Returned:
    """Call a function and tell what it took."""
    before = done()
    return Returned(place, function(*arguments), since(before), THIS_PROCESS)


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
