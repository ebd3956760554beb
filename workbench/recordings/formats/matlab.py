"""MATLAB files of version 5, and the texts of Octave that end as they do.

Version 7.3 is HDF5, see `workbench.recordings.formats.hdf5`.
"""

from __future__ import annotations

from pathlib import Path

from workbench.matlab import parse_mat5
from workbench.octave import MARK, parse_octave_text
from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.hdf5 import is_hdf5
from workbench.recordings.formats.variables import columns_of_variables, taken_apart


def read_mat_5(path: Path, options: ReadOptions) -> Columns:
    """Read a MATLAB file of version 5, see `columns_of_variables`."""
    content = path.read_bytes()
    with taken_apart(path, "a MATLAB file"):
        variables = parse_mat5(content)
    return columns_of_variables(path, variables, options)


def read_octave_text(path: Path, options: ReadOptions) -> Columns:
    """Read a text that Octave saved, see `columns_of_variables`."""
    with taken_apart(path, "a text of Octave", (ValueError,)):
        variables = parse_octave_text(path.read_text(encoding="utf-8", errors="replace"))
    return columns_of_variables(path, variables, options)


def _is_mat_5(start: bytes) -> bool:
    return not is_hdf5(start) and not start.startswith(MARK)


MAT_5 = Format("mat-5", "MATLAB 5", (".mat",), read_mat_5, recognises=_is_mat_5)
OCTAVE_TEXT = Format(
    "octave-text", "Octave", (".mat",), read_octave_text, lambda start: start.startswith(MARK)
)
