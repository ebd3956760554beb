"""What a recorded input did between its samples: held, or in a straight line to the next.

A simulation holds each sample. An input that ran in a straight line was ahead of that by half a
sampling interval on average, which a lead that fades within the interval gives back.
"""

from __future__ import annotations

from workbench.model import PortView, State
from workbench.model.regularisation import Expression
from workbench.physics.law import Law, drives, floor, size


def _ahead(at: PortView) -> Expression:
    lead = 0.5 * at.p.interval / (at.p.interval + at.p.floor)
    return at.value + lead * (at.value - at.x.memory)


input_interpolation = Law(
    "input_interpolation",
    "y = u + (u - m) / 2, dm/dt = (u - m) / interval",
    drives("force", "acceleration", "flow", only=lambda at: at.driven),
    lambda at: (
        size(
            "interval",
            "s",
            10 * at.interval,
            5e4 * at.interval,
            "interval between samples",
        ),
        floor(at, 0.5),
    ),
    _ahead,
    states=lambda at: (
        State("memory", at.unit, at.scale, "what was held", start_rms=0.05 * at.scale),
    ),
    rates=lambda e: {"memory": (e.here.value - e.x.memory) / (e.p.interval + e.p.floor)},
    start=lambda e: {"memory": e.here.value},
    far=True,
    source="zero-order and first-order hold of sampled signals",
    look_alikes=("clock_shift", "drive_delay", "delay"),
    separated_by="record the input faster than it changes",
)
