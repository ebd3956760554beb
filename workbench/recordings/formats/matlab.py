"""MATLAB files of version 5 and 7.3: their variables, and columns of those.

Version 5 is written out here rather than left to SciPy because a damaged file must end in a
sentence: every size is compared with what is there before anything is read, while compiled readers
trust it. Version 7.3 is HDF5.

Source: MathWorks, MAT-File Format, level 5 (R2023b), chapter 1.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.errors import WorkbenchError
from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import Format, ReadOptions
from workbench.recordings.recording import Scalar

MAX_DEPTH = 8
_MAX_LISTED_ITEMS = 1000
_MAX_LISTED = 16


def is_hdf5(start: bytes) -> bool:
    """Tell by the first 520 bytes whether a file is HDF5, with or without MATLAB's user block."""
    return start.startswith(b"\x89HDF") or start[512:516] == b"\x89HDF"


def unreadable(path: Path, error: Exception) -> WorkbenchError:
    """Return the sentence for a file that cannot be taken apart."""
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    return WorkbenchError(
        f"{path.name} is truncated or not a MATLAB file ({reason}); save or copy it again"
    )


def _flat(name: str, value: Any, out: dict[str, Any], depth: int = 0) -> None:
    """Write structs out as ``struct.field``, and pairs of ``Name`` and ``Data`` by their name."""
    if depth > MAX_DEPTH:
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
        for k, item in enumerate(value[:_MAX_LISTED_ITEMS]):
            _flat(f"{name}.{k + 1}", item, out, depth + 1)
    elif value is not None:
        out[name] = value


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


def _time_base(vectors: Mapping[str, Vector], options: ReadOptions) -> int:
    """Return the length of the columns: that of the time, or the most frequent one."""
    empty = Columns(tuple(vectors), ("",) * len(vectors), np.empty((0, len(vectors))))
    index = options.find_time(empty)
    if index is not None:
        return len(list(vectors.values())[index])
    lengths = [len(v) for v in vectors.values()]
    return max(set(lengths), key=lambda n: (lengths.count(n), n))


def columns_of_variables(path: Path, content: Mapping[str, Any], options: ReadOptions) -> Columns:
    """Sort the variables of a file into columns and settings.

    The vectors as long as the time become columns (those of the most frequent length if there is
    no time), a matrix one column per short side, structs are written out as ``struct.field``,
    scalars, texts and short vectors of another length become settings.
    """
    flat: dict[str, Any] = {}
    for name, value in content.items():
        _flat(name, value, flat)
    vectors, scalars, odd = _sorted_out(flat)
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
    return Columns(headers, ("",) * len(headers), values, True, scalars, tuple(notes))


_NUMBERS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_MATRIX, _COMPRESSED, _UTF8, _UTF16, _UTF32 = 14, 15, 16, 17, 18
_CELL, _STRUCT, _OBJECT, _CHAR = 1, 2, 3, 4
_NUMERIC_CLASSES = range(6, 16)
_MAX_UNPACKED = 1 << 31
_MAX_ITEMS = 10_000


class Elements:
    """The elements of a stretch of bytes, one after the other.

    Args:
        order: ``<`` or ``>``, the order of bytes in numbers.
        depth: How deep in nested structs this stretch lies.

    Raises:
        ValueError: While reading, if an element claims more bytes than there are.
    """

    def __init__(self, data: memoryview, order: str, depth: int = 0) -> None:
        self.data, self.order, self.depth = data, order, depth
        self.position = 0

    def __iter__(self) -> Iterator[tuple[int, memoryview]]:
        while self.position < len(self.data):
            yield self.next()

    def next(self) -> tuple[int, memoryview]:
        """Return type and content of the next element."""
        start = self.position
        if start + 8 > len(self.data):
            raise ValueError("an element is cut off")
        kind, size = struct.unpack_from(self.order + "II", self.data, start)
        if kind >> 16:
            # Four bytes or fewer stand inside the tag.
            size, kind, begin = kind >> 16, kind & 0xFFFF, start + 4
            if size > 4:
                raise ValueError("a small element claims more than four bytes")
            self.position = start + 8
        else:
            begin = start + 8
            padding = 0 if kind == _COMPRESSED else -size % 8
            self.position = begin + size + padding
        if begin + size > len(self.data):
            raise ValueError(f"an element of {size} bytes is cut off")
        return kind, self.data[begin : begin + size]

    def numbers(self) -> npt.NDArray[Any]:
        """Return the next element as numbers, shape (n,), in the units of the file."""
        kind, body = self.next()
        if kind not in _NUMBERS:
            raise ValueError(f"element type {kind} stands where numbers must be")
        dtype = np.dtype(self.order + _NUMBERS[kind])
        if len(body) % dtype.itemsize:
            raise ValueError("an element ends inside a number")
        return np.frombuffer(body, dtype)

    def text(self) -> str:
        """Return the next element as text."""
        kind, body = self.next()
        codec = {_UTF16: "utf-16", _UTF32: "utf-32", 4: "utf-16"}.get(kind, "utf-8")
        if codec != "utf-8":
            codec += "-le" if self.order == "<" else "-be"
        return bytes(body).decode(codec, "replace").rstrip("\x00")


def _array(body: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """Return the name and the value of an array: numbers, text, dict, list or None."""
    if not len(body):
        return "", None
    if depth > MAX_DEPTH:
        raise ValueError("arrays are nested too deep")
    parts = Elements(body, order, depth)
    flags = parts.numbers()
    shape = parts.numbers()
    name = parts.text()
    if not len(flags) or not 2 <= len(shape) <= 32 or (shape < 0).any():
        raise ValueError(f"array {name!r} has no shape")
    kind = int(flags[0]) & 0xFF
    count = 1
    for n in shape.tolist():
        count *= int(n)
    if kind in _NUMERIC_CLASSES:
        values = parts.numbers()
        if len(values) != count:
            raise ValueError(f"array {name!r} has {len(values)} numbers instead of {count}")
        return name, np.squeeze(values.reshape(shape.tolist(), order="F"))
    if kind == _CHAR:
        return name, parts.text() if count else ""
    if kind == _CELL:
        if count > _MAX_ITEMS:
            raise ValueError(f"cell {name!r} claims {count} items")
        return name, [_item(parts) for _ in range(count)]
    if kind in (_STRUCT, _OBJECT):
        return name, _fields(parts, kind, count, name)
    return name, None


def _item(parts: Elements) -> Any:
    kind, body = parts.next()
    if kind != _MATRIX:
        raise ValueError(f"element type {kind} stands where an array must be")
    return _array(body, parts.order, parts.depth + 1)[1]


def _fields(parts: Elements, kind: int, count: int, name: str) -> Any:
    if kind == _OBJECT:
        parts.text()
    width = parts.numbers()
    _, names = parts.next()
    if not len(width) or width[0] < 1 or len(names) % int(width[0]):
        raise ValueError(f"struct {name!r} has no field names")
    size = int(width[0])
    fields = [
        bytes(names[k : k + size]).split(b"\x00")[0].decode("utf-8", "replace")
        for k in range(0, len(names), size)
    ]
    if count * len(fields) > _MAX_ITEMS:
        raise ValueError(f"struct {name!r} claims {count * len(fields)} fields")
    rows = [{field: _item(parts) for field in fields} for _ in range(count)]
    return rows[0] if count == 1 else rows


def parse_mat5(content: bytes) -> dict[str, Any]:
    """Return the variables of a MATLAB version 5 file.

    Returns:
        By name: numbers with singleton dimensions removed, texts, structs as dictionaries, arrays
        of structs and cells as lists; None for what is none of these (sparse, functions).

    Raises:
        ValueError: If the file is cut off, damaged or of another version.

    Example:
        >>> from io import BytesIO
        >>> from scipy.io import savemat
        >>> file = BytesIO()
        >>> savemat(file, {"q": [1.0, 2.0], "s": {"name": "axis"}})
        >>> parse_mat5(file.getvalue())
        {'q': array([1., 2.]), 's': {'name': 'axis'}}
    """
    mark = content[126:128]
    if len(content) < 128 or mark not in (b"IM", b"MI"):
        raise ValueError("the mark of version 5 is missing; version 4 is not read, use -v7")
    order = "<" if mark == b"IM" else ">"
    variables: dict[str, Any] = {}
    for kind, body in Elements(memoryview(content)[128:], order):
        if kind == _COMPRESSED:
            unpacker = zlib.decompressobj()
            try:
                unpacked = unpacker.decompress(bytes(body), _MAX_UNPACKED)
            except zlib.error as error:
                raise ValueError(f"a compressed variable is damaged ({error})") from None
            if not unpacker.eof:
                raise ValueError("a compressed variable is cut off")
            inside, array = Elements(memoryview(unpacked), order).next()
        else:
            inside, array = kind, body
        if inside != _MATRIX:
            raise ValueError(f"element type {inside} stands where a variable must be")
        name, value = _array(array, order, 0)
        # MATLAB keeps what belongs to functions and objects in a variable without a name.
        if name:
            variables[name] = value
    return variables


def read_mat_5(path: Path, options: ReadOptions) -> Columns:
    """Read a MATLAB file of version 5, see `columns_of_variables`."""
    content = path.read_bytes()
    # A damaged size may lead anywhere, memory included, so nothing narrower is safe.
    try:
        variables = parse_mat5(content)
    except Exception as error:  # noqa: BLE001
        raise unreadable(path, error) from None
    return columns_of_variables(path, variables, options)


MAT_5 = Format(
    "mat-5", "MATLAB 5", (".mat",), read_mat_5, recognises=lambda start: not is_hdf5(start)
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
