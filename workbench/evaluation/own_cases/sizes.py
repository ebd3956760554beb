"""Sizes of hidden effects: which parameters of the rig grow with an effect, and how."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from workbench.evaluation.rig.effects import EFFECTS
from workbench.evaluation.rig.parameters import nominal


@dataclass(frozen=True)
class Size:
    """How an effect grows.

    Args:
        main: The parameter of the rig by which its size is stated.
        inverse: Whether the effect grows as that parameter falls.
        others: Parameters that grow with it.
    """

    main: str
    inverse: bool = False
    others: tuple[str, ...] = ()


_OF_ONE_PARAMETER = (
    "muscle_viscosity", "force_shape", "muscle_mismatch", "stribeck", "load_friction",
    "quadratic_drag", "tilt", "constant_torque", "parasitic_spring", "cogging", "torque_noise",
    "pressure_torque", "coulomb_drift", "supply_drift", "valve_offset", "valve_deadband",
    "valve_play", "valve_delay", "valve_asymmetry", "leak_muscle_1", "leak_muscle_2",
    "leak_between", "pressure_lag", "pressure_offset", "pressure_gain", "angle_delay",
)  # fmt: skip
_HYSTERESES = ("hysteresis_maxwell", "hysteresis_bouc_wen", "hysteresis_dahl")

SIZES: dict[str, Size] = {
    **{name: Size(next(iter(EFFECTS[name].parameters))) for name in _OF_ONE_PARAMETER},
    **{name: Size("hyst_slope", others=("hyst_force",)) for name in _HYSTERESES},
    "creep": Size("creep_fast", others=("creep_slow",)),
    "tendon": Size("tendon_stiffness", inverse=True),
    "lugre": Size("lugre_stiffness", inverse=True),
    "loose_load": Size("load_stiffness", inverse=True),
    "valve_slew": Size("valve_slew", inverse=True),
    "supply_droop": Size("supply_linear", inverse=True),
    "line": Size("line_conductance", inverse=True),
    "silencers": Size("silencer_conductance", inverse=True),
}
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
        size: Whether it is the parameter whose zero means absent.
    """

    parameter: str
    true: Callable[[Mapping[str, float]], float]
    size: bool = True


def _p(name: str, factor: float = 1.0, less: float = 0.0) -> Callable[[Mapping[str, float]], float]:
    return lambda p: factor * (p[name] - less)


COUNTERPARTS: dict[tuple[str, str], Counterpart] = {
    ("hysteresis_bouc_wen", "muscle_hysteresis"): Counterpart(
        "level_per_pressure", _p("hyst_slope", 1e-5)
    ),
    ("hysteresis_dahl", "muscle_hysteresis"): Counterpart(
        "level_per_pressure", _p("hyst_slope", 1e-5)
    ),
    ("hysteresis_maxwell", "muscle_hysteresis"): Counterpart(
        "level_per_pressure", _p("hyst_slope", 1e-5)
    ),
    ("muscle_viscosity", "muscle_viscosity"): Counterpart("coefficient", _p("muscle_viscosity")),
    ("tendon", "series_elasticity"): Counterpart(
        "compliance", lambda p: 1.0 / p["tendon_stiffness"]
    ),
    ("muscle_mismatch", "force_gain_2"): Counterpart("excess", _p("force_gain_2", less=1.0)),
    ("stribeck", "stribeck_friction"): Counterpart("break_away", _p("stribeck_torque")),
    ("load_friction", "load_dependent_friction"): Counterpart("coefficient", _p("load_friction")),
    ("quadratic_drag", "quadratic_drag"): Counterpart("coefficient", _p("quadratic_drag")),
    ("tilt", "tilt_gravity"): Counterpart("tilt", _p("tilt")),
    ("constant_torque", "constant_torque"): Counterpart("amount", _p("constant_torque")),
    ("parasitic_spring", "linear_spring"): Counterpart("stiffness", _p("spring_torque")),
    ("cogging", "ripple"): Counterpart("amplitude", _p("cogging_torque")),
    ("valve_offset", "valve_offset"): Counterpart("amount", lambda p: 5.0 - p["valve_centre"]),
    ("valve_deadband", "dead_band"): Counterpart("half_width", _p("valve_deadband")),
    ("valve_play", "play"): Counterpart("half_width", _p("valve_play")),
    ("valve_delay", "valve_delay"): Counterpart("time", _p("valve_delay")),
    ("valve_slew", "slew_limit"): Counterpart("largest_rate", _p("valve_slew"), size=False),
    ("leak_muscle_1", "chamber_leakage_1"): Counterpart("conductance", _p("leak_1")),
    ("leak_muscle_2", "chamber_leakage_2"): Counterpart("conductance", _p("leak_2")),
    ("leak_muscle_1", "edge_leakage_exhaust_1"): Counterpart(
        "fraction", lambda p: p["leak_1"] / p["conductance"]
    ),
    ("leak_muscle_2", "edge_leakage_exhaust_2"): Counterpart(
        "fraction", lambda p: p["leak_2"] / p["conductance"]
    ),
    ("loose_load", "loose_load"): Counterpart(
        "frequency",
        lambda p: math.sqrt(p["load_stiffness"] / (p["load"] * p["load_inertia_per_kg"])),
        size=False,
    ),
    ("leak_between", "cross_leakage"): Counterpart("conductance", _p("leak_between")),
    ("supply_droop", "reservoir_droop"): Counterpart("gain", _p("supply_linear"), size=False),
    ("line", "lines"): Counterpart("conductance", _p("line_conductance"), size=False),
    ("silencers", "silencers"): Counterpart("conductance", _p("silencer_conductance"), size=False),
    ("pressure_lag", "sensor_lag_pressures"): Counterpart("time", _p("pressure_lag")),
    ("pressure_offset", "sensor_offset_pressure_1"): Counterpart("amount", _p("pressure_offset_1")),
    ("pressure_gain", "sensor_gain_pressure_2"): Counterpart(
        "excess", _p("pressure_gain_2", less=1.0)
    ),
    ("angle_delay", "sensor_delay_angle"): Counterpart("time", _p("angle_delay")),
    ("angle_offset", "sensor_offset_angle"): Counterpart(
        "amount", _p("angle_offset", math.radians(1.0))
    ),
    ("angle_gain", "sensor_gain_angle"): Counterpart("excess", _p("angle_gain", less=1.0)),
    ("angle_lag", "sensor_lag_angle"): Counterpart("time", _p("angle_lag")),
    ("angle_jump", "sensor_jump_angle"): Counterpart(
        "amount", _p("onset_angle_offset", math.radians(1.0))
    ),
    ("pressure_jump", "sensor_jump_pressure_2"): Counterpart(
        "amount", _p("onset_pressure_offset_2")
    ),
    ("edge_blocked", "edge_gain_supply_1"): Counterpart("excess", _p("edge_supply_1", less=1.0)),
    ("viscous_asymmetry", "direction_dependent_viscous"): Counterpart(
        "difference", lambda p: 2.0 * p["viscous"] * p["viscous_asymmetry"]
    ),
    ("cubic_spring", "cubic_stiffness"): Counterpart("stiffness", _p("cubic_spring")),
    ("local_friction", "local_friction"): Counterpart("level", _p("local_friction")),
    ("wrong_load", "load_error"): Counterpart("mass", _p("load_error")),
}
"""By effect of the rig and name in the library: where both state the same quantity."""
