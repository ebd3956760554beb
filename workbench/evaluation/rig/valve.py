"""Opening curve of the servovalve and flow through an orifice (ISO 6358).

Units: SI, the spool in volt.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

VOLTS = np.array(
    [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 3.5, 4]
    + [4.5, 5]
)
PERCENT = np.array(
    [0, 0.2, 0.5, 0.8, 1.2, 1.7, 2.3, 3.0, 4.1, 5.6, 7.1, 10.7, 17, 24, 30, 36, 49, 64, 75, 86]
    + [97, 100]
)
_V, _F = VOLTS.tolist(), (PERCENT / 100).tolist()


def opening(x: float) -> float:
    """Return the fraction of the full conductance at spool voltage x from the centre."""
    if x <= 0.0:
        return 0.0
    if x >= 5.0:
        return 1.0
    i = 1
    while _V[i] < x:
        i += 1
    return float(_F[i - 1] + (_F[i] - _F[i - 1]) * (x - _V[i - 1]) / (_V[i] - _V[i - 1]))


def flow(c: float, up: float, down: float, t_up: float, p: SimpleNamespace) -> float:
    """Return the mass flow from pressure up to down (absolute, up >= down), conductance c."""
    b, r_lin = p.critical_ratio, p.linear_ratio
    r = down / up
    if r <= b:
        psi = 1.0
    elif r <= r_lin:
        psi = math.sqrt(1.0 - ((r - b) / (1.0 - b)) ** 2)
    else:
        psi = math.sqrt(1.0 - ((r_lin - b) / (1.0 - b)) ** 2) * (1.0 - r) / (1.0 - r_lin)
    return float(c * p.reference_density * up * math.sqrt(p.reference_temperature / t_up) * psi)


def exchange(
    c: float, pa: float, ta: float, pb: float, tb: float, p: SimpleNamespace
) -> tuple[float, float]:
    """Return the mass flow from a to b (signed) and the temperature it carries."""
    if pa >= pb:
        return flow(c, pa, pb, ta, p), ta
    return -flow(c, pb, pa, tb, p), tb
