"""Fixed-step route for producing data: plant.c through ctypes, or plain Python without compiler.

Units: SI.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import plant, valve
from workbench.evaluation.rig.parameters import ELEMENTS, PARAMETERS

STEP = 2e-4
"""Integration step in s."""

Array = NDArray[np.float64]


def _header() -> str:
    parameters = ", ".join(f"P_{name}" for name in PARAMETERS)
    states = ", ".join(f"X_{name}" for name in plant.STATES)
    return (
        f"#define NX {len(plant.STATES)}\n#define NE {ELEMENTS}\n"
        f"enum {{ {parameters} }};\nenum {{ {states} }};\n"
    )


@functools.cache
def library() -> ctypes.CDLL | None:
    """Return the compiled plant, or None when there is no compiler or RIG_NO_COMPILER is set."""
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc")
    if compiler is None or os.environ.get("RIG_NO_COMPILER"):
        return None
    source = _header() + Path(__file__).with_name("plant.c").read_text()
    digest = hashlib.sha256(source.encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"arm-rig-{os.getuid() if hasattr(os, 'getuid') else 0}"
    target = folder / f"{digest}.so"
    if not target.exists():
        try:
            folder.mkdir(mode=0o700, exist_ok=True)
            work = Path(tempfile.mkdtemp(dir=folder))
            (work / "rig.c").write_text(source)
            command = [compiler, "-O2", "-shared", "-fPIC", "-o", str(work / "rig.so")]
            subprocess.run([*command, str(work / "rig.c"), "-lm"], check=True, capture_output=True)
            (work / "rig.so").replace(target)
            shutil.rmtree(work, ignore_errors=True)
        except (OSError, subprocess.CalledProcessError):
            return None
    return ctypes.CDLL(str(target))


def vector(parameters: dict[str, float]) -> Array:
    """Return the parameters in the order of the compiled plant."""
    return np.array([parameters[name] for name in PARAMETERS], float)


def _pointer(a: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(a.ctypes.data)


def run(
    parameters: dict[str, float],
    state: Array,
    command: Array,
    *,
    step: float = STEP,
    keep: int = 10,
    table: tuple[Array, Array] | None = None,
    compiled: bool = True,
) -> tuple[Array, Array]:
    """Integrate with one command in volt per step.

    Returns the states before step 0, keep, 2 keep, ... and the state after the last step.
    `table` replaces the knots of the opening curve (volt, fraction).
    """
    u = np.ascontiguousarray(command, float)
    x = np.array(state, float)
    volts, part = table if table is not None else (valve.VOLTS, valve.PERCENT / 100)
    out = np.empty((-(-len(u) // keep), len(x)))
    lib = library() if compiled else None
    if lib is not None:
        volts, part = np.ascontiguousarray(volts, float), np.ascontiguousarray(part, float)
        p = vector(parameters)
        lib.rig_run(
            _pointer(p), _pointer(x), _pointer(u), ctypes.c_int(len(u)), ctypes.c_double(step),
            _pointer(volts), _pointer(part), ctypes.c_int(len(volts)), ctypes.c_int(keep),
            _pointer(out),
        )  # fmt: skip
        return out, x
    if table is not None:
        raise NotImplementedError("another opening curve needs the compiled plant")
    space = plant.namespace(parameters)
    for j, v in enumerate(u):
        if j % keep == 0:
            out[j // keep] = x
        k1 = plant.derivative(x, v, space)
        k2 = plant.derivative(plant.slipped(x + 0.5 * step * k1, x, space), v, space)
        k3 = plant.derivative(plant.slipped(x + 0.5 * step * k2, x, space), v, space)
        k4 = plant.derivative(plant.slipped(x + step * k3, x, space), v, space)
        x = plant.slipped(x + step / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4), x, space)
    return out, x
