"""Variables of a file by name, numbers, texts and structs of them, as columns and settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.matlab import MAX_DEPTH
from workbench.recordings.columns import Columns, titles
from workbench.recordings.formats.format import ReadOptions
from workbench.recordings.recording import Scalar

_MAX_LISTED_ITEMS = 1000
_MAX_LISTED = 16


@contextmanager
def taken_apart(
    path: Path, kind: str, damage: tuple[type[Exception], ...] = (Exception,)
) -> Iterator[None]:
    """Say in a sentence that a file cannot be taken apart.

    Args:
        kind: What the file is meant to be, such as ``a MATLAB file``.
        damage: What its reader raises then; by default anything, because damaged bytes may lead a
            reader anywhere.
    """
    try:
        yield
    except damage as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise WorkbenchError(
            f"{path.name} is truncated or not {kind} ({reason}); save or copy it again"
        ) from None


def flatten(name: str, value: Any, out: dict[str, Any], depth: int = 0) -> None:
    """Write structs out as ``struct.field``, and pairs of a name and data by their name.

    dSPACE writes them as ``Name`` and ``Data``, a scope of Simulink as ``label`` and ``values``.
    """
    if depth > MAX_DEPTH:
        return
    if isinstance(value, Mapping):
        title = next((value[k] for k in ("Name", "name", "label") if k in value), None)
        data = next((value[k] for k in ("Data", "data", "values") if k in value), None)
        if isinstance(title, str) and title and isinstance(data, np.ndarray):
            out[title] = data
            return
        for key, item in value.items():
            flatten(f"{name}.{key}", item, out, depth + 1)
    elif isinstance(value, list):
        for k, item in enumerate(value[:_MAX_LISTED_ITEMS]):
            flatten(f"{name}.{k + 1}", item, out, depth + 1)
    elif value is not None:
        out[name] = value


def in_seconds(name: str, values: npt.NDArray[Any]) -> tuple[str, npt.NDArray[Any]]:
    """Return instants in s from the first one and spans in s, named so; all else as it is."""
    if values.dtype.kind not in "mM" or not values.size:
        return name, values
    since = values - values.flat[0] if values.dtype.kind == "M" else values
    return f"{name} [s]", since / np.timedelta64(1, "s")


def _as_float(array: npt.NDArray[Any]) -> Vector:
    # Numbers of more than 64 bits may not fit; what overflows is taken for missing later.
    with np.errstate(over="ignore", invalid="ignore"):
        return array.astype(float)


def _sorted_out(flat: Mapping[str, Any]) -> tuple[dict[str, Vector], dict[str, Scalar], list[str]]:
    vectors: dict[str, Vector] = {}
    scalars: dict[str, Scalar] = {}
    odd: list[str] = []
    for name, value in flat.items():
        if isinstance(value, str):
            scalars[name] = value
            continue
        array = np.asarray(value)
        if array.dtype.kind not in "fiub" or array.size == 0 or array.ndim > 2:
            odd.append(name)
        elif array.size == 1:
            number = float(_as_float(array).ravel()[0])
            if np.isfinite(number):
                scalars[name] = number
        elif array.ndim == 1:
            vectors[name] = _as_float(array)
        else:
            columns = array if array.shape[0] >= array.shape[1] else array.T
            for k in range(columns.shape[1]):
                vectors[f"{name}_{k + 1}"] = _as_float(columns[:, k])
    return vectors, scalars, odd


def _with_time(flat: dict[str, Any], options: ReadOptions) -> dict[str, Any]:
    """Take the first column that all of several tables share for the time.

    So Simulink has signals, ``[t, u]`` and ``[t, y]``. Nothing else may be called a time.
    """
    tables = {
        name: value.T if value.shape[0] < value.shape[1] else value
        for name, value in flat.items()
        if isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "fiu"
    }
    if len(tables) < 2 or options.find_time(tuple(flat), ()) is not None:
        return flat
    first, *others = [table[:, 0] for table in tables.values()]
    if not all(np.array_equal(first, other) for other in others) or np.any(np.diff(first) <= 0.0):
        return flat
    return {"time": first} | flat | {name: np.squeeze(t[:, 1:]) for name, t in tables.items()}


def _time_base(vectors: Mapping[str, Vector], options: ReadOptions) -> int:
    """Return the length of the columns: that of the time, or the most frequent one."""
    index = options.find_time(tuple(vectors), ())
    if index is not None:
        return len(list(vectors.values())[index])
    lengths = [len(v) for v in vectors.values()]
    return max(set(lengths), key=lambda n: (lengths.count(n), n))


def _series(value: Any) -> tuple[Vector, Vector] | None:
    """Return the instants and values of a struct that holds both, as a time series does."""
    if not isinstance(value, Mapping):
        return None
    vectors = {
        key.lower(): item
        for key, item in value.items()
        if isinstance(item, np.ndarray) and item.dtype.kind in "fiub" and item.size > 1
    }
    instants = vectors.get("time", vectors.get("t"))
    values = vectors.get("data", vectors.get("values"))
    if instants is None or values is None:
        return None
    time, data = np.ravel(instants).astype(float), np.squeeze(values).astype(float)
    data = data.T if data.ndim == 2 and len(data) != len(time) else data
    if data.ndim > 2 or len(data) != len(time) or not np.isfinite(time).all():
        return None
    return time, data


def _with_series_joined(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Put time series, each with instants of its own, into columns over the instants of all."""
    series = {name: found for name, value in content.items() if (found := _series(value))}
    if not series:
        return content
    instants = np.concatenate([time for time, _ in series.values()])
    # What differs by rounding is one instant.
    fine = 1e-9 * np.ptp(instants) or 1.0
    counted, first = np.unique(np.round(instants / fine), return_index=True)
    columns: dict[str, Any] = {"time": instants[first]}
    for name, (time, data) in series.items():
        own = np.full((len(counted), *data.shape[1:]), np.nan)
        own[np.searchsorted(counted, np.round(time / fine))] = data
        columns[name] = own
    return columns | {k: v for k, v in content.items() if k not in series}


def columns_of_variables(path: Path, content: Mapping[str, Any], options: ReadOptions) -> Columns:
    """Sort the variables of a file into columns and settings.

    The vectors as long as the time become columns (those of the most frequent length if there is
    no time), a matrix one column per short side, time series share the instants of all, other
    structs are written out as ``struct.field`` where there are several, scalars, texts and short
    vectors of another length become settings.
    """
    flat: dict[str, Any] = {}
    while (
        len(inside := [v for v in content.values() if isinstance(v, Mapping)]) == 1
        and not any(isinstance(v, (np.ndarray, list)) and np.size(v) > 1 for v in content.values())
        and _series(inside[0]) is None
    ):
        # One struct or group around everything says nothing.
        content = {k: v for k, v in content.items() if v is not inside[0]} | dict(inside[0])
    for name, value in _with_series_joined(content).items():
        flatten(name, value, flat)
    vectors, scalars, odd = _sorted_out(_with_time(flat, options))
    if not vectors:
        raise WorkbenchError(
            f"{path.name} holds no vectors of numbers; it holds: {', '.join(flat) or 'nothing'}"
        )
    length = _time_base(vectors, options)
    headers = tuple(name for name, v in vectors.items() if len(v) == length)
    notes = []
    for name, v in vectors.items():
        if len(v) == length:
            continue
        text = f"variable {name!r} has {len(v)} samples instead of {length} and "
        if len(v) <= _MAX_LISTED and np.isfinite(v).all():
            scalars[name] = ", ".join(f"{x:g}" for x in v)
            notes.append(text + "became a setting")
        else:
            notes.append(text + "was left out")
    if odd:
        notes.append(f"left out, not columns of numbers: {', '.join(odd)}")
    values = np.column_stack([vectors[h] for h in headers])
    values[~np.isfinite(values)] = np.nan
    headers, _ = titles(headers, len(headers), options.columns, path.name)
    return Columns(headers, ("",) * len(headers), values, True, scalars, tuple(notes))
