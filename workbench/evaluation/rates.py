"""Shares with their 95 % intervals, and how often a finding is right that has a weight.

Units: fractions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

from workbench.display import aligned_table


@dataclass(frozen=True)
class Rate:
    """A share, ``count`` of ``total``, with its 95 % interval."""

    count: int
    total: int

    @classmethod
    def of(cls, flags: Iterable[bool]) -> Rate:
        """Return the share of flags that are set."""
        listed = list(flags)
        return cls(sum(listed), len(listed))

    @property
    def value(self) -> float:
        """The share; NaN out of none."""
        return self.count / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval; all shares out of none."""
        if self.total == 0:
            return 0.0, 1.0
        from scipy.stats import binomtest

        low, high = binomtest(self.count, self.total).proportion_ci(method="wilson")
        return float(low), float(high)

    def as_data(self) -> dict[str, Any]:
        """Return plain data."""
        low, high = self.interval
        return {
            "count": self.count,
            "of": self.total,
            "rate": None if not self.total else self.value,
            "low": low,
            "high": high,
        }

    def __str__(self) -> str:
        if not self.total:
            return "-"
        low, high = self.interval
        share = f"{100 * self.value:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"
        return f"{self.count}/{self.total} = {share}"


EDGES = (0.0, 0.5, 0.9, 0.99, 1.0)
"""Ends of the bins of weights."""


class Bin(NamedTuple):
    """Findings whose weight is within two ends: their mean weight, and how many are right."""

    low: float
    high: float
    mean: float
    right: Rate


def told(verdict: Mapping[str, Any], right: Iterable[str]) -> list[tuple[float, bool]]:
    """Return weight and truth of each named finding of a verdict.

    Args:
        verdict: A verdict as ``verdict.json`` has it.
        right: Names of the library that would be right.
    """
    names = set(right)
    return [
        (float(f["weight"]), bool(names & {f["effect"], *f["class"]}))
        for f in verdict.get("findings", ())
        if f.get("weight") is not None and f["effect"] not in (None, "nonparametric")
    ]


def reliability(findings: Sequence[tuple[float, bool]]) -> tuple[Bin, ...]:
    """Return the bins that hold findings.

    Args:
        findings: Weight of each, and whether it is right.

    Example:
        >>> [(b.mean, b.right.count) for b in reliability([(0.25, False), (1.0, True)])]
        [(0.25, 0), (1.0, 1)]
    """
    bins = []
    for low, high in pairwise(EDGES):
        own = [(w, right) for w, right in findings if low < w <= high or w == low == 0.0]
        if own:
            mean = sum(w for w, _ in own) / len(own)
            bins.append(Bin(low, high, mean, Rate(sum(right for _, right in own), len(own))))
    return tuple(bins)


def reliability_lines(findings: Sequence[tuple[float, bool]]) -> list[str]:
    """Return the table as lines of text; none without a finding that was weighed."""
    bins = reliability(findings)
    if not bins:
        return []
    rows = [(f"{b.low:g} to {b.high:g}", f"{b.mean:.2f}", b.right) for b in bins]
    head = ("weight of a finding", "mean", "right name or class")
    return aligned_table(head, rows, width=None).splitlines()
