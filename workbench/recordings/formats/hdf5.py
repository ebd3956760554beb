"""MATLAB files of version 7.3, which are HDF5 files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.matlab_variables import (
    MAX_DEPTH,
    columns_of_variables,
    is_hdf5,
    unreadable,
)


def _variables(path: Path) -> dict[str, Any]:
    import h5py

    def value(item: Any, depth: int) -> Any:
        if isinstance(item, h5py.Group):
            if depth > MAX_DEPTH:
                return None
            return {k: value(item[k], depth + 1) for k in item if not k.startswith("#")}
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiub":
            return None
        if item.attrs.get("MATLAB_empty", 0):
            return None
        data = np.asarray(item[()])
        if item.attrs.get("MATLAB_class", b"") == b"char":
            return "".join(chr(int(c)) for c in data.T.ravel() if c)
        # MATLAB stores columns first, HDF5 reports rows first.
        return np.squeeze(data.T)

    with h5py.File(path, "r") as file:
        return {k: value(file[k], 0) for k in file if not k.startswith("#")}


def read_mat_73(path: Path, options: ReadOptions) -> Columns:
    """Read a MATLAB file of version 7.3, see `columns_of_variables`."""
    # HDF5 raises whatever the damaged bytes lead it into, so nothing narrower is safe.
    try:
        content = _variables(path)
    except ImportError:
        raise
    except Exception as error:  # noqa: BLE001
        raise unreadable(path, error) from None
    return columns_of_variables(path, content, options)


MAT_73 = Format("mat-7.3", "MATLAB 7.3", (".mat",), read_mat_73, recognises=is_hdf5)
