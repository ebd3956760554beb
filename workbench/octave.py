"""Variables of a text that Octave saves, which is what its ``save`` writes unless told otherwise.

Source: GNU Octave manual 8, section 14.1.3, and its sources ``ls-oct-text.cc``, ``ov-range.cc``.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

MARK = b"# Created by Octave"
"""What such a file begins with."""

_NAME = re.compile(r"^# name: (.*)$", re.MULTILINE)
_ABOUT = re.compile(r"^# ([\w ]+): ?(.*)$", re.MULTILINE)


def parse_octave_text(text: str) -> dict[str, Any]:
    r"""Return the variables by name: numbers without singleton dimensions, and texts.

    The fields of a struct stand beside the others; what is neither numbers nor text is left out.

    Raises:
        ValueError: If a variable has fewer or more numbers than it says.

    Example:
        >>> text = "# name: q\n# type: matrix\n# rows: 2\n# columns: 1\n 1\n 2\n"
        >>> parse_octave_text(text)
        {'q': array([1., 2.])}
    """
    _, *parts = _NAME.split(text)
    found: dict[str, Any] = {}
    for name, part in zip(parts[::2], parts[1::2], strict=True):
        about = dict(_ABOUT.findall(part))
        kind, words = about.get("type", ""), re.sub(r"^#.*$", "", part, flags=re.MULTILINE).split()
        if "string" in kind and "length" in about:
            found[name] = " ".join(words)
        elif "range" in kind:
            base, limit, step = (float(w) for w in words[:3])
            found[name] = base + step * np.arange(int((limit - base) / step * (1 + 1e-12)) + 1)
        elif re.search(r"matrix|scalar$|bool$", kind) and "complex" not in kind:
            shape = [int(about[key]) for key in ("rows", "columns") if key in about]
            if "ndims" in about:
                n = int(about["ndims"])
                shape, words = [int(w) for w in words[:n]], words[n:]
            numbers = np.array([float(w.replace("NA", "nan")) for w in words])
            numbers = np.diag(numbers) if "diagonal" in kind else numbers
            try:
                found[name] = np.squeeze(
                    numbers.reshape(shape, order="F" if "ndims" in about else "C")
                )
            except ValueError:
                raise ValueError(
                    f"variable {name!r} has {len(words)} numbers, not {shape}"
                ) from None
    return found
