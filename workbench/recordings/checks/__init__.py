"""Is a recording fit to judge a model by? One file per question."""

from workbench.recordings.checks.check import CHECKS, Check, Finding
from workbench.recordings.checks.delay import estimate_delay
from workbench.recordings.checks.expected import Expected, expectations
from workbench.recordings.checks.report import CheckReport, check_recording

__all__ = [
    "CHECKS",
    "Check",
    "CheckReport",
    "Expected",
    "Finding",
    "check_recording",
    "estimate_delay",
    "expectations",
]
