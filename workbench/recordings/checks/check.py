"""One question to a recording, its answer, and the registry of all questions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from workbench.errors import check_choice
from workbench.recordings.checks.expected import Expected
from workbench.recordings.recording import Recording
from workbench.registry import Registry

Result = Literal["pass", "corrected", "unfit", "not checked"]
RESULTS: tuple[Result, ...] = ("pass", "corrected", "unfit", "not checked")

USUAL_FIX = "correct the file, or record again"

MAX_EXCLUDED = 0.2
"""Share of a signal that may be bridged before the recording is unfit to judge."""

MIN_SAMPLES = 20
"""Samples that a judgement needs at least."""


@dataclass(frozen=True)
class Finding:
    """The answer of a check.

    Args:
        result: ``pass``, ``corrected``, ``unfit``, or ``not checked`` where something is missing
            that would tell; the note says what.
        values: The numbers behind it, in SI.
        recording: The corrected recording; None if it is left as it is.
        doubt: Whether the note holds a suspicion that only a person or a diagnosis can decide.
    """

    result: Result
    note: str
    values: Mapping[str, Any] = field(default_factory=dict)
    recording: Recording | None = None
    name: str = ""
    doubt: bool = False

    def __post_init__(self) -> None:
        check_choice("result of a check", self.result, RESULTS)

    def __str__(self) -> str:
        return f"{self.name}: {self.result} ({self.note})"


@dataclass(frozen=True)
class Check:
    """A question to a recording.

    Args:
        order: Its place: one check makes the recording fit for those after it.
        foundation: Whether nothing after it is defined if the answer is ``unfit``.
    """

    name: str
    order: int
    judge: Callable[[Recording, Expected], Finding]
    foundation: bool = False
    fix: str = USUAL_FIX

    def __call__(self, recording: Recording, expected: Expected | None = None) -> Finding:
        """Answer the question; a correction is noted in the recording."""
        found = replace(self.judge(recording, expected or Expected()), name=self.name)
        if found.recording is None:
            return replace(found, recording=recording)
        return replace(found, recording=found.recording.noted(f"{self.name}: {found.note}"))


def check(
    name: str, order: int, *, foundation: bool = False, fix: str = USUAL_FIX
) -> Callable[[Callable[[Recording, Expected], Finding]], Check]:
    """Make a check of the function below, which answers the question; see `Check`."""
    return lambda judge: Check(name, order, judge, foundation, fix)


CHECKS = Registry(
    "check of a recording", Check, package="workbench.recordings.checks", group="workbench.checks"
)
