"""Times of several ways of doing the same, their ratios with spread, and figures to reach."""

from __future__ import annotations

import importlib
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.files import picked

REPEATS = 3


@dataclass(frozen=True)
class Times:
    """Several times of the same work.

    Args:
        seconds: Processor time per unit of work, in s.
    """

    seconds: tuple[float, ...]
    result: Any = field(default=None, repr=False, compare=False)

    @property
    def median(self) -> float:
        """The time in the middle, in s."""
        return float(np.median(self.seconds))

    def over(self, other: Times) -> tuple[float, float, float]:
        """Return how many times longer it took than another: least, median, most; ratios."""
        return (
            min(self.seconds) / max(other.seconds),
            self.median / other.median,
            max(self.seconds) / min(other.seconds),
        )


def timed(
    work: Callable[[], object], *, per: float = 1.0, repeats: int = REPEATS, warm: bool = False
) -> Times:
    """Time work, in processor time: others on the machine count little.

    Args:
        per: Units of work in one call (dimensionless).
        warm: Whether a first call, which builds what is built once, is not counted.
    """
    if warm:
        work()
    found, result = [], None
    for _ in range(repeats):
        began = time.process_time()
        result = work()
        found.append(max(time.process_time() - began, 1e-9) / per)
    return Times(tuple(found), result)


@dataclass(frozen=True)
class Way:
    """One way of doing what a comparison compares.

    Args:
        times: Time per unit of work; None if it could not be done here.
        error: How far its result is from the reference, in the unit that the comparison says;
            NaN if that means nothing.
    """

    name: str
    times: Times | None
    error: float = float("nan")
    remark: str = ""


@dataclass(frozen=True)
class Comparison:
    """Several ways of doing the same, the first of them the workbench's.

    Args:
        work: Unit of work, in words: the time is that of one.
    """

    name: str
    title: str
    work: str
    error: str
    ways: tuple[Way, ...]
    note: str = ""

    def ratio(self, name: str) -> tuple[float, float, float]:
        """Return how many times longer a way took than the first: least, median, most; ratios.

        Returns:
            The three ratios; NaN where it could not be done.
        """
        ours, theirs = self.ways[0].times, next(w.times for w in self.ways if w.name == name)
        if ours is None or theirs is None:
            return (float("nan"),) * 3
        return theirs.over(ours)

    def table(self) -> dict[str, Any]:
        """Return it as plain numbers and words."""
        return {
            **picked(self, "title work error note"),
            "ways": [
                {"seconds": list(w.times.seconds) if w.times else None}
                | {"ratio": list(self.ratio(w.name)), **picked(w, "name error remark")}
                for w in self.ways
            ],
        }


@dataclass(frozen=True)
class Figure:
    """A figure to reach.

    Args:
        value: The figure, in ``unit``.
        unit: Its unit; ``x`` for a ratio.
        reach: The figure to reach, in ``unit``.
        breakdown: What it consists of, or which limit stands in the way.
    """

    what: str
    value: float
    unit: str
    reach: float
    larger_is_better: bool = True
    breakdown: str = ""

    @property
    def reached(self) -> bool | None:
        """Whether the figure is reached; None if it could not be measured."""
        if np.isnan(self.value):
            return None
        return self.value >= self.reach if self.larger_is_better else self.value <= self.reach

    @property
    def bound(self) -> str:
        """What is to be reached, in words, without its unit."""
        return f"{'at least' if self.larger_is_better else 'at most'} {self.reach:g}"


def tried(name: str, package: str, measure: Callable[[Any], Way]) -> Way:
    """Let a package that may not be installed do it."""
    try:
        with warnings.catch_warnings():
            # Some tell at import which of their optional parts are not there.
            warnings.simplefilter("ignore")
            module = importlib.import_module(package)
    except ImportError:
        return Way(name, None, remark="not installed; the extra 'benchmark' has it")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return measure(module)
    except Exception as error:  # noqa: BLE001
        # A peer that fails is a line of the table, not the end of the benchmark.
        return Way(name, None, remark=f"failed: {str(error).strip()[:120]}")
