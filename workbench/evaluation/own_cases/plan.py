"""Which cases are made: what each hides, how large, and what was recorded."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from workbench.evaluation.answer_key import Names, Truth, read_names
from workbench.evaluation.rig.effects import EFFECTS
from workbench.evaluation.rig.parameters import nominal

SIZES = {name: effect.size for name, effect in EFFECTS.items() if effect.size is not None}
"""Sizes by effect; an effect that is either there or not is not in it."""

WRONG_LOAD_KG = 0.8
"""Error of the noted load at the usual size."""


def sizes(effect: str, factor: float) -> dict[str, float]:
    """Return the rig's parameters, in SI, that give an effect another size, relative to its own.

    They are none for an effect that is either there or not.
    """
    size = SIZES.get(effect)
    if size is None:
        return {}
    absent, full = nominal(), EFFECTS[effect].parameters
    return {
        n: full[n] / factor if size.inverse else absent[n] + factor * (full[n] - absent[n])
        for n in (size.main, *size.others)
    }


@dataclass(frozen=True)
class Counterpart:
    """The parameter of the library that states the same size as one of the rig.

    Args:
        effect: Name in the rig.
        name: Name in the library.
        size: Whether it is the parameter whose zero means absent.
    """

    effect: str
    name: str
    parameter: str
    true: Callable[[Mapping[str, float]], float]
    size: bool = True


def _p(name: str, factor: float = 1.0, less: float = 0.0) -> Callable[[Mapping[str, float]], float]:
    return lambda p: factor * (p[name] - less)


_ALIKE = (
    *(Counterpart(hysteresis, "muscle_hysteresis", "level_per_pressure", _p("hyst_slope", 1e-5))
      for hysteresis in ("hysteresis_maxwell", "hysteresis_bouc_wen", "hysteresis_dahl")),
    Counterpart("muscle_viscosity", "muscle_viscosity", "coefficient", _p("muscle_viscosity")),
    Counterpart("tendon", "series_elasticity", "compliance", lambda p: 1.0 / p["tendon_stiffness"]),
    Counterpart("muscle_mismatch", "force_gain_2", "excess", _p("force_gain_2", less=1.0)),
    Counterpart("stribeck", "stribeck_friction", "break_away", _p("stribeck_torque")),
    Counterpart("load_friction", "load_dependent_friction", "coefficient", _p("load_friction")),
    Counterpart("quadratic_drag", "quadratic_drag", "coefficient", _p("quadratic_drag")),
    Counterpart("tilt", "tilt_gravity", "tilt", _p("tilt")),
    Counterpart("constant_torque", "constant_torque", "amount", _p("constant_torque")),
    Counterpart("parasitic_spring", "linear_spring", "stiffness", _p("spring_torque")),
    Counterpart("cogging", "ripple", "amplitude", _p("cogging_torque")),
    Counterpart("valve_offset", "valve_offset", "amount", lambda p: 5.0 - p["valve_centre"]),
    Counterpart("valve_deadband", "dead_band", "half_width", _p("valve_deadband")),
    Counterpart("valve_play", "play", "half_width", _p("valve_play")),
    Counterpart("valve_delay", "valve_delay", "time", _p("valve_delay")),
    Counterpart("valve_slew", "slew_limit", "largest_rate", _p("valve_slew"), size=False),
    Counterpart("leak_muscle_1", "chamber_leakage_1", "conductance", _p("leak_1")),
    Counterpart("leak_muscle_2", "chamber_leakage_2", "conductance", _p("leak_2")),
    Counterpart("leak_muscle_1", "edge_leakage_exhaust_1", "fraction",
                lambda p: p["leak_1"] / p["conductance"]),
    Counterpart("leak_muscle_2", "edge_leakage_exhaust_2", "fraction",
                lambda p: p["leak_2"] / p["conductance"]),
    Counterpart("loose_load", "loose_load", "frequency",
                lambda p: math.sqrt(p["load_stiffness"] / (p["load"] * p["load_inertia_per_kg"])),
                size=False),
    Counterpart("leak_between", "cross_leakage", "conductance", _p("leak_between")),
    Counterpart("supply_droop", "reservoir_droop", "gain", _p("supply_linear"), size=False),
    Counterpart("line", "lines", "conductance", _p("line_conductance"), size=False),
    Counterpart("silencers", "silencers", "conductance", _p("silencer_conductance"), size=False),
    Counterpart("pressure_lag", "sensor_lag_pressures", "time", _p("pressure_lag")),
    Counterpart("pressure_offset", "sensor_offset_pressure_1", "amount", _p("pressure_offset_1")),
    Counterpart("pressure_gain", "sensor_gain_pressure_2", "excess",
                _p("pressure_gain_2", less=1.0)),
    Counterpart("angle_delay", "sensor_delay_angle", "time", _p("angle_delay")),
    Counterpart("angle_offset", "sensor_offset_angle", "amount",
                _p("angle_offset", math.radians(1.0))),
    Counterpart("angle_gain", "sensor_gain_angle", "excess", _p("angle_gain", less=1.0)),
    Counterpart("angle_lag", "sensor_lag_angle", "time", _p("angle_lag")),
    Counterpart("angle_jump", "sensor_jump_angle", "amount",
                _p("onset_angle_offset", math.radians(1.0))),
    Counterpart("pressure_jump", "sensor_jump_pressure_2", "amount", _p("onset_pressure_offset_2")),
    Counterpart("edge_blocked", "edge_gain_supply_1", "excess", _p("edge_supply_1", less=1.0)),
    Counterpart("viscous_asymmetry", "direction_dependent_viscous", "difference",
                lambda p: 2.0 * p["viscous"] * p["viscous_asymmetry"]),
    Counterpart("cubic_spring", "cubic_stiffness", "stiffness", _p("cubic_spring")),
    Counterpart("local_friction", "local_friction", "level", _p("local_friction")),
    Counterpart("wrong_load", "load_error", "mass", _p("load_error")),
    Counterpart("end_pads", "end_stops", "stiffness", _p("pad_stiffness")),
)  # fmt: skip
COUNTERPARTS = {(c.effect, c.name): c for c in _ALIKE}
"""By effect of the rig and name in the library: where both state the same quantity."""


@cache
def names() -> Names:
    """Return how the rig's words are read."""
    return read_names(Path(__file__).with_name("names.toml"))


OUTSIDE = tuple(name for name in EFFECTS if names().effects[name].outside)
"""Effects of the rig that the library does not have."""

SINGLE = tuple(name for name in EFFECTS if name not in OUTSIDE)
"""Effects of the rig that it has, by other laws in part."""

PAIRS = (
    ("stribeck", "valve_offset"),
    ("tilt", "leak_muscle_1"),
    ("hysteresis_maxwell", "valve_offset"),
    ("supply_droop", "constant_torque"),
    ("pressure_lag", "stribeck"),
    ("valve_asymmetry", "tilt"),
)

TRIPLES = (
    ("stribeck", "leak_muscle_1", "angle_offset"),
    ("hysteresis_maxwell", "valve_deadband", "pressure_gain"),
    ("tilt", "supply_droop", "angle_delay"),
    ("quadratic_drag", "valve_offset", "polytropic"),
    ("cogging", "leak_between", "pressure_lag"),
    ("cubic_spring", "edge_blocked", "angle_jump"),
    ("hysteresis_bouc_wen", "line", "constant_torque"),
    ("muscle_mismatch", "valve_delay", "local_friction"),
    ("creep", "valve_asymmetry", "pressure_offset"),
    ("loose_load", "silencers", "angle_gain"),
    ("load_friction", "leak_muscle_2", "pressure_drift"),
    ("viscous_asymmetry", "valve_play", "isothermal"),
)

FACTORS = (1.0, 0.4, 2.0)
"""Size over the rig's own, turn by turn."""

LOADS_KG = (1.0, 3.0, 5.0)

COLOURED = "coloured noise"
NOISES = {
    COLOURED: {"pressure_noise_time": 0.02},
    "bursts of noise": {"pressure_burst": 6e3},
    "repeated samples": {"angle_dropout": 0.01},
    "coarse encoder": {"angle_step": 0.35},
}
"""What the sensors may do beside white noise: parameters of the rig, in SI."""

FIRST_SEED = 2000
"""Seed of the first case of the plan. Other thousands give other cases of the same kinds: other
background parameters, loads, excitations and noise."""

_STRIDES = (13, 11, 17, 7, 5, 1)


@dataclass(frozen=True)
class Planned:
    """A case to be made.

    Args:
        load: Mass of the plates as noted, in kg.
        kind: ``single``, ``pair``, ``triple``, ``nothing``, ``outside``, or ``limited`` where the
            recordings are closed-loop only.
        factor: Size relative to the rig's own.
        spread: How far the background parameters leave their nominal values, relative to their
            usual range.
        recorded: What is recorded, as `workbench.evaluation.rig.cases.make_case` takes it.
        changes: Parameters of the rig that are set, in SI.
        load_error: What the rig carries beyond the noted load, in kg.
    """

    seed: int
    effects: tuple[str, ...]
    load: float
    kind: str
    factor: float = 1.0
    spread: float = 1.0
    recorded: str = "all"
    changes: dict[str, float] = field(default_factory=dict)
    load_error: float = 0.0

    @property
    def name(self) -> str:
        """Name of the case."""
        return f"own-{self.seed}"

    @property
    def title(self) -> str:
        """What it hides, in a few words."""
        hidden = "+".join(self.effects) or "nothing"
        size = f" x{self.factor:g}" if any(e in SIZES for e in self.effects) else ""
        extra = [] if self.recorded == "all" else [self.recorded]
        extra += [
            words for words, changes in NOISES.items() if changes.items() <= self.changes.items()
        ]
        return hidden + size + (f" ({', '.join(extra)})" if extra else "")

    @property
    def truths(self) -> tuple[Truth, ...]:
        """What it hides, as a round is scored by it."""
        return names().truths(self.name, list(self.effects))


@dataclass(frozen=True)
class _Item:
    effects: tuple[str, ...]
    kind: str
    recorded: str = "all"
    noise: str = ""


_SPECIAL = (
    (
        _Item(("parasitic_spring",), "limited", "narrow"),
        _Item(("stribeck",), "limited", "closed"),
        _Item(("tilt",), "single", noise=COLOURED),
    ),
    (
        _Item((), "limited", "narrow"),
        _Item(("leak_muscle_2",), "limited", "closed"),
        _Item(("quadratic_drag",), "limited", "narrow"),
    ),
    (
        _Item((), "limited", "closed"),
        _Item(("force_shape",), "limited", "narrow"),
        _Item(("valve_offset",), "limited", "closed"),
        _Item(("valve_offset",), "single", noise=COLOURED),
    ),
)
"""Beyond single effects and pairs, turn by turn."""

_NOTHING = 12
"""Cases of each turn that hide nothing."""


def plan(first_seed: int = FIRST_SEED) -> tuple[Planned, ...]:
    """Return three turns of cases, each determined by its seed, in the order in which they are run.

    Each turn has every single effect at one size, some of the pairs, triples and effects outside
    the library, some special cases and one in six with nothing hidden, spread so that any
    beginning of the plan is a fair sample. The seed of the first case is a multiple of 1000.
    """
    cases: list[Planned] = []
    for turn, factor in enumerate(FACTORS):
        single = [name for name in SINGLE if turn == 0 or name in SIZES or name == "wrong_load"]
        pairs = (PAIRS[:3], PAIRS[3:], PAIRS)[turn]
        hidden = [_Item((name,), "single") for name in single]
        hidden += [_Item(pair, "pair") for pair in pairs]
        hidden += [_Item(names, "triple") for names in TRIPLES[turn::3]]
        hidden += [_Item((name,), "outside") for name in OUTSIDE[turn::3]]
        hidden += _SPECIAL[turn]
        noises = [""] * (_NOTHING - len(NOISES)) + list(NOISES)
        nothing = [_Item((), "nothing", noise=noise) for noise in noises]
        placed = 0
        for k, item in enumerate(_strided(hidden)):
            cases.append(_planned(first_seed, len(cases), item, factor))
            if (k + 1) * _NOTHING >= (placed + 1) * len(hidden):
                even = placed % 2 == 0
                cases.append(_planned(first_seed, len(cases), nothing[placed], 1.0, even=even))
                placed += 1
    return tuple(cases)


def _strided(items: list[_Item]) -> list[_Item]:
    """Visit muscles, joint, valve, air and sensors in turn."""
    stride = next(s for s in _STRIDES if math.gcd(s, len(items)) == 1)
    return [items[stride * i % len(items)] for i in range(len(items))]


def _planned(
    first_seed: int, number: int, item: _Item, factor: float, *, even: bool = False
) -> Planned:
    """Give an item its seed, load and sizes; `even` keeps the background nominal."""
    # Several effects at once, those outside the library and limited recordings stay at the rig's
    # own size.
    factor = factor if item.kind == "single" and not item.noise else 1.0
    changes = {n: v for e in item.effects for n, v in sizes(e, factor).items()}
    changes |= NOISES.get(item.noise, {})
    # The same kind of case has another load and the other sign in the next thousand.
    turned = number + (first_seed - FIRST_SEED) // 1000
    sign = 1.0 if turned % 2 else -1.0
    return Planned(
        first_seed + number,
        item.effects,
        LOADS_KG[turned % len(LOADS_KG)],
        item.kind,
        factor,
        (0.0 if even else 2.0) if not item.effects else 1.0,
        item.recorded,
        changes,
        sign * factor * WRONG_LOAD_KG if "wrong_load" in item.effects else 0.0,
    )
