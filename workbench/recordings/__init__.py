"""Read, check and resample recordings of real machines."""

from workbench.recordings.case import Case, read_case
from workbench.recordings.checks import Check, CheckReport, Finding, check_recording
from workbench.recordings.mapping import ColumnRule, MappingRules, read_mapping
from workbench.recordings.read import Table, read_recording, read_table
from workbench.recordings.recording import ColumnMapping, MappedColumn, Recording, Signal, Span
from workbench.recordings.resampling import resample
from workbench.recordings.saving import write_recording

__all__ = [
    "Case",
    "Check",
    "CheckReport",
    "ColumnMapping",
    "ColumnRule",
    "Finding",
    "MappedColumn",
    "MappingRules",
    "Recording",
    "Signal",
    "Span",
    "Table",
    "check_recording",
    "read_case",
    "read_mapping",
    "read_recording",
    "read_table",
    "resample",
    "write_recording",
]
