"""Read, check and resample recordings of real machines."""

from workbench.recordings.case import read_case
from workbench.recordings.checks import CheckReport, check_recording
from workbench.recordings.mapping import read_mapping
from workbench.recordings.read import read_recording, read_table
from workbench.recordings.recording import Recording, Signal, Span
from workbench.recordings.resampling import resample
from workbench.recordings.saving import write_recording

__all__ = [
    "CheckReport",
    "Recording",
    "Signal",
    "Span",
    "check_recording",
    "read_case",
    "read_mapping",
    "read_recording",
    "read_table",
    "resample",
    "write_recording",
]
