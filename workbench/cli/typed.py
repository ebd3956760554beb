"""The command line as it was typed, for the pages that it writes."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

_WORDS: ContextVar[tuple[str, ...]] = ContextVar("_WORDS", default=())


@contextmanager
def typing(words: Sequence[str]) -> Iterator[None]:
    """Remember the words after the name of the program while a verb runs."""
    token = _WORDS.set(tuple(words))
    try:
        yield
    finally:
        _WORDS.reset(token)


def typed() -> str:
    """Return the command that is running, ready for a shell; empty if a verb was called as code."""
    words = _WORDS.get()
    return shlex.join(["workbench", *words]) if words else ""
