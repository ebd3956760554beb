"""Machines that a tolerant design may meet: draws of what nobody modelled, singly and in threes.

Each kind has a size on the rig, and the same size by the laws of the library on the workbench's own
plant, so that one draw is run on both.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.evaluation.rig.parameters import PARAMETERS, elements, nominal
from workbench.study.drawn_machines import in_turn

VALVE = 2.9e-8
"""Conductance of the open valve, beside which lines are narrow, in m3/(s Pa)."""


@dataclass(frozen=True)
class Sized:
    """What one kind of variation is at one size.

    Args:
        rig: Parameters of the rig by name, in SI.
        own: Parameters of the own plant with the effects, by name, in SI.
        effects: Effects of the library that are the same.
    """

    rig: Mapping[str, float]
    own: Mapping[str, float]
    effects: tuple[str, ...] = ()


@dataclass(frozen=True)
class Draw:
    """One drawn machine.

    Args:
        load: Load that a design knows, in kg.
    """

    number: int
    kinds: tuple[str, ...]
    load: float
    parts: tuple[Sized, ...]

    @property
    def name(self) -> str:
        """Name of the draw."""
        return f"draw-{self.number:03d}"

    @property
    def rig(self) -> dict[str, float]:
        """Parameters of the rig, with the hysteresis that every machine has, in SI."""
        given = {"load": self.load, "hyst_force": 10.0, "hyst_slope": 7.0}
        given |= elements(0.2e-3, 4e-3, 8)
        for part in self.parts:
            given |= part.rig
        return nominal(given)


def _effect(rig: str, effect: str, size: str, value: float) -> Sized:
    """Return what one effect is at one size, of the same number in both simulators."""
    return Sized({rig: value}, {f"{effect}.{size}": value}, (effect,))


def _parameter(name: str, value: float) -> Sized:
    return Sized({name: value}, {name: value})


def _line(u: np.random.Generator, _: float) -> Sized:
    open_, volume = VALVE * 10.0 ** u.uniform(-1.0, 0.0), u.uniform(5e-6, 20e-6)
    own = {"lines.share": 1.0, "lines.conductance": open_, "lines.volume": volume}
    return Sized({"line_conductance": open_, "line_volume": volume}, own, ("lines",))


def _friction(u: np.random.Generator, _: float) -> Sized:
    level, more, viscous = u.uniform(0.1, 1.0), u.uniform(0.0, 1.0), u.uniform(0.1, 0.6)
    rig = {"coulomb": level, "stribeck_torque": more, "viscous": viscous}
    own = {"bearing_friction.level": level, "damper.coefficient": viscous}
    return Sized(rig, own | {"stribeck_friction.break_away": more}, ("stribeck_friction",))


def _hysteresis(u: np.random.Generator, _: float) -> Sized:
    size = u.uniform(0.0, 2.0)
    own = {"level": 10.0 * size, "level_per_pressure": 7e-5 * size}
    rig = {"hyst_force": 10.0 * size, "hyst_slope": 7.0 * size}
    return Sized(rig, {f"muscle_hysteresis.{name}": value for name, value in own.items()})


def _creep(u: np.random.Generator, _: float) -> Sized:
    fast, slow = u.uniform(0.0, 0.03), u.uniform(0.0, 0.04)
    own = {"creep.share": fast + slow, "creep.slow_part": slow / (fast + slow)}
    return Sized({"creep_fast": fast, "creep_slow": slow}, own, ("creep",))


def _tendon(u: np.random.Generator, _: float) -> Sized:
    stiffness, viscosity = 10.0 ** u.uniform(5.0, 5.3), u.uniform(200.0, 800.0)
    rig = {"tendon_stiffness": stiffness, "muscle_viscosity": viscosity}
    return Sized(rig, {"series_elasticity.compliance": 1.0 / stiffness}, ("series_elasticity",))


def _loose(u: np.random.Generator, load: float) -> Sized:
    stiffness, damping = 150.0 * 4.0 ** u.uniform(0.0, 1.0), u.uniform(0.3, 1.0)
    inertia = load * PARAMETERS["load_inertia_per_kg"][0]
    own = {
        "loose_load.share": 1.0,
        "loose_load.frequency": math.sqrt(stiffness / inertia),
        "loose_load.damping": damping / (2.0 * math.sqrt(stiffness * inertia)),
    }
    return Sized({"load_stiffness": stiffness, "load_damping": damping}, own, ("loose_load",))


_LEAKS = (
    ("leak_1", "chamber_leakage_1"), ("leak_2", "chamber_leakage_2"),
    ("leak_between", "cross_leakage"),
)  # fmt: skip


def _leak(u: np.random.Generator, _: float) -> Sized:
    return _effect(*_LEAKS[int(u.integers(3))], "conductance", u.uniform(1e-11, 8e-11))


def _valve_offset(u: np.random.Generator, _: float) -> Sized:
    off = u.uniform(-0.25, 0.25)
    return Sized({"valve_centre": 5.0 - off}, {"valve_offset.amount": off}, ("valve_offset",))


def _sensor_offset(u: np.random.Generator, _: float) -> Sized:
    off = dict(zip(("pressure_1", "pressure_2"), u.uniform(-15e3, 15e3, 2).tolist(), strict=True))
    own = {f"sensor_offset_{name}.amount": value for name, value in off.items()}
    rig = {name.replace("_", "_offset_"): value for name, value in off.items()}
    return Sized(rig, own, tuple(f"sensor_offset_{name}" for name in off))


KINDS: dict[str, Callable[[np.random.Generator, float], Sized]] = {
    "delay": lambda u, _: _effect("valve_delay", "valve_delay", "time", u.uniform(0.0, 0.010)),
    "pressure lag": lambda u, _: _effect(
        "pressure_lag", "sensor_lag_pressures", "time", u.uniform(0.0, 0.010)
    ),
    "lines": _line,
    "friction": _friction,
    "hysteresis": _hysteresis,
    "creep": _creep,
    "tendons": _tendon,
    "loose load": _loose,
    "leak": _leak,
    "valve offset": _valve_offset,
    "sensor offsets": _sensor_offset,
    "load": lambda u, load: _parameter("load", max(0.0, load + u.uniform(-2.0, 2.0))),
    "supply": lambda u, _: _parameter("supply_pressure", u.uniform(4.5e5, 7e5)),
}
"""Every kind of variation: delays of 0 to 10 ms, lags of 0 to 10 ms, lines down to a tenth of the
valve, 0.1 to 2 N m of friction, hysteresis up to twice the usual, creep, tendons, a load that
swings, leaks, offsets, 2 kg more or less, 4.5 to 7 bar."""


def draws(count: int, seed: int) -> tuple[Draw, ...]:
    """Draw machines: in turn one kind, each as often as the others, and three kinds at random."""
    load, rng = 3.0, np.random.default_rng(seed)
    return tuple(
        Draw(i, tuple(kinds), load, tuple(KINDS[kind](rng, load) for kind in kinds))
        for i, kinds in enumerate(in_turn(list(KINDS), count, rng))
    )
