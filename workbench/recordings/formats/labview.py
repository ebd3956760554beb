"""LabVIEW measurement files (``.lvm``), which are text, and TDMS files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns
from workbench.recordings.formats.delimited_text import line_blocks, read_text, split_line
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.variables import columns_of_variables, in_seconds, taken_apart


def read_lvm(path: Path, options: ReadOptions) -> Columns:
    """Read the table of a measurement file, with the units and the sample time of its header.

    Source: NI, Specification for the LabVIEW Measurement File (.lvm).
    """
    found = read_text(path, options)
    told: dict[str, list[str]] = {}
    above = next(line_blocks(path, []), [])[:200]
    # "Separator" stands before the sign that it names.
    sign = next((line[9] for line in above if re.match(r"Separator[\t,;]", line)), "\t")
    for line in above:
        key, *cells = split_line(line, sign)
        told.setdefault(key, [c for c in cells if c])
    units = told.get("Y_Unit_Label", [])
    # The last column may be for comments, which have no unit.
    named = [h for h in found.headers if h.lower() != "comment"]
    first = len(named) - len(units)
    if units and first >= 0:
        rest = found.units[len(named) :]
        found = replace(found, units=(*found.units[:first], *units, *rest))
    if "X_Value" in found.headers and not np.isfinite(found.values[:, 0]).any():
        # The step is told in the header alone.
        found = replace(
            found, headers=found.headers[1:], units=found.units[1:], values=found.values[:, 1:]
        )
    headers = tuple("time" if h == "X_Value" else h for h in found.headers)
    step = told.get("Delta_X", [""])[0].replace(",", ".")
    metadata = dict(found.metadata)
    if options.find_time(headers, found.units) is None and step:
        metadata["sample_time_s"] = float(step)
    return replace(found, headers=headers, metadata=metadata)


LVM = Format("lvm", "LabVIEW", (".lvm",), read_lvm)


def read_tdms(path: Path, options: ReadOptions) -> Columns:
    """Read the channels of a TDMS file, with their units, and the time that its waveforms tell."""
    from nptdms import TdmsFile

    with taken_apart(path, "a TDMS file"):
        file = TdmsFile.read(path)
        channels = [c for group in file.groups() for c in group.channels()]
        content: dict[str, Any] = {
            k: v for k, v in file.properties.items() if isinstance(v, (str, int, float))
        }
        names = [c.name for c in channels]
        longest = max(channels, key=len, default=None)
        for c in channels:
            name = c.name if names.count(c.name) == 1 else f"{c.group_name}.{c.name}"
            unit = str(c.properties.get("unit_string", "")).strip()
            title, values = in_seconds(name, np.asarray(c[:]))
            content[f"{name} [{unit}]" if unit and title == name else title] = values
    if longest is None:
        raise WorkbenchError(f"{path.name} holds no channels")
    step = longest.properties.get("wf_increment", 0.0)
    if step and options.find_time(tuple(content), ()) is None:
        content = {"time [s]": step * np.arange(len(longest))} | content
    return columns_of_variables(path, content, options)


TDMS = Format("tdms", "TDMS", (".tdms",), read_tdms, extra="logs")
