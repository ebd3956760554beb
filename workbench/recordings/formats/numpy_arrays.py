"""NumPy files: arrays by name (``.npz``), or one table or structured array (``.npy``)."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns, titles
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.formats.variables import columns_of_variables, in_seconds


def _content(path: Path) -> Any:
    """Return a mapping from names to arrays, or one array; instants in s from the first one."""
    try:
        found = np.load(path, allow_pickle=False)
        return found if isinstance(found, np.ndarray) else dict(found.items())
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, KeyError) as error:
        reason = " ".join(str(error).split())[:120]
        raise WorkbenchError(
            f"{path.name} is truncated or holds more than arrays of numbers ({reason}); write it"
            " with numpy.savez(file, time=..., ...)"
        ) from None


def read_numpy(path: Path, options: ReadOptions) -> Columns:
    """Read arrays by name, see `columns_of_variables`, or the columns of one array.

    The columns of an array without names are named by ``columns`` of a mapping.
    """
    content = _content(path)
    if isinstance(content, np.ndarray) and content.dtype.names is None:
        if content.ndim != 2 or content.dtype.kind not in "fiub":
            raise WorkbenchError(
                f"{path.name} holds an array of shape {content.shape} of {content.dtype}; a"
                " recording is a table of numbers, one row per sample"
            )
        table = content if len(content) >= content.shape[1] else content.T
        headers, named = titles((), table.shape[1], options.columns, path.name)
        values = np.where(np.isfinite(table), table, np.nan).astype(float)
        return Columns(headers, ("",) * len(headers), values, named)
    names = content.dtype.names if isinstance(content, np.ndarray) else content
    variables: dict[str, Any] = {}
    for name in names:
        value = content[name]
        if value.dtype.names:
            variables[name] = dict(in_seconds(n, value[n]) for n in value.dtype.names)
        else:
            title, numbers = in_seconds(name, value)
            variables[title] = str(value) if value.dtype.kind == "U" and not value.ndim else numbers
    return columns_of_variables(path, variables, options)


NUMPY = Format("numpy", "NumPy", (".npz", ".npy"), read_numpy)
