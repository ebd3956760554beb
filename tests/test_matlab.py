"""The parser against SciPy, which reads the same format by other code."""

import struct
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from workbench.matlab import parse_mat5

CONTENT: dict[str, Any] = {
    "column": np.arange(5.0).reshape(-1, 1),
    "matrix": np.arange(12.0).reshape(3, 4),
    "cube": np.arange(24.0).reshape(2, 3, 4),
    "single": np.array([1.5, -2.5], dtype=np.float32),
    "counts": np.array([0, 200, 65535], dtype=np.uint16),
    "signed": np.array([-(2**40), 3], dtype=np.int64),
    "flag": np.array([True, False, True]),
    "scalar": 160.18,
    "text": "axis 1, 25 °C",
    "empty": np.zeros((0, 3)),
    "nested": {"gain": 2.0, "deep": {"time": np.arange(3.0)}, "label": "x"},
    "long_name_of_a_variable": np.float64(1e-300),
}


def written(compressed: bool) -> bytes:
    file = BytesIO()
    savemat(file, CONTENT, do_compression=compressed)
    return file.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
def test_same_as_scipy(compressed: bool) -> None:
    content = written(compressed)
    ours = parse_mat5(content)
    theirs = loadmat(BytesIO(content), squeeze_me=True)
    assert set(ours) == {k for k in theirs if not k.startswith("__")}
    for name in set(CONTENT) - {"text", "empty", "nested"}:
        assert np.array_equal(ours[name], theirs[name]), name
        assert np.shape(ours[name]) == np.shape(theirs[name]), name
    assert ours["empty"].size == theirs["empty"].size == 0
    assert ours["text"] == theirs["text"]
    assert ours["nested"]["label"] == "x"
    assert np.array_equal(ours["nested"]["deep"]["time"], np.arange(3.0))


def test_struct_array_and_cell() -> None:
    cell = np.empty(2, dtype=object)
    cell[:] = [np.arange(3.0), "second"]
    array = np.array([(1.0, "a"), (2.0, "b")], dtype=[("value", object), ("name", object)])
    file = BytesIO()
    savemat(file, {"cell": cell, "array": array})
    found = parse_mat5(file.getvalue())
    assert found["cell"][1] == "second"
    assert [row["name"] for row in found["array"]] == ["a", "b"]


def test_big_endian() -> None:
    name = b"q\x00\x00\x00"
    body = (
        struct.pack(">IIII", 6, 8, 6, 0)
        + struct.pack(">IIii", 5, 8, 2, 1)
        + struct.pack(">HH", 1, 1)
        + name
        + struct.pack(">IIdd", 9, 16, 1.5, -2.5)
    )
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00" + b"MI"
    found = parse_mat5(head + struct.pack(">II", 14, len(body)) + body)
    assert found["q"].tolist() == [1.5, -2.5]


@pytest.mark.parametrize("compressed", [False, True])
def test_every_truncation_is_noticed_or_complete(compressed: bool) -> None:
    content = written(compressed)
    whole = parse_mat5(content)
    for size in range(0, len(content), 7):
        try:
            found = parse_mat5(content[:size])
        except ValueError:
            continue
        # A cut between two variables leaves complete ones only.
        assert set(found) <= set(whole)


def test_claims_beyond_the_file() -> None:
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01" + b"IM"
    with pytest.raises(ValueError, match="cut off"):
        parse_mat5(head + struct.pack("<II", 14, 2**31))
