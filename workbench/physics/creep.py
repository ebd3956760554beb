"""Creep: part of a signal arrives late, as long after the response of the machine or later.

After a step the signal is 1 - share of its final value at once and creeps to it, with two time
constants: a standard linear solid.
"""

from __future__ import annotations

from workbench.model import PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, each, first_of, shape, size, twins
from workbench.physics.place import EFFORTS


def _late(at: PortView) -> Expression:
    slow = at.p.slow_part
    late = (1.0 - slow) * (at.value - at.x.fast) + slow * (at.value - at.x.slow)
    return at.value - at.p.share * late


creep = Law(
    "creep",
    "y = u - share [(1 - s)(u - m1) + s (u - m2)], dm/dt = (u - m) / tau",
    first_of(twins("muscle_force"), each(*EFFORTS)),
    lambda at: (
        size("share", "1", 0.02, 1.0, "part that arrives late", signed=True),
        shape("slow_part", "1", 0.5, "part of the share with the slow time constant",
              around=None, between=(0.0, 1.0)),
        shape("time_constant", "s", at.horizon, "fast time constant"),
        shape("slow_time_constant", "s", 30.0 * at.horizon, "slow time constant", fitted=False),
    ),
    _late,
    states=lambda at: tuple(
        State(kind, at.unit, at.scale, f"{kind} memory of {at.name}") for kind in ("fast", "slow")
    ),
    rates=lambda e: {
        "fast": (e.here.value - e.x.fast) / e.p.time_constant,
        "slow": (e.here.value - e.x.slow) / e.p.slow_time_constant,
    },
    start=lambda e: {"fast": e.here.value, "slow": e.here.value},
    shapes=lambda at: (
        {"time_constant": at.horizon}, {"time_constant": 0.3 * at.horizon}, {"slow_part": 1.0},
    ),
    source="standard linear solid, C. Zener 1948; creep of rubber tubes in braided muscles",
    look_alikes=("maxwell_slip_hysteresis", "chamber_leakage", "sensor_drift"),
    separated_by="hold valve and angle for a minute after a step of pressure",
)  # fmt: skip
