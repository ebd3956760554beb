"""An electric oscillator: source, resistor, coil with a core, capacitor; shunt and probe read.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from workbench.evaluation.foreign.excitation import chirp, pulses, sines, steps
from workbench.evaluation.foreign.machine import Channel, Concealed, Machine, Parameters, State

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


LOOP, SOURCE = ("coil.voltage",), ("source.voltage", "coil.voltage")
"""A drop in series is the same at the source as at the coil."""

CIRCUIT = Machine(
    "circuit",
    (("source", "V"),),
    (Channel("current", "A", 0, 3e-3, 1e-3), Channel("voltage", "V", 1, 0.02, 5e-3)),
    {
        "resistance": (6.0, 0.15),
        "inductance": (0.4, 0.1),
        "capacitance": (1.5e-3, 0.1),
    },
    (
        Concealed("core_saturation", "saturating_inductance", LOOP, (1.0, 3.0)),
        Concealed("capacitor_leak", "leakage", ("capacitor.current",), (5e-3, 2e-2)),
        Concealed("contact_drop", "dry_friction", SOURCE, (0.4, 1.5)),
        Concealed("hot_wire", "growing_resistance", SOURCE, (4.0, 15.0)),
        Concealed(
            "ceramic", "varying_capacitance", ("capacitor.current", *LOOP), (2e-3, 8e-3)
        ),
        Concealed("source_limit", "drive_limit", SOURCE, (4.0, 6.0)),
        Concealed("source_dead_zone", "dead_zone", SOURCE, (0.3, 1.0)),
        Concealed("source_delay", "drive_delay", SOURCE, (0.01, 0.03)),
        Concealed("current_offset", "sensor_offset", ("current.reading",), (0.02, 0.06),
                  signed=True),
        Concealed("voltage_lag", "sensor_lag", ("voltage.reading",), (0.01, 0.03)),
    ),
    _rates,
    lambda p: [0.0, 0.0],
    {
        "fit_1": pulses(9.0, (0.05, 0.4)),
        "fit_2": chirp(6.0, 1.0, 0.08),
        "hold_1": steps(-9.0, 9.0, (0.1, 0.5), first=0.0),
        "hold_2": sines(10.0, (0.9, 0.3, 0.15)),
    },
    sample_time=0.005,
    steps=8,
    samples=1000,
)  # fmt: skip
