"""HDF5 files, MATLAB files of version 7.3 among them: their datasets, as columns of variables."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from workbench.matlab import MAX_DEPTH
from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.variables import columns_of_variables, taken_apart

_UNITS = ("unit", "units", "Unit", "Units")


def is_hdf5(start: bytes) -> bool:
    """Tell by the first 520 bytes whether a file is HDF5, with or without MATLAB's user block."""
    return start.startswith(b"\x89HDF") or start[512:516] == b"\x89HDF"


def _text(value: Any) -> Any:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _datasets(group: Any, h5py: Any, depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield what a group holds by name, with its unit in brackets."""
    for key, value in group.attrs.items():
        if not key.startswith("MATLAB") and np.ndim(value) == 0:
            yield key, _text(value)
    for key in (k for k in group if not k.startswith("#")):
        item = group[key]
        if isinstance(item, h5py.Group):
            if depth < MAX_DEPTH:
                yield key, dict(_datasets(item, h5py, depth + 1))
            continue
        unit = next((str(_text(item.attrs[u])) for u in _UNITS if u in item.attrs), "")
        name = f"{key} [{unit}]" if unit else key
        if not isinstance(item, h5py.Dataset) or item.attrs.get("MATLAB_empty", 0):
            continue
        if item.dtype.names:
            data = item[()]
            yield name, {n: np.squeeze(data[n]) for n in item.dtype.names}
        elif item.attrs.get("MATLAB_class", b"") == b"char":
            yield name, "".join(chr(int(c)) for c in np.asarray(item[()]).T.ravel() if c)
        elif h5py.check_string_dtype(item.dtype) and item.shape == ():
            yield name, _text(item[()])
        elif item.dtype.kind in "fiub":
            # MATLAB stores columns first, HDF5 reports rows first.
            yield name, np.squeeze(np.asarray(item[()]).T)


def read_hdf5(path: Path, options: ReadOptions) -> Columns:
    """Read an HDF5 file: datasets, fields of compound ones, and attributes as settings.

    Groups are written out as ``group.dataset``; an attribute ``unit`` or ``units`` is the unit.
    """
    import h5py

    kind = "a MATLAB file" if path.suffix.lower() == ".mat" else "an HDF5 file"
    with taken_apart(path, kind), h5py.File(path, "r") as file:
        content = dict(_datasets(file, h5py))
    return columns_of_variables(path, content, options)


HDF5 = Format("hdf5", "HDF5", (".h5", ".hdf5", ".hdf", ".mat"), read_hdf5, recognises=is_hdf5)
