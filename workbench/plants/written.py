"""Linear plants that are written in one line, ``2 exp(-0.1 s) / (s + 1)``, or kept by MATLAB."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import WorkbenchError
from workbench.matlab import parse_mat5
from workbench.model.transfer_text import system_of_text
from workbench.octave import MARK, parse_octave_text
from workbench.plants.plant import Plant, linear_plant

_VARIABLE = re.compile(r"(?<![A-Za-z_.])s(?![A-Za-z_])")


def is_written(name: str) -> bool:
    """Tell whether the name of a plant is a transfer function.

    Example:
        >>> is_written("1/(s + 1)"), is_written("servo-axis"), is_written("my_plants:s")
        (True, False, False)
    """
    said = _VARIABLE.search(name) and re.search(r"[-+*/^]", name)
    return ":" not in name and bool(said or re.search(r"[(^]", name))


def plant_of_text(text: str) -> Plant:
    """Return a transfer function, or a matrix of them, as a plant; see `system_of_text`.

    Raises:
        WorkbenchError: If it is none, says where; or it differentiates, or runs ahead of time.

    Example:
        >>> model = plant_of_text("2 / (s (0.5 s + 1))").model({"limit": 5.0})
        >>> [(q.name, q.upper) for q in model.inputs], [q.name for q in model.outputs]
        ([('u', 5.0)], ['y'])
    """
    return linear_plant(text, system_of_text(text), f"G(s) = {text}")


def plant_of_matlab(path: Path) -> Plant:
    """Return the plant that a MATLAB file keeps: ``A, B, C, D`` or ``num, den``.

    They stand in the file as variables or as the fields of one struct, such as that of
    ``s = get(sys)``, with its sample time, delay and names of signals if it has them;
    ``workbench linearise --out model.mat`` writes such a file.

    Raises:
        WorkbenchError: If there is no such file, or no system in it.
    """
    import control as ct

    kept = _kept(path)
    try:
        system, sampled = _system(kept)
        late = sum(_number(kept, name) for name in ("InputDelay", "OutputDelay", "IODelay"))
    except (TypeError, ValueError):
        keys = (k for k in (*"ABCD", "num", "den", "Ts") if k in kept)
        sizes = ", ".join(f"{k} of size {np.shape(kept[k])}" for k in keys)
        raise WorkbenchError(
            f"plant {str(path)!r} keeps {sizes}, which are no numbers of one system; {_FIX}"
        ) from None
    names = {
        key: [str(v) for v in np.atleast_1d(kept[found]).ravel()]
        for key, spellings in _NAMES.items()
        if (found := next((k for k in spellings if k in kept), None)) is not None
    }
    counts = {"states": system.nstates, "inputs": system.ninputs, "outputs": system.noutputs}
    given = {k: v for k, v in names.items() if len(v) == counts[k] and all(v)}
    system = ct.ss(system, name=path.stem, **given)
    told = f"the linear system of {path.name}"
    return linear_plant(str(path), system, told, delay=late * (sampled or 1.0))


def _system(kept: Mapping[str, Any]) -> tuple[Any, float]:
    """Return what is kept as a system of python-control, and its sample time in s, 0 for none."""
    import control as ct

    sampled = _number(kept, "Ts")
    dt = True if sampled < 0.0 else sampled
    if "A" in kept:
        A, B, C, D = (np.asarray(kept.get(k, 0.0), dtype=float) for k in "ABCD")
        # A vector has lost which way it stood.
        n = math.isqrt(A.size)
        B, C = B.reshape(n, -1), C.reshape(-1, n)
        shape = len(C), B.shape[1]
        D = D.reshape(shape) if D.any() else np.zeros(shape)
        return ct.ss(A.reshape(n, n), B, C, D, dt), sampled
    num, den = (np.atleast_1d(np.asarray(kept[k], dtype=float)) for k in ("num", "den"))
    return ct.ss(ct.tf(num, den, dt)), sampled


_FIX = "save A, B, C, D of the system, or num and den, with save('model.mat', ..., '-v7')"

_NAMES = {
    "states": ("states", "StateName"),
    "inputs": ("inputs", "InputName"),
    "outputs": ("outputs", "OutputName"),
}


_SPELLED = {"Numerator": "num", "Denominator": "den", **{name.lower(): name for name in "ABCD"}}
"""Names of older versions, and those of the properties of a transfer function."""


def _number(kept: Mapping[str, Any], name: str) -> float:
    value = np.asarray(kept.get(name, 0.0), dtype=float).ravel()
    return float(value[0]) if value.size else 0.0


def _kept(path: Path) -> Mapping[str, Any]:
    """Return what a file keeps of a system, by name."""
    found: dict[str, Any]
    try:
        content = path.read_bytes()
        if content.startswith(MARK):
            found = parse_octave_text(content.decode(errors="replace"))
        elif 0 in content[:4]:
            from scipy.io import loadmat

            # Version 4 begins with numbers, not with text.
            found = loadmat(str(path), simplify_cells=True)
        else:
            found = parse_mat5(content)
    except OSError as error:
        raise WorkbenchError(f"cannot read plant {str(path)!r}: {error.strerror}") from None
    except Exception as error:  # noqa: BLE001
        # A damaged file fails anywhere, and in its own way.
        raise WorkbenchError(f"plant {str(path)!r} cannot be read ({error}); {_FIX}") from None
    for own in (found, *(v for v in found.values() if isinstance(v, dict))):
        kept = {_SPELLED.get(k, k): value for k, value in own.items() if value is not None}
        if {"A", "B", "C"} <= kept.keys() or {"num", "den"} <= kept.keys():
            return kept
    named = ", ".join(k for k in found if not k.startswith("__")) or "nothing"
    raise WorkbenchError(f"plant {str(path)!r} holds {named}, and no system; {_FIX}")
