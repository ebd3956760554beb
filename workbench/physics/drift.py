"""Signals that change with time: sensors that warm up, gains that fade, jumps at some time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca

from workbench.model import PortView, State
from workbench.model.face import Expression
from workbench.physics.law import Law, Own, by_port, each, sensors, shape, size
from workbench.physics.offset_gain import sensor_error
from workbench.physics.place import DRIVES, Place

_TIMES = (10.0, 30.0, 3.0, 100.0)
"""Times of a jump that are worth trying without knowing the recording, s."""


def _warming(typical: Callable[[Place], float]) -> Callable[[Place], tuple[Own, ...]]:
    def parameters(at: Place) -> tuple[Own, ...]:
        s = typical(at) * at.scale
        return (
            size("amount", at.unit, s, 0.2 * s, 5.0 * s, "final drift", signed=True),
            shape("time_constant", "s", 60.0, "time constant of warming up",
                  around=(0.05, 100.0), source="", fitted=False),
        )  # fmt: skip

    return parameters


def _warm() -> tuple[State, ...]:
    return (State("warm", "1", 1.0, "share of the final drift reached", start_rms=1e-3),)


# With a time constant beyond the length of the run it is a ramp.
sensor_drift = Law(
    "sensor_drift",
    "y = u + amount w, dw/dt = (1 - w) / tau",
    sensors(together=False),
    _warming(sensor_error),
    lambda at: at.value + at.p.amount * at.x.warm,
    states=lambda at: _warm(),
    rates=lambda e: {"warm": (1.0 - e.x.warm) / e.p.time_constant},
    group="sensor",
    source="thermal zero drift of a bridge",
    look_alikes=("sensor_offset", "creep", "chamber_leakage"),
    separated_by="the same holding position at the start and at the end of a recording",
)

gain_fade = Law(
    "gain_fade",
    "y = u (1 + amount w), dw/dt = (1 - w) / tau",
    each("force", "acceleration", *DRIVES, "flow", label=by_port, only=lambda at: at.driven),
    lambda at: (
        size("amount", "1", 0.1, 0.01, 1.0, "final change of the gain", signed=True),
        shape("time_constant", "s", 60.0, "time constant", around=(0.05, 100.0)),
    ),
    lambda at: at.value * (1.0 + at.p.amount * at.x.warm),
    states=lambda at: _warm(),
    rates=lambda e: {"warm": (1.0 - e.x.warm) / e.p.time_constant},
    source="warming of a drive, a battery that runs down, a filter that clogs",
    look_alikes=("gain", "gain_jump", "creep"),
    separated_by="the same motion at the start and at the end of a recording",
)  # fmt: skip


def _passed(at: PortView) -> Expression:
    return 0.5 + 0.5 * ca.tanh((at.x.clock - at.p.time) / at.p.width)


def _when() -> tuple[Own, ...]:
    return (
        shape("time", "s", _TIMES[0], "time of the jump", around=None, between=(0.0, 1e6)),
        shape("width", "s", 0.02, "half-width of the jump", source="", fitted=False),
    )


offset_jump = Law(
    "offset_jump",
    "y = u + amount step(t - time)",
    each("force", "acceleration", *DRIVES, "flow", label=by_port, only=lambda at: at.driven),
    lambda at: (
        size("amount", at.unit, 0.05 * at.scale, 0.005 * at.scale, at.scale, "height of the jump",
             signed=True),
        *_when(),
    ),
    lambda at: at.value + at.p.amount * _passed(at),
    states=lambda at: (State("clock", "s", 120.0, "time since the start", start_rms=1e-6),),
    rates=lambda e: {"clock": 1.0 + 0.0 * e.x.clock},
    shapes=lambda at: [{"time": time} for time in _TIMES],
    source="an event: something slipped, came loose or was switched",
    look_alikes=("offset", "gain_jump"),
    separated_by="a repetition of the recording: an event does not repeat",
)  # fmt: skip


gain_jump = replace(
    offset_jump,
    name="gain_jump",
    equation="y = u (1 + amount step(t - time))",
    parameters=lambda at: (
        size("amount", "1", 0.1, 0.01, 1.0, "relative height of the jump", signed=True),
        *_when(),
    ),
    transform=lambda at: at.value * (1.0 + at.p.amount * _passed(at)),
    look_alikes=("gain", "offset_jump", "gain_fade"),
)

sensor_jump = replace(
    offset_jump,
    name="sensor_jump",
    where=sensors(together=False),
    parameters=lambda at: (
        size("amount", at.unit, sensor_error(at) * at.scale, 0.1 * sensor_error(at) * at.scale,
             5.0 * sensor_error(at) * at.scale, "height of the jump", signed=True),
        *_when(),
    ),
    group="sensor",
    look_alikes=("sensor_offset", "sensor_drift"),
)  # fmt: skip
