"""The equations of the rig: geometry, muscles, state vector; `plant.c` has its time derivative.

The gas of a muscle is described by its mass m and its internal energy U:

    dU/dt = c_p sum(flow T_carried) - p dV/dt - h S (T - T_ambient),
    p = (gamma - 1) U / V,   T = U / (m c_v).

Reservoir, lines and silencers are isothermal volumes with the mass as state.

Units: SI; contractions q in mm, commands in V.
"""

from __future__ import annotations

import ctypes
import functools
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from workbench.errors import WorkbenchError
from workbench.evaluation.rig.parameters import ELEMENTS, PARAMETERS
from workbench.work.machine_code import PLAIN, built

SPAN = math.radians(60.0)
FITTINGS = 0.223
"""Distance between the joining points minus the length of the fibre."""


def distance(angle: float) -> float:
    """Return the distance between the joining points of muscle 1."""
    x = 0.0444 + 0.032 * math.cos(angle)
    y = 0.416 - 0.032 * math.sin(angle)
    return math.hypot(x, y)


NOMINAL_LENGTH = 0.200
FIBRE_ANGLE = math.radians(25.0)
NOMINAL_DIAMETER = 0.020
FIBRE_LENGTH = NOMINAL_LENGTH / math.cos(FIBRE_ANGLE)
TURNS = NOMINAL_LENGTH * math.tan(FIBRE_ANGLE) / (math.pi * NOMINAL_DIAMETER)
FLOOR_BELOW = 1.757
"""Contraction in mm below which the pressure-free force is the constant -9.2101 N."""


def pressure_free_force(q: float) -> float:
    """Return phi in N at the contraction q in mm."""
    if q <= FLOOR_BELOW:
        return -9.2101
    return (((0.00045804 * q - 0.053424) * q + 2.0189) * q - 43.691) * q + 61.62


def clamp(x: float, width: float, law: float) -> float:
    """Return x clamped at zero from below, rounded over `width` newtons by the chosen law."""
    if law == 0:
        return 0.5 * (x + math.sqrt(x * x + width * width))
    if law == 1:
        z = x / width
        return x if z > 35 else (0.0 if z < -35 else width * math.log1p(math.exp(z)))
    return max(0.0, x)


def raw_force(s: float, pressure: float, p: SimpleNamespace) -> float:
    """Return the tension at fibre length s and gauge pressure before clamp and gain."""
    q = (NOMINAL_LENGTH - s) * 1e3
    raw = (280.0 - 2.2 * q + 0.033 * q * q) * pressure * 1e-5 + pressure_free_force(q)
    return float(raw * (1.0 + p.force_shape * (q / 30.0) ** 2))


def force(s: float, pressure: float, gain: float, p: SimpleNamespace) -> float:
    """Return the static tension at fibre length s and gauge pressure; never below zero."""
    clamped = clamp(raw_force(s, pressure, p), p.slack_width, p.slack_law)
    return float(p.force_gain * gain * clamped)


def volume(s: float) -> float:
    """Return the volume inside a muscle of fibre length s, its ends flattened."""
    d = math.sqrt(FIBRE_LENGTH**2 - s * s) / (math.pi * TURNS)
    d0 = NOMINAL_DIAMETER
    h = 0.5 * math.sqrt(d * d - d0 * d0) if d > d0 else 1e-7
    zone = math.pi * h / 6.0 * (0.75 * d * d + 0.75 * d0 * d0 + h * h)
    return 0.25 * math.pi * d * d * (s - 2.0 * h) + 2.0 * zone


def volume_slope(s: float) -> float:
    """Return dV/ds; the terms in dh/ds cancel because h^2 = (d^2 - d0^2)/4."""
    pitch = math.pi * TURNS
    d2 = (FIBRE_LENGTH**2 - s * s) / pitch**2
    d0 = NOMINAL_DIAMETER
    h = 0.5 * math.sqrt(d2 - d0 * d0) if d2 > d0 * d0 else 0.0
    return -0.5 * math.pi * s / pitch**2 * (s - h) + 0.25 * math.pi * d2


STATES: list[str] = [
    "angle", "speed", "mass_1", "energy_1", "mass_2", "energy_2", "spool", "spool_speed",
    "reservoir", "exhaust_1", "exhaust_2", "line_1", "line_2", "bristle",
    *(f"slip_1_{i + 1}" for i in range(ELEMENTS)),
    *(f"slip_2_{i + 1}" for i in range(ELEMENTS)),
    "memory_1", "memory_2", "creep_fast_1", "creep_slow_1", "creep_fast_2", "creep_slow_2",
    "load_angle", "load_speed", "fibre_1", "fibre_2",
]  # fmt: skip
INDEX = {name: i for i, name in enumerate(STATES)}


def namespace(parameters: dict[str, float]) -> SimpleNamespace:
    """Return the parameters as attributes."""
    p = SimpleNamespace(**parameters)
    p.cv = p.gas_constant / (p.gamma - 1.0)
    return p


def initial(
    angle_deg: float,
    gauge_bar: tuple[float, float],
    parameters: dict[str, float],
    *,
    spool: float = 0.0,
    stretched: bool = False,
) -> NDArray[np.float64]:
    """Return a state at rest."""
    p = namespace(parameters)
    x = np.zeros(len(STATES))
    x[0] = x[INDEX["load_angle"]] = np.radians(angle_deg)
    x[INDEX["spool"]] = spool
    rt = p.gas_constant * p.ambient_temperature
    supply = p.supply_pressure + p.ambient_pressure
    x[INDEX["reservoir"]] = supply * p.supply_volume / rt
    fibres = []
    for k, a in enumerate((x[0], SPAN - x[0])):
        fibres.append(distance(a) - FITTINGS)
        if stretched and p.tendon_stiffness > 0.0:
            gain = (p.force_gain_1, p.force_gain_2)[k]
            for _ in range(50):  # Contracts: muscles are softer than tendons.
                tension = force(fibres[k], gauge_bar[k] * 1e5, gain, p)
                rigid = distance(a) - FITTINGS
                fibres[k] += 0.5 * (rigid - tension / p.tendon_stiffness - fibres[k])
        pressure = gauge_bar[k] * 1e5 + p.ambient_pressure
        x[INDEX[f"fibre_{k + 1}"]] = fibres[k]
        v = p.volume_gain * volume(fibres[k]) + p.dead_volume
        x[2 + 2 * k] = pressure * v / rt
        x[3 + 2 * k] = pressure * v / (p.gamma - 1.0)
        x[INDEX[f"exhaust_{k + 1}"]] = p.ambient_pressure * p.silencer_volume / rt
        x[INDEX[f"line_{k + 1}"]] = pressure * p.line_volume / rt
        for name in ("creep_fast", "creep_slow"):
            x[INDEX[f"{name}_{k + 1}"]] = pressure - p.ambient_pressure
    return x


def gauge(state: NDArray[np.float64], p: dict[str, float]) -> tuple[float, float]:
    """Return the true gauge pressures in Pa."""
    out = []
    for k, a in enumerate((float(state[0]), SPAN - float(state[0]))):
        s = distance(a) - FITTINGS
        if p["tendon_stiffness"] > 0:
            s = float(state[INDEX["fibre_1"] + k])
        v = p["volume_gain"] * volume(s) + p["dead_volume"]
        out.append((p["gamma"] - 1) * float(state[3 + 2 * k]) / v - p["ambient_pressure"])
    return out[0], out[1]


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
    states = ", ".join(f"X_{name}" for name in STATES)
    header = (
        f"#define NX {len(STATES)}\n#define NE {ELEMENTS}\n"
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
