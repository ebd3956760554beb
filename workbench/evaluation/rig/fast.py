"""The rig's equations as machine code, `plant.c`: their rates, and a run of fixed steps.

Units: SI.
"""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from workbench.errors import WorkbenchError
from workbench.evaluation.rig import plant
from workbench.evaluation.rig.parameters import ELEMENTS, PARAMETERS
from workbench.work.machine_code import PLAIN, built

STEP = 2e-4
"""Integration step in s."""

Array = NDArray[np.float64]

VOLTS = np.array(
    [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 3.5, 4]
    + [4.5, 5]
)
PERCENT = np.array(
    [0, 0.2, 0.5, 0.8, 1.2, 1.7, 2.3, 3.0, 4.1, 5.6, 7.1, 10.7, 17, 24, 30, 36, 49, 64, 75, 86]
    + [97, 100]
)
"""Opening curve of the servovalve: spool in V, conductance in per cent of the full one."""


@functools.cache
def library() -> ctypes.CDLL:
    """Return the compiled plant.

    Raises:
        WorkbenchError: If there is no C compiler.
    """
    parameters = ", ".join(f"P_{name}" for name in PARAMETERS)
    states = ", ".join(f"X_{name}" for name in plant.STATES)
    header = (
        f"#define NX {len(plant.STATES)}\n#define NE {ELEMENTS}\n"
        f"enum {{ {parameters} }};\nenum {{ {states} }};\n"
    )
    path = built("rig", header + Path(__file__).with_name("plant.c").read_text(), PLAIN)
    if path is None:
        raise WorkbenchError("the second simulator of the arm is C code; install gcc or clang")
    return ctypes.CDLL(str(path))


def _pointer(a: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(a.ctypes.data)


def _vector(parameters: dict[str, float]) -> Array:
    return np.array([parameters[name] for name in PARAMETERS], float)


def derivative(state: Array, command: float, parameters: dict[str, float]) -> Array:
    """Return dx/dt at the command in volt."""
    p, x, dx = _vector(parameters), np.array(state, float), np.empty(len(state))
    volts, part = np.array(VOLTS, float), PERCENT / 100
    library().rig_derivative(
        _pointer(p), _pointer(x), ctypes.c_double(command), _pointer(volts), _pointer(part),
        ctypes.c_int(len(volts)), _pointer(dx),
    )  # fmt: skip
    return dx


def run(
    parameters: dict[str, float],
    state: Array,
    command: Array,
    *,
    step: float = STEP,
    keep: int = 10,
) -> tuple[Array, Array]:
    """Integrate with one command in volt per step.

    Returns the states before step 0, keep, 2 keep, ... and the state after the last step.
    """
    u, x, p = np.ascontiguousarray(command, float), np.array(state, float), _vector(parameters)
    volts, part = np.array(VOLTS, float), PERCENT / 100
    out = np.empty((-(-len(u) // keep), len(x)))
    library().rig_run(
        _pointer(p), _pointer(x), _pointer(u), ctypes.c_int(len(u)), ctypes.c_double(step),
        _pointer(volts), _pointer(part), ctypes.c_int(len(volts)), ctypes.c_int(keep),
        _pointer(out),
    )  # fmt: skip
    return out, x
