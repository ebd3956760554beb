"""What recordings tell of a machine before any law is tried, and the names of its parts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class RecordedFacts:
    """What is known of the recordings of a machine; nothing by default.

    Args:
        outputs: Names of the outputs that are recorded; all if None.
        duration: Length of the recordings, in s, for times at which something may have happened;
            0 if it is not known.
        sample_time: Sampling interval of the recordings, in s; 0 if it is not known.
        period: Period with which something repeats that nobody read, in s; 0 if nothing does.
        episode: From when to when most of what nobody read acts, in s; None if it always may.
        held: Whether only a loop can have held the machine, whose commands follow measurements.
        strides: How much of a command passes until something repeats, in its unit times s, by
            port, or how far a state goes, by its name; nothing repeats at others.
        ranges: Smallest and largest value along the recordings of ports and states, by name, and
            of differences of two states, in SI; of a sensor that stands at an end, that value
            twice.
    """

    outputs: tuple[str, ...] | None = None
    duration: float = 0.0
    sample_time: float = 0.0
    period: float = 0.0
    episode: tuple[float, float] | None = None
    held: bool = False
    strides: Mapping[str, float] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # A recording that is to be refused later may have no sensible time base.
        for name in ("duration", "sample_time"):
            if not 0.0 < getattr(self, name) < math.inf:
                object.__setattr__(self, name, 0.0)


NOTHING = RecordedFacts()
"""Where no recording is known."""


def argument_of(parameter: str) -> str:
    """Return the name under which the range of what a parameter multiplies is kept."""
    return f"argument of {parameter}"


def term_of(port: str, number: int) -> str:
    """Return the name under which the range of one term of a port's signal is kept."""
    return f"term {number} of {port}"


def end_of(port: str) -> str:
    """Return the name under which the end is kept at which a sensor was seen to stand."""
    return f"end of {port}"
