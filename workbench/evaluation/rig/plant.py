"""State vector of the rig; `plant.c` has its time derivative.

The gas of a muscle is described by its mass m and its internal energy U:

    dU/dt = c_p sum(flow T_carried) - p dV/dt - h S (T - T_ambient),
    p = (gamma - 1) U / V,   T = U / (m c_v).

Reservoir, lines and silencers are isothermal volumes with the mass as state.

Units: SI.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import arm, muscle
from workbench.evaluation.rig.parameters import ELEMENTS

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
    for k, a in enumerate((x[0], arm.SPAN - x[0])):
        fibres.append(arm.distance(a) - arm.FITTINGS)
        if stretched and p.tendon_stiffness > 0.0:
            gain = (p.force_gain_1, p.force_gain_2)[k]
            for _ in range(50):  # Contracts: muscles are softer than tendons.
                tension = muscle.force(fibres[k], gauge_bar[k] * 1e5, gain, p)
                rigid = arm.distance(a) - arm.FITTINGS
                fibres[k] += 0.5 * (rigid - tension / p.tendon_stiffness - fibres[k])
        pressure = gauge_bar[k] * 1e5 + p.ambient_pressure
        x[INDEX[f"fibre_{k + 1}"]] = fibres[k]
        v = p.volume_gain * muscle.volume(fibres[k]) + p.dead_volume
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
    for k, a in enumerate((float(state[0]), arm.SPAN - float(state[0]))):
        s = arm.distance(a) - arm.FITTINGS
        if p["tendon_stiffness"] > 0:
            s = float(state[INDEX["fibre_1"] + k])
        v = p["volume_gain"] * muscle.volume(s) + p["dead_volume"]
        out.append((p["gamma"] - 1) * float(state[3 + 2 * k]) / v - p["ambient_pressure"])
    return out[0], out[1]
