"""Counted work: what a computation takes, in units that no machine and no load changes.

Each process has one counter for each unit. Python adds to it with `count`, C code through the
`place` of the counter; `processes` adds up what other processes did.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np

Work = Mapping[str, int]
"""How much was done, by unit."""

UNITS = {
    "filtered_samples": "filtered samples",
    "integrator_steps": "integrator steps",
    "model_evaluations": "model evaluations",
    "solver_iterations": "solver iterations",
    "compilations": "compilations",
}
"""The units in words. Steps and evaluations are those of the explicit integrator, with the steps it
had to repeat, and of the filter; iterations are those of the solvers in predictive controllers."""

_PLACES = {unit: i for i, unit in enumerate(UNITS)}
_DONE = np.zeros(len(UNITS), dtype=np.int64)
_COUNTING = threading.Lock()


def count(unit: str, amount: int = 1) -> None:
    """Count work.

    Args:
        unit: One of `UNITS`.
    """
    with _COUNTING:
        _DONE[_PLACES[unit]] += amount


def place(unit: str) -> int:
    """Return where a counter stands in memory, for C code: the address of an ``int64_t``."""
    return int(_DONE.ctypes.data + _DONE.itemsize * _PLACES[unit])


def done() -> Work:
    """Return the work of this process until now, with what was added from others."""
    return dict(zip(UNITS, _DONE.tolist(), strict=True))


def since(before: Work) -> Work:
    """Return the work since an earlier `done`."""
    return {unit: amount - before.get(unit, 0) for unit, amount in done().items()}


def together(*parts: Work) -> Work:
    """Return the sum of work."""
    return {unit: sum(int(part.get(unit, 0)) for part in parts) for unit in UNITS}


def add(work: Work) -> None:
    """Add what another process did, or an earlier one whose results are used again."""
    for unit in UNITS:
        count(unit, int(work.get(unit, 0)))


def in_words(work: Work) -> str:
    """Return the work in one line.

    Example:
        >>> in_words({"filtered_samples": 1_234_567, "compilations": 3})
        '1.23 M filtered samples, 3 compilations'
    """
    said = [f"{_short(work[unit])} {words}" for unit, words in UNITS.items() if work.get(unit)]
    return ", ".join(said) or "nothing counted"


def _short(amount: int) -> str:
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if amount >= size:
            return f"{amount / size:.3g} {letter}"
    return str(amount)
