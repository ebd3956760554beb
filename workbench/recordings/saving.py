"""Write a recording as CSV that reads back without loss, or columns as people read them."""

from __future__ import annotations

import gzip
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError
from workbench.files import picked, write_whole
from workbench.model.units import from_si
from workbench.recordings.columns import Columns, without_giants
from workbench.recordings.formats.delimited_text import SAVED_MARK
from workbench.recordings.recording import ColumnMapping, MappedColumn, Recording, Signal, Span

_VERSION = 1
_SIGNAL = "name unit kind role display_unit"


def _description(recording: Recording, columns: list[str]) -> str:
    content = {
        "version": _VERSION,
        **picked(recording, "name source notes"),
        "metadata": dict(recording.metadata),
        "excluded": [asdict(span) for span in recording.excluded],
        "mapping": recording.mapping and asdict(recording.mapping),
        "signals": [
            {"column": column, **picked(s, _SIGNAL)}
            for column, s in zip(columns, recording.signals, strict=True)
        ],
    }
    return json.dumps(content, allow_nan=False)


def _column(signal: Signal) -> str:
    if not signal.unit or signal.unit == "1":
        return signal.name
    return _heading(signal.name, signal.unit)


def _heading(name: str, unit: str) -> str:
    # A unit with blanks or slashes stands in brackets, so that the header stays readable.
    if unit in ("", "1", "-"):
        return f"{name} [1]"
    return f"{name}_{unit}" if unit.isalpha() else f"{name} [{unit}]"


def csv_text(time: npt.ArrayLike, columns: Sequence[tuple[str, str, npt.ArrayLike]]) -> str:
    """Write time and signals in the units that people read, with a heading that says them.

    Args:
        time: Instants, shape (n,), in s.
        columns: Name, unit to write and values, shape (n,), in SI, of each signal.

    Example:
        >>> print(csv_text([0.0, 0.1], [("angle", "deg", [0.0, np.pi])]), end="")
        time_s,angle_deg
        0,0
        0.1,180
    """
    stream = io.StringIO()
    table = np.column_stack([time, *(from_si(np.asarray(v), unit) for _, unit, v in columns)])
    header = ",".join(["time_s", *(_heading(name, unit) for name, unit, _ in columns)])
    np.savetxt(stream, table, "%.9g", ",", header=header, comments="")
    return stream.getvalue()


def write_recording(recording: Recording, path: str | Path) -> Path:
    """Write a recording as CSV in SI; `read_recording` returns the same recording.

    Numbers are written with as many digits as they need to read back bit by bit. The file is
    written whole or not at all.

    Args:
        path: File to write; a name ending in ``.gz`` is compressed.
    """
    target = Path(path)
    columns = [_column(s) for s in recording.signals]
    try:
        description = _description(recording, columns)
    except (TypeError, ValueError) as error:
        raise WorkbenchError(
            f"metadata of recording {recording.name!r} cannot be written ({error}); keep to texts "
            "and finite numbers"
        ) from None
    table = np.column_stack([recording.time, *(s.values for s in recording.signals)])
    lines = [SAVED_MARK + description, ",".join(["time_s", *columns])]
    lines += [",".join("" if v != v else repr(v) for v in row) for row in table.tolist()]
    content = "\n".join([*lines, ""]).encode()
    return write_whole(target, gzip.compress(content) if target.suffix == ".gz" else content)


def restore_recording(columns: Columns, saved: Mapping[str, Any]) -> Recording:
    """Build a recording from a file that `write_recording` wrote."""
    columns = without_giants(columns)
    try:
        if saved["version"] != _VERSION:
            raise WorkbenchError(
                f"the recording was written in format {saved['version']!r}; this version reads "
                f"format {_VERSION}"
            )
        read = dict(zip(columns.headers, columns.values.T, strict=True))
        signals = tuple(
            Signal(values=read[s["column"]], **{key: s[key] for key in _SIGNAL.split()})
            for s in saved["signals"]
        )
        mapping = saved["mapping"]
        if mapping is not None:
            rows = tuple(MappedColumn(**row) for row in mapping["rows"])
            mapping = ColumnMapping(rows, tuple((column, why) for column, why in mapping["unused"]))
        return Recording(
            str(saved["name"]),
            read["time_s"],
            signals,
            str(saved["source"]),
            (*saved["notes"], *columns.notes),
            dict(saved["metadata"]),
            tuple(Span(**span) for span in saved["excluded"]),
            mapping,
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise WorkbenchError(
            f"the first line of the file describes another recording than its columns ({error}); "
            "delete that line to read the columns by their headers"
        ) from None
