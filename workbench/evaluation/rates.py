"""Shares with their 95 % intervals.

Units: fractions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any


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
        share, n, z = self.value, float(self.total), 1.959964
        middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
        half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
        return max(0.0, middle - half), min(1.0, middle + half)

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
