"""A coarse sensor: its measurements come in steps that the notes do not know.

The regularised equations keep the first waves of the saw tooth between a signal and its steps.
"""

from __future__ import annotations

import math

import casadi as ca

from workbench.model import PortView
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, sensors, shape, share


def _saw_tooth(at: PortView) -> Expression:
    turns = at.value / at.p.step
    if not at.form.regularised:
        return turns - ca.floor(turns + 0.5)
    return sum(
        (-1) ** (k + 1) / (math.pi * k) * ca.sin(2.0 * math.pi * k * turns) for k in (1, 2, 3)
    )


sensor_quantisation = Law(
    "sensor_quantisation",
    "y = step round(u / step)",
    sensors(together=False),
    lambda at: (
        share("share of the rounding"),
        shape("step", at.unit, 0.01 * at.scale, "step of the converter", around=(0.01, 100.0)),
    ),
    lambda at: at.value - at.p.share * at.p.step * _saw_tooth(at),
    shapes=lambda at: [{"step": k * at.scale} for k in (0.01, 0.03, 0.1)],
    group="sensor",
    source="W. R. Bennett 1948",
    look_alikes=("sensor_offset", "sensor_gain"),
    separated_by="a slow ramp: the measurement climbs in stairs",
)
