"""Is a recording fit to judge a model by? One file per question."""

from workbench.recordings.checks.check import CHECKS, Check, Finding
from workbench.recordings.checks.delay import Delay, estimate_delay
from workbench.recordings.checks.excitation import Directions
from workbench.recordings.checks.expected import Expected, expectations
from workbench.recordings.checks.noise import NoiseFloor
from workbench.recordings.checks.report import CheckReport, check_recording

__all__ = [
    "CHECKS",
    "Check",
    "CheckReport",
    "Delay",
    "Directions",
    "Expected",
    "Finding",
    "NoiseFloor",
    "check_recording",
    "estimate_delay",
    "expectations",
]
