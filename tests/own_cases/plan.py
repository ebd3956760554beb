"""Which cases are made: what is hidden in each, and which answers count as right."""

from __future__ import annotations

from dataclasses import dataclass

ANSWERS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    # effect of the rig: (names in the library, components of the right ports)
    "hysteresis_maxwell": (("maxwell_slip_hysteresis", "muscle_hysteresis"), ("muscle",)),
    "hysteresis_bouc_wen": (("maxwell_slip_hysteresis", "muscle_hysteresis"), ("muscle",)),
    "hysteresis_dahl": (("maxwell_slip_hysteresis", "muscle_hysteresis"), ("muscle",)),
    "creep": (("creep",), ("muscle",)),
    "tendon": (("series_elasticity",), ("muscle",)),
    "force_shape": (
        ("force_shape", "contraction_force_correction", "pressure_force_correction"),
        ("muscle",),
    ),
    "muscle_mismatch": (("force_gain_1", "force_gain_2"), ("muscle", "joint")),
    "stribeck": (("stribeck_friction",), ("joint",)),
    "lugre": (("lugre_friction", "stribeck_friction", "joint_hysteresis"), ("joint",)),
    "load_friction": (("load_dependent_friction", "pressure_friction"), ("joint", "muscle")),
    "quadratic_drag": (("quadratic_drag",), ("joint",)),
    "tilt": (("tilt_gravity",), ("joint",)),
    "constant_torque": (("constant_torque",), ("joint",)),
    "parasitic_spring": (("linear_spring",), ("joint",)),
    "cogging": (("ripple",), ("joint",)),
    "loose_load": (("loose_load",), ("joint",)),
    "valve_offset": (("valve_offset",), ("valve",)),
    "valve_deadband": (("dead_band",), ("valve",)),
    "valve_play": (("play", "spool_hysteresis"), ("valve",)),
    "valve_slew": (("slew_limit",), ("valve",)),
    "valve_delay": (("valve_delay",), ("valve",)),
    "valve_asymmetry": (("asymmetric_gain",), ("valve",)),
    "leak_muscle_1": (("chamber_leakage_1", "edge_leakage_exhaust_1"), ("chamber_1", "valve")),
    "leak_muscle_2": (("chamber_leakage_2", "edge_leakage_exhaust_2"), ("chamber_2", "valve")),
    "leak_between": (("cross_leakage",), ("chamber_1", "chamber_2")),
    "supply_droop": (("reservoir_droop", "supply_droop", "regulator_droop"), ("supply",)),
    "silencers": (("silencers", "silencer_1", "silencer_2"), ("exhaust_1", "exhaust_2")),
    "isothermal": (("polytropic_exchange", "extra_heat_exchange"), ("chamber_1", "chamber_2")),
    "polytropic": (("polytropic_exchange", "extra_heat_exchange"), ("chamber_1", "chamber_2")),
    "pressure_lag": (("sensor_lag_pressures",), ("pressure_1", "pressure_2")),
    "pressure_offset": (("sensor_offset_pressure_1",), ("pressure_1",)),
    "pressure_gain": (("sensor_gain_pressure_2",), ("pressure_2",)),
    "angle_delay": (("sensor_delay_angle", "sensor_lag_angle"), ("angle",)),
    "wrong_load": (("load_error",), ("joint",)),
}

SINGLE = tuple(ANSWERS)

PAIRS = (
    ("stribeck", "valve_offset"),
    ("tilt", "leak_muscle_1"),
    ("hysteresis_maxwell", "valve_offset"),
    ("supply_droop", "constant_torque"),
    ("pressure_lag", "stribeck"),
    ("valve_asymmetry", "tilt"),
)


@dataclass(frozen=True)
class Planned:
    """A case to be made.

    Args:
        seed: Seed of background parameters, excitation and noise.
        effects: What is hidden, by the rig's names.
        load: Mass of the plates, in kg.
    """

    seed: int
    effects: tuple[str, ...]
    load: float

    @property
    def name(self) -> str:
        """Name of the case."""
        return f"own-{self.seed:03d}"


def plan(rounds: int = 3) -> tuple[Planned, ...]:
    """Return the cases, those that hide nothing spread among the others.

    Args:
        rounds: How often each effect and each pair appears, each time with other parameters.

    Returns:
        ``rounds`` times every single effect and every pair, and one in four with nothing hidden.
    """
    cases: list[Planned] = []
    for turn in range(rounds):
        hidden: list[tuple[str, ...]] = [(name,) for name in SINGLE] + list(PAIRS)
        # A fixed stride visits valve, joint, muscles and sensors in turn.
        order = [(7 * i + 3 * turn) % len(hidden) for i in range(len(hidden))]
        for i, k in enumerate(dict.fromkeys(order)):
            cases.append(_planned(len(cases), hidden[k]))
            if i % 3 == 2:
                cases.append(_planned(len(cases), ()))
    return tuple(cases)


def _planned(number: int, effects: tuple[str, ...]) -> Planned:
    return Planned(1000 + number, effects, (1.0, 3.0, 5.0)[number % 3])
