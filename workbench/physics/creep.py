"""Creep and relaxation: signals with a memory that fades.

After a step a creeping signal is 1 - share of its final value at once and creeps to it, with two
time constants: a standard linear solid. A Maxwell element is a spring in series with a damper: it
resists what is quick as a spring does and lets go of what is slow. Eddy currents beside a coil
hold its flux: its current follows a step of the voltage more quickly at first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from workbench.model import PortView, State
from workbench.model.regularisation import Expression
from workbench.model.units import per
from workbench.physics.law import Fit, Law, Own, each, first_of, gain_of, shape, size, twins
from workbench.physics.place import EFFORTS, Place
from workbench.physics.survey import Survey


def _late(at: PortView) -> Expression:
    slow = at.p.slow_part
    late = (1.0 - slow) * (at.value - at.x.fast) + slow * (at.value - at.x.slow)
    return at.p.share * late


creep = Law(
    "creep",
    "y = u - share [(1 - s)(u - m1) + s (u - m2)], dm/dt = (u - m) / tau",
    first_of(twins("muscle_force"), each("force", "acceleration")),
    lambda at: (
        size("share", "1", 0.02, 1.0, "part that arrives late", signed=True),
        shape("slow_part", "1", 0.5, "part of the share with the slow time constant",
              between=(0.0, 1.0)),
        shape("time_constant", "s", at.horizon, "fast time constant"),
        shape("slow_time_constant", "s", 30.0 * at.horizon, "slow time constant", refined=True),
    ),
    lambda at: at.value - _late(at),
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
    usual=True,
    source="standard linear solid, C. Zener 1948; creep of rubber tubes in braided muscles",
    look_alikes=("maxwell_slip_hysteresis", "chamber_leakage", "sensor_drift"),
    separated_by="hold valve and angle for a minute after a step of pressure",
)  # fmt: skip


# A coil of L beside a turn of R', L' and mutual inductance M: share = M^2 / (L L' - M^2), of one
# time constant, L' / R' / (1 + share).
eddy_currents = replace(
    creep,
    name="eddy_currents",
    equation="y = u + share [(1 - s)(u - m1) + s (u - m2)], dm/dt = (u - m) / tau",
    where=each("circuit", only=lambda at: at.whole),
    parameters=lambda at: (
        size("share", "1", 0.05, 5.0, "part by which the current rises more quickly at first"),
        *creep.parameters(at)[1:],
    ),
    transform=lambda at: at.value + _late(at),
    usual=False,
    source="M. Faraday 1832: what a coil induces in iron, shields and sheets beside it",
    look_alikes=("saturating_inductance", "slow_response"),
    separated_by="steps of the voltage that are held for ten time constants",
)


def _element(at: Place) -> tuple[Own, ...]:
    typical = 0.1 * at.scale / at.coordinate.scale
    return (
        size("stiffness", per(at.unit, at.coordinate.unit), typical, 100 * typical,
             "stiffness of the spring", resists=True),
        shape("time_constant", "s", at.horizon, "damping of the damper over the stiffness",
              around=(0.01, 30.0)),
    )  # fmt: skip


maxwell_element = Law(
    "maxwell_element",
    "T = -stiffness (x - z), dz/dt = (x - z) / time_constant",
    each(*EFFORTS, needs=("coordinate",)),
    _element,
    lambda at: at.value - at.p.stiffness * (at.signals.coordinate - at.x.released),
    states=lambda at: (
        State("released", at.coordinate.unit, at.coordinate.scale,
              f"position at which the element at {at.name} would rest"),
    ),
    rates=lambda e: {"released": (e.here.signals.coordinate - e.x.released) / e.p.time_constant},
    start=lambda e: {"released": e.here.signals.coordinate},
    shapes=lambda at: [{"time_constant": part * at.horizon} for part in (0.1, 0.5, 2.0)],
    source="J. C. Maxwell 1867; rubber mounts and bushings",
    look_alikes=("viscous_friction", "linear_spring", "creep", "bouc_wen_hysteresis"),
    separated_by="quick steps that are held, and motions of the same amplitude at several speeds",
)  # fmt: skip


def _read_at_once(survey: Survey) -> Iterator[Fit]:
    """Yield sensors with the inputs that they read at once, or the state that another reads."""
    for place in survey.fitting("measurement"):
        for cause in () if place.commanded else (*survey.causes(place), *survey.read_too(place)):
            own = place.output.name if place.output else place.port.group
            site = place.with_signal("cause", cause)
            yield f"_{own}_{cause.source}", ((site,),)


# A voltage that follows a current at once, and goes on when it has settled: diffusion in a cell. A
# field that follows the current of its coil, once what that induces beside it has died out.
slow_response = Law(
    "slow_response",
    "y = y + gain z, dz/dt = (u - z) / time_constant",
    _read_at_once,
    lambda at: (
        gain_of(at, at.other("cause"), 0.05, "slow part of the response"),
        shape("time_constant", "s", 0.1 * at.lasting, "time constant", around=(1e-3, 10.0)),
    ),
    lambda at: at.value + at.p.gain * at.x.passed,
    states=lambda at: (
        State("passed", at.other("cause").unit, at.other("cause").scale,
              f"what {at.name} has followed of its cause", start_rms=at.other("cause").scale),
    ),
    rates=lambda e: {"passed": (e.here.signals.cause - e.x.passed) / e.p.time_constant},
    start=lambda e: {"passed": 0.0 * e.here.signals.cause},
    shapes=lambda at: [{"time_constant": part * at.lasting} for part in (0.1, 0.02, 0.3)],
    source="second pair of resistance and capacity of a cell, G. L. Plett 2015; eddy currents",
    look_alikes=("sensor_drift", "linear_outflow", "creep"),
    separated_by="a step that is held for several time constants, and a rest as long",
)  # fmt: skip
