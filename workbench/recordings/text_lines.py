"""Read the lines of a text file in blocks: plain or gzip, any encoding, as far as it goes."""

from __future__ import annotations

import codecs
import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path

from workbench.errors import WorkbenchError

_PIECE = 1 << 16
_BLOCK = 1 << 22
_MAX_LINE = 1 << 20
_MARKS = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))


def guess_encoding(start: bytes, source: str) -> str:
    r"""Guess the encoding of a text from its first bytes.

    Args:
        start: The first bytes.
        source: Name of the file, for messages.

    Returns:
        Name of a codec; ``latin-1`` for what is not UTF-8, because it reads any byte.

    Raises:
        WorkbenchError: If it is no text.

    Example:
        >>> guess_encoding(b"time_s,angle_deg", "a.csv"), guess_encoding(b"winkel [\xb0]    ", "a")
        ('utf-8', 'latin-1')
    """
    for mark, name in _MARKS:
        if start.startswith(mark):
            return name
    if b"\x00" in start:
        raise WorkbenchError(
            f"{source} is not a text file; recordings are CSV, MATLAB .mat, Parquet or JSON"
        )
    try:
        # The last bytes may be half a character.
        start[: max(0, len(start) - 4)].decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def _pieces(path: Path, cut: list[str]) -> Iterator[bytes]:
    """Yield the bytes of a file, unpacked; stop where a compressed file breaks off."""
    with path.open("rb") as plain:
        packed = plain.read(2) == b"\x1f\x8b"
        plain.seek(0)
        if not packed:
            while piece := plain.read(_PIECE):
                yield piece
            return
        with gzip.open(plain, "rb") as unpacked:
            while True:
                try:
                    piece = unpacked.read1(_PIECE)
                except (EOFError, OSError, zlib.error):
                    cut.append(
                        "the compressed file is damaged from some point on; what came before was "
                        "read"
                    )
                    return
                if not piece:
                    return
                yield piece


def line_blocks(path: Path, cut: list[str]) -> Iterator[list[str]]:
    r"""Yield the lines of a text file in blocks of about 4 MB.

    Args:
        path: The file, plain or gzip.
        cut: Gets a note if a compressed file breaks off.

    Yields:
        Lines without their ends.

    Raises:
        WorkbenchError: If the file is no text or has a line of more than a million characters.
        OSError: If the file cannot be opened.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "a.csv"
        >>> _ = file.write_bytes(b"a,b\r\n1,2\r\n")
        >>> list(line_blocks(file, []))
        [['a,b', '1,2']]
    """
    decoder: codecs.IncrementalDecoder | None = None
    waiting: list[str] = []
    size, rest = 0, ""
    for piece in _pieces(path, cut):
        if decoder is None:
            decoder = codecs.getincrementaldecoder(guess_encoding(piece, path.name))("replace")
        text = decoder.decode(piece)
        waiting.append(text)
        size += len(text)
        if size < _BLOCK:
            continue
        lines, rest = _split(rest + "".join(waiting))
        waiting, size = [], 0
        if len(rest) > _MAX_LINE or any(len(line) > _MAX_LINE for line in lines):
            raise WorkbenchError(
                f"{path.name} has a line of more than {_MAX_LINE} characters; it is not a table of "
                "numbers"
            )
        yield lines
    lines, rest = _split(rest + "".join(waiting))
    if rest.rstrip("\r"):
        lines.append(rest.rstrip("\r"))
    if any(len(line) > _MAX_LINE for line in lines):
        raise WorkbenchError(f"{path.name} has a line too long for a table of numbers")
    if lines:
        yield lines


def _split(text: str) -> tuple[list[str], str]:
    """Split into complete lines and the rest; a carriage return at the end may be half an end."""
    if "\r" in text:
        half = "\r" if text.endswith("\r") else ""
        text = text[: len(text) - len(half)].replace("\r\n", "\n").replace("\r", "\n") + half
    lines = text.split("\n")
    return lines[:-1], lines[-1]
