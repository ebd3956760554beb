"""Read MATLAB files, version 5 and 7.3: vectors become columns, scalars become settings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns
from workbench.recordings.mat5_format import parse_mat5
from workbench.recordings.recording import Scalar

_MAX_DEPTH = 8
_MAX_ITEMS = 1000


def _load_v73(path: Path) -> dict[str, Any]:
    import h5py

    def value(item: Any, depth: int) -> Any:
        if isinstance(item, h5py.Group):
            if depth > _MAX_DEPTH:
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


def _flat(name: str, value: Any, out: dict[str, Any], depth: int = 0) -> None:
    """Write structs out as ``struct.field``, and pairs of ``Name`` and ``Data`` by their name."""
    if depth > _MAX_DEPTH:
        return
    if isinstance(value, Mapping):
        title = value.get("Name", value.get("name"))
        data = value.get("Data", value.get("data"))
        if isinstance(title, str) and title and isinstance(data, np.ndarray):
            out[title] = data
            return
        for key, item in value.items():
            _flat(f"{name}.{key}", item, out, depth + 1)
    elif isinstance(value, list):
        for k, item in enumerate(value[:_MAX_ITEMS]):
            _flat(f"{name}.{k + 1}", item, out, depth + 1)
    elif value is not None:
        out[name] = value


def _as_float(array: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    # Numbers of more than 64 bits may not fit; what overflows is taken for missing later.
    with np.errstate(over="ignore", invalid="ignore"):
        return array.astype(float)


def _sorted_out(
    flat: Mapping[str, Any],
) -> tuple[dict[str, npt.NDArray[np.float64]], dict[str, Scalar], list[str]]:
    vectors: dict[str, npt.NDArray[np.float64]] = {}
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


def read_mat(path: str | Path) -> Columns:
    """Read a MATLAB file.

    The vectors of the most frequent length become columns, a matrix one column per short side,
    structs are written out as ``struct.field``, scalars and texts become settings.

    Args:
        path: File of version 5 (or older) or 7.3.

    Returns:
        The columns with notes on what was left out.

    Raises:
        WorkbenchError: If the file is truncated, damaged or holds no vectors.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "trial.mat"
        >>> from scipy.io import savemat
        >>> savemat(file, {"t": np.arange(5.0), "q": np.ones(5), "kp": 160.18})
        >>> columns = read_mat(file)
        >>> columns.headers, columns.metadata
        (('t', 'q'), {'kp': 160.18})
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            start = stream.read(520)
            hdf5 = start.startswith(b"\x89HDF") or start[512:516] == b"\x89HDF"
            rest = b"" if hdf5 else stream.read()
    except OSError as error:
        raise WorkbenchError(f"{file} cannot be read: {error.strerror or error}") from None
    try:
        content = _load_v73(file) if hdf5 else parse_mat5(start + rest)
    # HDF5 raises whatever the damaged bytes lead it into, so nothing narrower is safe.
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise WorkbenchError(
            f"{file.name} is truncated or not a MATLAB file ({reason}); save or copy it again"
        ) from None
    flat: dict[str, Any] = {}
    for name, value in content.items():
        _flat(name, value, flat)
    vectors, scalars, odd = _sorted_out(flat)
    if not vectors:
        raise WorkbenchError(
            f"{file.name} holds no vectors of numbers; it holds: {', '.join(flat) or 'nothing'}"
        )
    lengths = [len(v) for v in vectors.values()]
    length = max(set(lengths), key=lambda n: (lengths.count(n), n))
    headers = tuple(name for name, v in vectors.items() if len(v) == length)
    notes = [
        f"variable {name!r} has {len(v)} samples instead of {length} and was left out"
        for name, v in vectors.items()
        if len(v) != length
    ]
    if odd:
        notes.append(f"left out, not columns of numbers: {', '.join(odd)}")
    values = np.column_stack([vectors[h] for h in headers])
    values[~np.isfinite(values)] = np.nan
    return Columns(headers, ("",) * len(headers), values, True, scalars, tuple(notes))
