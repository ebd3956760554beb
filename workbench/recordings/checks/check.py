"""One check of a recording: its result, the reason and the numbers behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from workbench.errors import check_choice
from workbench.recordings.recording import Recording

Result = Literal["pass", "corrected", "unfit"]

MAX_EXCLUDED = 0.2
"""Share of a signal that may be excluded before the recording is unfit to judge."""


@dataclass(frozen=True)
class Check:
    """What one check found.

    Args:
        name: Name of the check, such as ``gaps``.
        result: ``pass``, ``corrected`` or ``unfit``.
        note: The reason or the finding, one clause or more.
        values: The numbers behind it, in SI, for reports and pictures.

    Raises:
        WorkbenchError: If the result is not one of the three.

    Example:
        >>> print(Check("gaps", "pass", "none"))
        gaps: pass (none)
    """

    name: str
    result: Result
    note: str
    values: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the result."""
        check_choice("result of a check", self.result, ("pass", "corrected", "unfit"))

    def __str__(self) -> str:
        return f"{self.name}: {self.result} ({self.note})"


@dataclass(frozen=True)
class Outcome:
    """A check and the recording as it leaves the check.

    Args:
        check: What was found.
        recording: The recording, corrected where the check corrects.
    """

    check: Check
    recording: Recording


def unchanged(
    recording: Recording,
    name: str,
    result: Result,
    note: str,
    values: Mapping[str, Any] | None = None,
) -> Outcome:
    """Return the outcome of a check that leaves the recording as it is.

    Args:
        recording: The recording.
        name: Name of the check.
        result: ``pass`` or ``unfit``.
        note: The reason or the finding.
        values: Numbers behind it, in SI.

    Example:
        >>> from workbench.recordings.example import example_recording
        >>> trial = example_recording(seconds=2.0)
        >>> print(unchanged(trial, "gaps", "pass", "none").check)
        gaps: pass (none)
    """
    return Outcome(Check(name, result, note, values or {}), recording)


def corrected(
    recording: Recording, name: str, note: str, values: Mapping[str, Any] | None = None
) -> Outcome:
    """Return the outcome of a check that corrected something, and note it in the recording.

    Args:
        recording: The corrected recording.
        name: Name of the check.
        note: What was corrected.
        values: Numbers behind it, in SI.

    Example:
        >>> from workbench.recordings.example import example_recording
        >>> trial = example_recording(seconds=2.0)
        >>> corrected(trial, "gaps", "filled").recording.notes
        ('gaps: filled',)
    """
    return Outcome(Check(name, "corrected", note, values or {}), recording.noted(f"{name}: {note}"))
