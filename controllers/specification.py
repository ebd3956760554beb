"""Numbers of a specification, each with what is valid of it beside its default value."""

from __future__ import annotations

from dataclasses import field, fields
from typing import Any

from workbench.errors import check_range


def number(default: Any, lower: float, upper: float, unit: str = "", words: str = "") -> Any:
    """Return a field of a `Checked` dataclass, whose value lies in a range, in a unit.

    Args:
        default: Its default value, in ``unit``; `dataclasses.MISSING` for none.
        lower: Smallest valid value, in ``unit``.
        upper: Largest valid value, in ``unit``.
        words: What the number is, as the user knows it; by default its name.
    """
    return field(default=default, metadata={"range": (words, lower, upper, unit)})


class Checked:
    """A dataclass whose numbers are checked against their ranges when it is made."""

    def __post_init__(self) -> None:
        for own in fields(self):  # type: ignore[arg-type]
            if "range" in own.metadata:
                words, *ends = own.metadata["range"]
                check_range(words or own.name.replace("_", " "), getattr(self, own.name), *ends)

    def in_samples(self, name: str, sample_time: float) -> None:
        """Round a time to whole samples, at least one, both in s."""
        time = getattr(self, name)
        samples = max(1, round(time / sample_time)) * sample_time
        if abs(samples - time) > _ROUNDED * time:
            object.__setattr__(self, name, samples)


_ROUNDED = 1e-9
"""Difference of a time from whole samples, over it, that is none."""
