"""Machines that a tolerant design may meet: draws of what nobody modelled, singly and in threes.

Each kind has a size on the rig, and the same size by the laws of the library on the workbench's own
plant, so that one draw is run on both.

Units: SI.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from workbench.evaluation.rig.parameters import PARAMETERS, elements, nominal
from workbench.study.differences import in_turn

VALVE = 2.9e-8
"""Conductance of the open valve, beside which lines are narrow, in m3/(s Pa)."""

Pairs = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Sized:
    """What one kind of variation is at one size.

    Args:
        rig: Parameters of the rig by name, in SI.
        effects: Effects of the library that are the same.
        own: Parameters of the own plant with them, in SI.
    """

    rig: Pairs
    effects: tuple[str, ...] = ()
    own: Pairs = ()


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
            given |= dict(part.rig)
        return nominal(given)


def _delay(u: np.random.Generator, _: float) -> Sized:
    time = u.uniform(0.0, 0.010)
    return Sized((("valve_delay", time),), ("valve_delay",), (("valve_delay.time", time),))


def _lag(u: np.random.Generator, _: float) -> Sized:
    time, own = u.uniform(0.0, 0.010), "sensor_lag_pressures"
    return Sized((("pressure_lag", time),), (own,), ((f"{own}.time", time),))


def _line(u: np.random.Generator, _: float) -> Sized:
    open_, volume = VALVE * 10.0 ** u.uniform(-1.0, 0.0), u.uniform(5e-6, 20e-6)
    own = (("lines.share", 1.0), ("lines.conductance", open_), ("lines.volume", volume))
    return Sized((("line_conductance", open_), ("line_volume", volume)), ("lines",), own)


def _friction(u: np.random.Generator, _: float) -> Sized:
    level, more, viscous = u.uniform(0.1, 1.0), u.uniform(0.0, 1.0), u.uniform(0.1, 0.6)
    rig = (("coulomb", level), ("stribeck_torque", more), ("viscous", viscous))
    own = (
        ("bearing_friction.level", level),
        ("stribeck_friction.break_away", more),
        ("damper.coefficient", viscous),
    )
    return Sized(rig, ("stribeck_friction",), own)


def _hysteresis(u: np.random.Generator, _: float) -> Sized:
    size = u.uniform(0.0, 2.0)
    own = (
        ("muscle_hysteresis.level", 10.0 * size),
        ("muscle_hysteresis.level_per_pressure", 7e-5 * size),
    )
    return Sized((("hyst_force", 10.0 * size), ("hyst_slope", 7.0 * size)), (), own)


def _creep(u: np.random.Generator, _: float) -> Sized:
    fast, slow = u.uniform(0.0, 0.03), u.uniform(0.0, 0.04)
    own = (("creep.share", fast + slow), ("creep.slow_part", slow / (fast + slow)))
    return Sized((("creep_fast", fast), ("creep_slow", slow)), ("creep",), own)


def _tendon(u: np.random.Generator, _: float) -> Sized:
    stiffness, viscosity = 10.0 ** u.uniform(5.0, 5.3), u.uniform(200.0, 800.0)
    rig = (("tendon_stiffness", stiffness), ("muscle_viscosity", viscosity))
    own = (("series_elasticity.compliance", 1.0 / stiffness),)
    return Sized(rig, ("series_elasticity",), own)


def _loose(u: np.random.Generator, load: float) -> Sized:
    stiffness, damping = 150.0 * 4.0 ** u.uniform(0.0, 1.0), u.uniform(0.3, 1.0)
    inertia = load * PARAMETERS["load_inertia_per_kg"][0]
    own = (
        ("loose_load.share", 1.0),
        ("loose_load.frequency", math.sqrt(stiffness / inertia)),
        ("loose_load.damping", damping / (2.0 * math.sqrt(stiffness * inertia))),
    )
    return Sized((("load_stiffness", stiffness), ("load_damping", damping)), ("loose_load",), own)


def _leak(u: np.random.Generator, _: float) -> Sized:
    where = int(u.integers(3))
    rig = ("leak_1", "leak_2", "leak_between")[where]
    own = ("chamber_leakage_1", "chamber_leakage_2", "cross_leakage")[where]
    size = u.uniform(1e-11, 8e-11)
    return Sized(((rig, size),), (own,), ((f"{own}.conductance", size),))


def _valve_offset(u: np.random.Generator, _: float) -> Sized:
    off = u.uniform(-0.25, 0.25)
    return Sized((("valve_centre", 5.0 - off),), ("valve_offset",), (("valve_offset.amount", off),))


def _sensor_offset(u: np.random.Generator, _: float) -> Sized:
    off = u.uniform(-15e3, 15e3, 2).tolist()
    names = ("sensor_offset_pressure_1", "sensor_offset_pressure_2")
    rig = tuple(zip(("pressure_offset_1", "pressure_offset_2"), off, strict=True))
    return Sized(rig, names, tuple((f"{n}.amount", v) for n, v in zip(names, off, strict=True)))


def _load(u: np.random.Generator, load: float) -> Sized:
    pair = ("load", max(0.0, load + u.uniform(-2.0, 2.0)))
    return Sized((pair,), (), (pair,))


def _supply(u: np.random.Generator, _: float) -> Sized:
    pair = ("supply_pressure", u.uniform(4.5e5, 7e5))
    return Sized((pair,), (), (pair,))


KINDS: dict[str, Callable[[np.random.Generator, float], Sized]] = {
    "delay": _delay,
    "pressure lag": _lag,
    "lines": _line,
    "friction": _friction,
    "hysteresis": _hysteresis,
    "creep": _creep,
    "tendons": _tendon,
    "loose load": _loose,
    "leak": _leak,
    "valve offset": _valve_offset,
    "sensor offsets": _sensor_offset,
    "load": _load,
    "supply": _supply,
}
"""Every kind of variation: delays of 0 to 10 ms, lags of 0 to 10 ms, lines down to a tenth of the
valve, 0.1 to 2 N m of friction, hysteresis up to twice the usual, creep, tendons, a load that
swings, leaks, offsets, 2 kg more or less, 4.5 to 7 bar."""


def draws(count: int, seed: int) -> tuple[Draw, ...]:
    """Draw machines: in turn one kind, each as often as the others, and three kinds at random."""
    load = 3.0
    rng, found = np.random.default_rng(seed), []
    for i, kinds in enumerate(in_turn(list(KINDS), count, rng)):
        parts = tuple(KINDS[kind](rng, load) for kind in kinds)
        found.append(Draw(i, tuple(kinds), load, parts))
    return tuple(found)
