"""Verbs that have their folder of results to themselves while they run."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any


def claiming(verb: Callable[..., Any]) -> Callable[..., Any]:
    """Return a verb that keeps its folder ``out`` to itself, so that two runs never mix there."""

    @functools.wraps(verb)
    def claimed_verb(**options: Any) -> Any:
        from workbench.files import claimed

        with claimed(options["out"]):
            return verb(**options)

    return claimed_verb
