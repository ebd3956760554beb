"""Ending early: a limit of time, and SIGTERM like Ctrl-C."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from workbench.errors import WorkbenchError

_AGAIN_S = 5.0
"""Time after which the signal comes again, should a library have swallowed it, in s."""


class TimeUp(KeyboardInterrupt):
    """The time is up that the user gave."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """End what is done inside after a time in s, above 0; None sets no limit.

    Raises:
        TimeUp: When the time is up.
        WorkbenchError: If the platform has no timer that interrupts.
    """
    if seconds is None:
        yield
        return
    if not hasattr(signal, "setitimer"):
        raise WorkbenchError(
            "a time limit needs a timer that this platform does not have; leave the limit out and"
            " end with Ctrl-C, which keeps what was found too"
        )

    def end(*_: object) -> None:
        raise TimeUp

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds, _AGAIN_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """Let SIGTERM do inside what Ctrl-C does."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
