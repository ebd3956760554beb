"""The command line in a test: words are typed, and what is said comes back."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Said:
    """What a command wrote, and all that was written since the one before."""

    out: str
    err: str

    @property
    def result(self) -> Any:
        """What ``--json`` printed."""
        return json.loads(self.out)


Shell = Callable[..., Said]
"""Runs words, each but paths split as a shell does; its exit status is ``status``, if not None."""

Refused = Callable[..., str]
"""Runs words that are refused, and returns all that is said of it."""
