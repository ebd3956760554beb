"""Ways in which files get damaged, by a seed."""

from __future__ import annotations

import copy
import json
import random
from typing import Any

import numpy as np


def flip_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Overwrite some bytes with random ones."""
    data = bytearray(content)
    for position in rng.integers(0, len(data), rng.integers(1, 20)):
        data[position] = int(rng.integers(0, 256))
    return bytes(data)


def truncate(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut the file off somewhere."""
    return content[: int(rng.integers(0, len(content)))]


def cut_piece(content: bytes, rng: np.random.Generator) -> bytes:
    """Take a piece out of the middle."""
    a, b = sorted(rng.integers(0, len(content), 2))
    return content[:a] + content[b:]


def repeat_piece(content: bytes, rng: np.random.Generator) -> bytes:
    """Write a piece twice."""
    a, b = sorted(rng.integers(0, len(content), 2))
    return content[:b] + content[a:b] + content[b:]


def shuffle_lines(content: bytes, rng: np.random.Generator) -> bytes:
    """Exchange lines."""
    lines = content.split(b"\n")
    for _ in range(int(rng.integers(1, 10))):
        a, b = rng.integers(0, len(lines), 2)
        lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


WORDS = (
    b"", b"NaN", b"inf", b"-1e999", b"1e400", b"1e305", b"-1e160", b"error",
    b"#REF!", b"1,5", b"1.2.3",
    b'"', b"'", b";", b",", b"\t", b"\x00", b"\xff\xfe", "µ°".encode(), b"0x1F", b"1_000", b"--",
    b"{", b"]", b"null", b"9" * 400, b"# time_s", b"\r", b"\r\n\r\n", b"true",
)  # fmt: skip


def replace_cells(content: bytes, rng: np.random.Generator) -> bytes:
    """Replace some cells by what does not belong there."""
    lines = content.split(b"\n")
    for _ in range(int(rng.integers(1, 30))):
        k = int(rng.integers(0, len(lines)))
        cells = lines[k].split(b",")
        cells[int(rng.integers(0, len(cells)))] = WORDS[int(rng.integers(0, len(WORDS)))]
        lines[k] = b",".join(cells)
    return b"\n".join(lines)


BINARY = (flip_bytes, truncate, cut_piece, repeat_piece)
TEXT = (*BINARY, shuffle_lines, replace_cells)


def damaged(content: bytes, seed: int, *, text: bool) -> bytes:
    """Damage a file in one to three of these ways."""
    rng = np.random.default_rng(seed)
    ways = TEXT if text else BINARY
    for _ in range(int(rng.integers(1, 4))):
        if len(content) < 2:
            break
        content = ways[int(rng.integers(0, len(ways)))](content, rng)
    return content


VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1.5, 1e300, 10**400, float("nan"), float("inf"), "", "x", "\ud800", [], {},
    [[]], [1, "a"], {"a": 1}, {"a": {"b": [None]}}, "../x", "verdict.json", "-2 s", "3 furlongs",
)  # fmt: skip
"""What stands where something else belongs."""

LITERALS = (
    "true", "-1", "0", "1.5", "1e300", "1e999", "nan", "inf", '""', '"x"', "[]", "{}", "[[]]",
    '[1, "a"]', "{ a = 1 }", "{ a = { b = [1] } }", '"../x"', '"-2 s"', '"3 furlongs"', "07:32:00",
    "1979-05-27", "9" * 40, "[" * 3000 + "]" * 3000, "'''\n'''", "[inf, nan]", '"nowhere:thing"',
)  # fmt: skip
"""The same in TOML, with what it has beside."""

STRANGE = ("x", "", "\n", "../x", "a" * 300)


def places(table: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the keys and indices of everything in a table."""
    if not isinstance(table, (dict, list)) or not table:
        return [place]
    items = table.items() if isinstance(table, dict) else enumerate(table)
    return [place, *(p for key, value in items for p in places(value, (*place, key)))]


def damaged_json(content: bytes, seed: int) -> bytes:
    """Replace, remove or rename one entry; cut the file now and then."""
    rng = random.Random(seed)
    if rng.random() < 0.1:
        return damaged(content, seed, text=True)
    changed: Any = json.loads(content)
    for _ in range(rng.choice((1, 1, 2))):
        every = places(changed)[1:]
        if not every:
            break
        place = rng.choice(every)
        inner: Any = changed
        for key in place[:-1]:
            inner = inner[key]
        way = rng.random()
        if way < 0.8:
            inner[place[-1]] = copy.deepcopy(rng.choice(VALUES))
        elif way < 0.9 or isinstance(inner, list):
            del inner[place[-1]]
        else:
            inner[rng.choice(STRANGE)] = inner.pop(place[-1])
    text = json.dumps(changed)
    return (text[: rng.randrange(len(text))] if rng.random() < 0.05 else text).encode()


def damaged_toml(content: bytes, seed: int) -> bytes:
    """Replace values, remove, rename and repeat lines."""
    rng = random.Random(seed)
    if rng.random() < 0.1:
        return damaged(content, seed, text=True)
    lines = content.decode().split("\n")
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        full = [i for i, line in enumerate(lines) if line.strip() and line[0] not in "# "]
        if not full:
            break
        i, way = rng.choice(full), rng.random()
        key, sign, _value = lines[i].partition(" = ")
        if way < 0.7 and sign:
            lines[i] = f"{key} = {rng.choice(LITERALS)}"
        elif way < 0.8:
            del lines[i]
        elif way < 0.9:
            lines[i] = lines[i].replace(key.strip("[]"), rng.choice(("x", "a.b", '"*"', "name")))
        else:
            lines.insert(rng.randrange(len(lines)), lines[i])
    return "\n".join(lines).encode()
