"""Rate-independent hysteresis of a muscle: Maxwell-slip elements, Bouc-Wen and Dahl.

The tension gains (hyst_force + hyst_slope p) times a memory in -1..1 that follows the muscle
length: a lengthening muscle pulls harder.

Units: SI; memories and their shares are relative.
"""

from __future__ import annotations

import numpy as np

from workbench.evaluation.rig.parameters import ELEMENTS


def maxwell_rate(z: float, d: float, speed: float) -> float:
    """Return dz/dt of one element: it follows the length until |z| reaches its break-away d."""
    if (z >= d and speed > 0.0) or (z <= -d and speed < 0.0):
        return 0.0
    return speed


def bouc_wen_rate(z: float, d: float, n: float, beta: float, speed: float) -> float:
    """Return dz/dt of the Bouc-Wen memory; n = 1 and beta = 1 is Dahl's law."""
    a = abs(z)
    against = beta * abs(speed) * z * a ** (n - 1.0)
    return float((speed - against - (1.0 - beta) * speed * a**n) / d)


def elements(smallest: float, largest: float, count: int = ELEMENTS) -> dict[str, float]:
    """Return parameters of `count` equal elements, break-aways from smallest to largest in m."""
    if count == 1:
        spread = np.array([largest])
    else:
        spread = np.geomspace(smallest, largest, count)
    return explicit(list(spread), [1.0 / count] * count)


def explicit(breakaways: list[float], weights: list[float]) -> dict[str, float]:
    """Return parameters of elements with the given break-aways in m and shares."""
    values: dict[str, float] = {}
    for i in range(ELEMENTS):
        inside = i < len(breakaways)
        values[f"hyst_d{i + 1}"] = float(breakaways[i]) if inside else 1.0
        values[f"hyst_w{i + 1}"] = float(weights[i]) if inside else 0.0
    return values
