"""Ways in which files get damaged, by a seed."""

from __future__ import annotations

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
