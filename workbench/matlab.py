"""Variables of a MATLAB file of version 5.

They are taken apart here rather than by SciPy because a damaged file must end in a sentence: every
size is compared with what is there before anything is read, while compiled readers trust it.

Source: MathWorks, MAT-File Format, level 5 (R2023b), chapter 1.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

_NUMBERS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_MATRIX, _COMPRESSED, _UTF8, _UTF16, _UTF32 = 14, 15, 16, 17, 18
_CELL, _STRUCT, _OBJECT, _CHAR = 1, 2, 3, 4
_NUMERIC_CLASSES = range(6, 16)
_MAX_UNPACKED = 1 << 31
_MAX_ITEMS = 10_000
MAX_DEPTH = 8
"""How deep structs may be nested."""


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
    count = math.prod(shape.tolist())
    if kind in _NUMERIC_CLASSES:
        values = parts.numbers()
        if len(values) != count:
            raise ValueError(f"array {name!r} has {len(values)} numbers instead of {count}")
        return name, np.squeeze(values.reshape(shape.tolist(), order="F"))
    if kind == _CHAR:
        text, rows = parts.text() if count else "", int(shape[0])
        # Of several lines the first letters stand before the second ones.
        return name, [text[k::rows].rstrip() for k in range(rows)] if 1 < rows <= count else text
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
    order = {b"\0\1IM": "<", b"\1\0MI": ">"}.get(content[124:128])
    if order is None:
        raise ValueError("it is not of version 5; use -v7")
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
