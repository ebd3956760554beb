"""Hidden effects: where each acts and which parameters, at what size, switch it on.

Units: SI.
"""

from __future__ import annotations

from dataclasses import dataclass

from workbench.evaluation.rig.parameters import elements


@dataclass(frozen=True)
class Effect:
    """One physical effect: the port where it acts and the parameters it sets."""

    where: str
    words: str
    parameters: dict[str, float]


EFFECTS: dict[str, Effect] = {
    "hysteresis_maxwell": Effect(
        "muscles", "rate-independent hysteresis of the muscle force, Maxwell-slip",
        {"hyst_force": 10.0, "hyst_slope": 7.0, **elements(0.2e-3, 4e-3, 8)},
    ),
    "hysteresis_bouc_wen": Effect(
        "muscles", "hysteresis of the muscle force, Bouc-Wen",
        {"hyst_force": 10.0, "hyst_slope": 7.0, "hyst_law": 1.0, "hyst_beta": 0.5},
    ),
    "hysteresis_dahl": Effect(
        "muscles", "hysteresis of the muscle force, Dahl",
        {"hyst_force": 10.0, "hyst_slope": 7.0, "hyst_law": 1.0},
    ),
    "creep": Effect(
        "muscles", "part of the force follows the pressure late",
        {"creep_fast": 0.015, "creep_slow": 0.02},
    ),
    "muscle_viscosity": Effect("muscles", "viscous muscles", {"muscle_viscosity": 400.0}),
    "tendon": Effect(
        "muscles", "elastic tendons in series with viscous muscles",
        {"tendon_stiffness": 1.5e5, "muscle_viscosity": 300.0},
    ),
    "force_shape": Effect("muscles", "stronger at large contraction", {"force_shape": 0.3}),
    "muscle_mismatch": Effect("muscle 2", "muscle 2 is weaker", {"force_gain_2": 0.93}),
    "stribeck": Effect("joint", "break-away above Coulomb", {"stribeck_torque": 1.2}),
    "lugre": Effect(
        "joint", "dry friction with presliding",
        {"lugre_stiffness": 300.0, "lugre_damping": 2.0, "stribeck_torque": 0.5},
    ),
    "load_friction": Effect("joint", "friction grows with the load", {"load_friction": 3e-4}),
    "quadratic_drag": Effect("joint", "quadratic drag", {"quadratic_drag": 0.15}),
    "tilt": Effect("joint", "the plane is not level", {"tilt": 0.08}),
    "constant_torque": Effect("joint", "constant torque", {"constant_torque": 0.8}),
    "parasitic_spring": Effect("joint", "a spring acts on the joint", {"spring_torque": 1.5}),
    "cogging": Effect("joint", "torque periodic in the angle", {"cogging_torque": 0.4}),
    "loose_load": Effect("joint", "the load is not rigid", {"load_stiffness": 150.0}),
    "torque_noise": Effect("joint", "random torque", {"torque_noise": 0.2}),
    "pressure_torque": Effect(
        "joint", "torque with the square of the pressure difference", {"pressure_torque": 0.12}
    ),
    "coulomb_drift": Effect("joint", "the bearing gets stiffer", {"coulomb_drift": 0.04}),
    "supply_drift": Effect("supply", "the supply falls slowly", {"supply_drift": -2e3}),
    "valve_offset": Effect("valve", "the centre is not at 5 V", {"valve_centre": 4.85}),
    "valve_deadband": Effect("valve", "dead band", {"valve_deadband": 0.15}),
    "valve_play": Effect("valve", "play of the command", {"valve_play": 0.03}),
    "valve_slew": Effect("valve", "the spool has a top speed", {"valve_slew": 120.0}),
    "valve_delay": Effect("valve", "the command comes late", {"valve_delay": 0.012}),
    "valve_asymmetry": Effect("valve", "unequal gains", {"valve_gain_up": 0.88}),
    "leak_muscle_1": Effect("chamber 1", "muscle 1 leaks", {"leak_1": 8e-11}),
    "leak_muscle_2": Effect("chamber 2", "muscle 2 leaks", {"leak_2": 8e-11}),
    "leak_between": Effect("chambers", "leak between the muscles", {"leak_between": 8e-11}),
    "supply_droop": Effect(
        "supply", "the supply falls while flow is drawn",
        {"supply_volume": 4.5e-4, "supply_linear": 3.1e-9},
    ),
    "line": Effect(
        "chambers", "restriction and volume between valve and muscle",
        {"line_volume": 15e-6, "line_conductance": 2e-8},
    ),
    "silencers": Effect(
        "valve", "the exhaust ports see a back pressure",
        {"silencer_volume": 15e-6, "silencer_conductance": 6e-9},
    ),
    "isothermal": Effect("chambers", "isothermal gas", {"polytropic": 1.0}),
    "polytropic": Effect("chambers", "polytropic gas", {"polytropic": 1.2}),
    "pressure_lag": Effect("pressure sensors", "slow sensors", {"pressure_lag": 0.04}),
    "pressure_offset": Effect("pressure sensors", "offset", {"pressure_offset_1": 1.2e4}),
    "pressure_gain": Effect("pressure sensors", "gain", {"pressure_gain_2": 1.03}),
    "angle_delay": Effect("angle sensor", "late angle", {"angle_delay": 0.015}),
    "angle_offset": Effect("angle sensor", "offset", {"angle_offset": 1.5}),
    "angle_gain": Effect("angle sensor", "gain", {"angle_gain": 1.04}),
    "angle_clipping": Effect("angle sensor", "end of range", {"angle_limit": 42.0}),
    "angle_lag": Effect("angle sensor", "slow sensor", {"angle_lag": 0.03}),
    "angle_jump": Effect("angle sensor", "slips once", {"onset": 7.0, "onset_angle_offset": 1.0}),
    "pressure_clipping": Effect(
        "pressure sensors", "end of range of sensor 1", {"pressure_limit": 3.6e5}
    ),
    "pressure_drift": Effect("pressure sensors", "sensor 1 drifts", {"pressure_drift": 1.5e3}),
    "pressure_jump": Effect(
        "pressure sensors", "sensor 2 jumps", {"onset": 9.0, "onset_pressure_offset_2": 1.5e4}
    ),
    "edge_blocked": Effect("valve", "the edge that fills muscle 1", {"edge_supply_1": 0.7}),
    "viscous_asymmetry": Effect("joint", "drag by direction", {"viscous_asymmetry": 0.7}),
    "local_friction": Effect("joint", "tight at one angle", {"local_friction": 1.0}),
    "cubic_spring": Effect("joint", "progressive spring", {"cubic_spring": 14.0}),
    "hysteresis_one": Effect(
        "muscles", "hysteresis of muscle 1 alone",
        {"hyst_force": 15.0, "hyst_slope": 12.0, "hyst_law": 1.0, "hyst_beta": 0.5,
         "hyst_share_2": 0.0},
    ),
    "supply_jump": Effect(
        "supply", "the supply falls once", {"onset": 8.0, "onset_supply_pressure": -0.8e5}
    ),
    "torque_jump": Effect(
        "joint", "a torque begins", {"onset": 8.0, "onset_constant_torque": 0.8}
    ),
    "valve_jump": Effect(
        "valve", "the centre jumps", {"onset": 8.0, "onset_valve_centre": -0.12}
    ),
    "load_jump": Effect("joint", "a plate is put on", {"onset": 8.0, "onset_load": 0.8}),
    "coulomb_jump": Effect("joint", "a seal seizes", {"onset": 8.0, "onset_coulomb": 0.8}),
    "force_fade": Effect("muscles", "muscles get weaker", {"force_fade": 0.06}),
    "leak_jump": Effect("chamber 1", "a leak begins", {"onset": 8.0, "onset_leak_1": 1e-10}),
    "leak_crack": Effect(
        "chamber 1", "a leak that opens with pressure", {"leak_1": 2e-10, "leak_threshold": 3.2e5}
    ),
    "coulomb_asymmetry": Effect("joint", "dry by direction", {"coulomb_asymmetry": 0.9}),
    "end_pads": Effect("joint", "pads before the stops", {"pad_stiffness": 25.0}),
    "hum": Effect("joint", "torque periodic in time", {"hum_torque": 0.5}),
    "supply_ripple": Effect("supply", "a compressor is heard", {"supply_ripple": 0.3e5}),
    "valve_stiction": Effect("valve", "the spool sticks", {"valve_stiction": 0.12}),
    "command_hold": Effect("valve", "commands are held for long", {"command_hold": 0.02}),
    "angle_play": Effect("angle sensor", "loose coupling", {"angle_play": 0.4}),
    "angle_eccentricity": Effect("angle sensor", "off centre", {"angle_eccentricity": 0.6}),
    "pressure_cross": Effect("pressure sensors", "cross-talk", {"pressure_cross": 0.03}),
    "wrong_load": Effect("joint", "the load differs from the notes", {}),
}  # fmt: skip
"""Every effect by name.  `wrong_load` is applied by `cases.make_case` to the load itself."""


def switch_on(
    parameters: dict[str, float], names: list[str], sizes: dict[str, float] | None = None
) -> dict[str, float]:
    """Return the parameters with effects switched on; `sizes` overrides single parameters."""
    values = dict(parameters)
    for name in names:
        if name not in EFFECTS:
            raise KeyError(f"unknown effect {name!r}; known: {', '.join(EFFECTS)}")
        values.update(EFFECTS[name].parameters)
    for name, value in (sizes or {}).items():
        if name not in values:
            raise KeyError(f"unknown rig parameter {name!r}")
        values[name] = value
    return values
