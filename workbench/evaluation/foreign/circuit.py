"""An electric oscillator: source, resistor, coil with a core, capacitor; shunt and probe read.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.evaluation.foreign.excitation import machine
from workbench.evaluation.foreign.machine import Parameters, State

KNEE = 5e-3
"""Current at which the contact drop begins to saturate, in A."""


def _rates(_: float, x: State, u: Sequence[float], p: Parameters) -> State:
    current, voltage = x
    # Two diodes back to back: the drop grows as the inverse hyperbolic sine of the current.
    drop = p["contact_drop"] * math.asinh(current / KNEE) / math.asinh(0.5 / KNEE)
    # Froelich: the inductance falls to a fifth as the core saturates.
    core = 0.2 + 0.8 / (1.0 + (p["core_saturation"] * current) ** 2)
    across = u[0] - p["resistance"] * current - p["hot_wire"] * current**3 - drop - voltage
    kept = 1.0 / (1.0 + p["ceramic"] * voltage**2)
    into = current - p["capacitor_leak"] * voltage
    return [across / (p["inductance"] * core), into / (p["capacitance"] * kept)]


CIRCUIT = machine("circuit", _rates, lambda p: [0.0, 0.0])
