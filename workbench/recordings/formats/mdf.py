"""MDF files, as measuring and calibration systems of vehicles and test benches write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.variables import columns_of_variables, taken_apart


def read_mdf(path: Path, options: ReadOptions) -> Columns:
    """Read the channels of an MDF file, with their units, at the instants of the longest one."""
    from asammdf import MDF

    with taken_apart(path, "an MDF file"), MDF(path) as file:
        channels = [c for c in file.iter_channels() if c.samples.dtype.kind in "fiub"]
    longest = max(channels, key=len, default=None)
    if longest is None:
        raise WorkbenchError(f"{path.name} holds no channels")
    names = [c.name for c in channels]
    content: dict[str, Any] = {"time [s]": longest.timestamps}
    for c in channels:
        name = c.name if names.count(c.name) == 1 else f"{c.group_index}.{c.name}"
        same = np.array_equal(c.timestamps, longest.timestamps)
        read = c if same else c.interp(longest.timestamps)
        content[f"{name} [{c.unit}]" if c.unit else name] = read.samples
    return columns_of_variables(path, content, options)


MDF_FILE = Format("mdf", "MDF", (".mf4", ".mdf"), read_mdf, extra="mdf")
