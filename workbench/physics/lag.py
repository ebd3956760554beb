"""First-order lag of a sensor or a drive that vanishes at zero time; lead of an input.

``dm/dt = (u - m) / (time + g)``, ``y = u - time / (time + g) (u - m)`` with g = f^2 / (time + f)
and f half a sampling interval: exactly the identity at zero time, and a lag of that time for
time >> f.

Many a sensor filters its samples: ``y[k] = a y[k-1] + (1 - a) u[k]`` with a = exp(-h / time). That
answers half a sample earlier, as if a part c of the signal went past the memory. With an input that
is straight from sample to sample a part ``c = b / (a + b)``, ``b = (1 - a) time / h - a``, makes
both the same.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from workbench.model import PortView, State
from workbench.model.regularisation import Expression
from workbench.model.scope import Names
from workbench.physics.law import Law, at_inputs_too, drives, floor, sensors, shape, size


def _constant(p: Names) -> Expression:
    """Time constant with what keeps it regular, in s: f at zero time, nothing beside a long one."""
    return p.time + p.floor * p.floor / (p.time + p.floor)


def _lagging(at: PortView) -> Expression:
    return at.value - at.p.time / _constant(at.p) * (at.value - at.x.memory)


def _filtered(at: PortView) -> Expression:
    over = 2.0 * at.p.floor / _constant(at.p)
    kept = ca.exp(-over)
    late = (1.0 - kept) / over - kept
    past = at.p.sampled * late / (kept + late)
    return at.value - (1.0 - past) * at.p.time / _constant(at.p) * (at.value - at.x.memory)


sensor_lag = Law(
    "sensor_lag",
    "Y / U = (1 + g s) / (1 + (time + g) s)",
    sensors(),
    lambda at: (
        size("time", "s", 10 * at.interval, 250 * at.interval, "time constant"),
        shape("sampled", "1", 0.0, "whether it filters samples", around=None, between=(0.0, 1.0),
              fitted=False),
        floor(at, 0.5),
    ),
    _filtered,
    states=lambda at: (
        State("memory", at.unit, at.scale, f"lagging signal of {at.name}",
              start_rms=0.05 * at.scale),
    ),
    rates=lambda e: {"memory": (e.here.value - e.x.memory) / _constant(e.p)},
    start=lambda e: {"memory": e.here.value},
    shapes=lambda at: ({"sampled": 0.0}, {"sampled": 1.0}),
    group="sensor",
    far=True,
    source="first-order lag",
    look_alikes=("sensor_delay", "clock_shift", "line"),
    separated_by="steps faster than the lag, beside a fast reference sensor",
)  # fmt: skip

drive_lag = at_inputs_too(
    replace(
        sensor_lag,
        name="drive_lag",
        where=drives(),
        parameters=lambda at: (
            size("time", "s", 25 * at.interval, 5e6 * at.interval, "time constant"),
            floor(at, 0.5),
        ),
        transform=_lagging,
        shapes=lambda at: ({},),
        group="process",
        look_alikes=("delay", "slew_limit"),
        separated_by="steps of the command: a lag answers at once, a delay waits",
    )
)


def _ahead(at: PortView) -> Expression:
    lead = 0.5 * at.p.interval / (at.p.interval + at.p.floor)
    return at.value + lead * (at.value - at.x.memory)


# A simulation holds each sample. An input that ran in a straight line was ahead of that by half a
# sampling interval on average, which a lead that fades within the interval gives back.
input_interpolation = Law(
    "input_interpolation",
    "y = u + (u - m) / 2, dm/dt = (u - m) / interval",
    drives("force", "acceleration", "flow", only=lambda at: at.driven),
    lambda at: (
        size("interval", "s", 10 * at.interval, 5e4 * at.interval, "interval between samples"),
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
    look_alikes=("clock_shift", "delay"),
    separated_by="record the input faster than it changes",
)
