"""Names, units, nominal values and meaning of every number of the rig.

Units: as in the table.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

ELEMENTS = 12
"""Number of Maxwell-slip elements a muscle can have."""


PARAMETERS: dict[str, tuple[float, str, str]] = {
    # arm
    "load": (3.0, "kg", "plates on the arm"),
    "arm_inertia": (0.0556, "kg m^2", "inertia of the bare arm about the axis"),
    "load_inertia_per_kg": (0.367**2 + 0.024**2 + 0.0015, "m^2", "inertia of one kg of plates"),
    "viscous": (0.3, "N m s/rad", "viscous friction of the joint"),
    "coulomb": (0.3, "N m", "Coulomb friction of the joint"),
    "coulomb_speed": (0.02, "rad/s", "speed scale of tanh in the Coulomb friction"),
    "stop_stiffness": (2e4, "N m/rad", "stiffness of the stops"),
    "stop_damping": (60.0, "N m s/rad", "damping of the stops"),
    "vertical": (0.0, "-", "1 for the vertical plane, 0 for the horizontal plane"),
    "tilt": (0.0, "rad", "tilt of the horizontal plane, positive: gravity pulls towards 0 deg"),
    "constant_torque": (0.0, "N m", "constant torque on the joint"),
    "spring_torque": (0.0, "N m/rad", "stiffness of a parasitic spring at rest at 30 deg"),
    "cogging_torque": (0.0, "N m", "amplitude of a torque periodic in the angle"),
    "cogging_periods": (20.0, "1/rev", "periods of the cogging torque per turn"),
    "quadratic_drag": (0.0, "N m s^2/rad^2", "drag torque per squared speed"),
    "cubic_spring": (0.0, "N m/rad^3", "cubic stiffness of a spring at rest at 30 deg"),
    "pad_stiffness": (0.0, "N m/rad", "stiffness of pads before both stops"),
    "pad_reach": (0.15, "rad", "thickness of the pads"),
    "pressure_torque": (0.0, "N m/bar^2", "torque per squared difference of the pressures"),
    "external_torque": (0.0, "N m", "disturbance torque, changed from sample to sample"),
    "load_stiffness": (0.0, "N m/rad", "torsional stiffness of a loose load, 0: rigid"),
    "load_damping": (0.5, "N m s/rad", "damping of the loose load"),
    # friction beyond Coulomb
    "coulomb_asymmetry": (0.0, "-", "share of the Coulomb level more upwards, less downwards"),
    "viscous_asymmetry": (0.0, "-", "share of the viscous friction more upwards, less downwards"),
    "local_friction": (0.0, "N m", "Coulomb level more about one angle"),
    "local_angle": (0.45, "rad", "that angle"),
    "local_width": (0.06, "rad", "width of that place"),
    "stribeck_torque": (0.0, "N m", "break-away torque above the Coulomb level"),
    "stribeck_speed": (0.1, "rad/s", "Stribeck speed"),
    "load_friction": (0.0, "m", "Coulomb torque per newton of (F1 + F2)"),
    "lugre_stiffness": (0.0, "N m/rad", "bristle stiffness; > 0 replaces tanh by LuGre"),
    "lugre_damping": (0.0, "N m s/rad", "bristle damping"),
    # muscles
    "force_gain": (1.0, "-", "factor on the force of both muscles"),
    "force_gain_1": (1.0, "-", "further factor on muscle 1"),
    "force_gain_2": (1.0, "-", "further factor on muscle 2"),
    "force_shape": (0.0, "-", "force changed by this fraction at 30 mm, as the square of q"),
    "slack_width": (1.0, "N", "width of the smooth clamp at zero force"),
    "slack_law": (0.0, "-", "0: (x + sqrt(x^2 + w^2))/2; 1: w log(1 + exp(x/w)); 2: hard"),
    "muscle_viscosity": (0.0, "N s/m", "viscous force along the muscle"),
    "tendon_stiffness": (0.0, "N/m", "series elasticity, 0: rigid (needs muscle_viscosity)"),
    "creep_fast": (0.0, "-", "share of the pressure that acts with the fast creep time"),
    "creep_fast_time": (1.0, "s", "fast creep time"),
    "creep_slow": (0.0, "-", "share of the pressure that acts with the slow creep time"),
    "creep_slow_time": (30.0, "s", "slow creep time"),
    "hyst_force": (0.0, "N", "half width of the hysteresis loop at zero gauge pressure"),
    "hyst_slope": (0.0, "N/bar", "growth of the half width with gauge pressure"),
    "hyst_law": (0.0, "-", "0: Maxwell-slip; 1: Bouc-Wen (Dahl with exponent 1, beta 1)"),
    "hyst_breakaway": (1e-3, "m", "break-away distance of Bouc-Wen and Dahl"),
    "hyst_exponent": (1.0, "-", "exponent of Bouc-Wen"),
    "hyst_beta": (1.0, "-", "share of the |v| term in Bouc-Wen, 0..1"),
    "hyst_share_2": (1.0, "-", "factor on the loop of muscle 2"),
    "hyst_place": (0.0, "-", "0: added after the slack clamp; 1: added before the slack clamp"),
    "tension_only": (0.0, "-", "1: the total force of a muscle is clipped at zero"),
    # gas
    "volume_gain": (1.0, "-", "factor on the muscle volume"),
    "dead_volume": (15e-6, "m^3", "fittings and line of each muscle"),
    "heat_transfer": (150.0, "W/(m^2 K)", "heat exchange of the gas in a muscle"),
    "heat_area": (0.0126, "m^2", "area of the heat exchange"),
    "gas_constant": (287.05, "J/(kg K)", "specific gas constant of air"),
    "gamma": (1.4, "-", "ratio of specific heats"),
    "ambient_temperature": (293.15, "K", "ambient, supply and start temperature"),
    "ambient_pressure": (101325.0, "Pa", "ambient pressure, absolute"),
    "polytropic": (0.0, "-", "exponent of a polytropic gas (1: isothermal), 0: energy balance"),
    "net_enthalpy": (1.0, "-", "1: T_io by the sign of the net flow (paper [11]); 0: by edge"),
    # valve
    "conductance": (2.9e-8, "m^3/(s Pa)", "sonic conductance of a fully open edge"),
    "critical_ratio": (0.23, "-", "critical pressure ratio"),
    "centre_leakage": (0.004, "-", "fraction of the conductance added to each edge"),
    "reference_density": (1.185, "kg/m^3", "density at the reference state of ISO 6358"),
    "reference_temperature": (293.15, "K", "temperature at the reference state of ISO 6358"),
    "edge_supply_1": (1.0, "-", "factor on the edge from the supply to muscle 1"),
    "linear_ratio": (0.995, "-", "pressure ratio above which the flow is linear"),
    "spool_frequency": (95.0, "Hz", "natural frequency of the spool"),
    "spool_damping": (0.7, "-", "damping ratio of the spool"),
    "valve_centre": (5.0, "V", "command at which the spool is in its centre"),
    "valve_deadband": (0.0, "V", "half width of a dead band of the opening"),
    "valve_gain_up": (1.0, "-", "factor on the command above the centre"),
    "valve_slew": (0.0, "V/s", "speed limit of the spool, 0: none"),
    "valve_delay": (0.0, "s", "delay of the command"),
    "valve_stiction": (0.0, "V", "change of the command below which the spool stays"),
    "command_hold": (0.0, "s", "time for which the output card holds a command"),
    "valve_play": (0.0, "V", "half width of a play (hysteresis) of the command"),
    # leaks, supply, lines, silencers
    "leak_1": (0.0, "m^3/(s Pa)", "conductance of a leak of muscle 1 to ambient"),
    "leak_2": (0.0, "m^3/(s Pa)", "conductance of a leak of muscle 2 to ambient"),
    "leak_threshold": (0.0, "Pa", "gauge pressure below which the leak of muscle 1 is shut"),
    "leak_between": (0.0, "m^3/(s Pa)", "conductance of a leak between the muscles"),
    "supply_pressure": (6e5, "Pa", "supply, gauge"),
    "supply_volume": (0.0, "m^3", "reservoir in front of the valve, 0: ideal supply"),
    "supply_conductance": (4e-9, "m^3/(s Pa)", "restriction that refills the reservoir"),
    "supply_linear": (0.0, "kg/(s Pa)", "> 0: refill in proportion to the pressure difference"),
    "silencer_volume": (0.0, "m^3", "volume behind each exhaust port, 0: no silencer"),
    "silencer_conductance": (3e-8, "m^3/(s Pa)", "conductance of a silencer"),
    "line_volume": (0.0, "m^3", "volume between valve and muscle, 0: no line"),
    "line_conductance": (4e-8, "m^3/(s Pa)", "restriction between line and muscle"),
    # sensors
    "pressure_noise": (600.0, "Pa", "rms noise of a pressure sensor"),
    "pressure_noise_time": (0.0, "s", "correlation time of that noise, 0: white"),
    "pressure_step": (240.0, "Pa", "quantisation of a pressure"),
    "pressure_lag": (0.0, "s", "first-order lag of both pressure sensors"),
    "pressure_offset_1": (0.0, "Pa", "offset of pressure sensor 1"),
    "pressure_offset_2": (0.0, "Pa", "offset of pressure sensor 2"),
    "pressure_gain_1": (1.0, "-", "gain of pressure sensor 1"),
    "pressure_gain_2": (1.0, "-", "gain of pressure sensor 2"),
    "pressure_limit": (0.0, "Pa", "largest pressure that sensor 1 reads, 0: any"),
    "pressure_cross": (0.0, "-", "share of the other pressure in each reading"),
    "pressure_burst": (0.0, "Pa", "rms of bursts of noise, some 5 ms long, every second or so"),
    "angle_gain": (1.0, "-", "gain of the angle"),
    "angle_limit": (0.0, "deg", "largest angle that is read, 0: any"),
    "angle_lag": (0.0, "s", "first-order lag of the angle"),
    "angle_play": (0.0, "deg", "half width of a play in the coupling of the encoder"),
    "angle_eccentricity": (0.0, "deg", "amplitude of an angle error with a period of 24 deg"),
    "angle_dropout": (0.0, "-", "share of the samples that repeat the one before"),
    "angle_step": (0.002, "deg", "quantisation of the angle"),
    "angle_delay": (0.0, "s", "delay of the angle"),
    "angle_offset": (0.0, "deg", "offset of the angle"),
    "command_step": (0.00244, "V", "quantisation of the command about 5 V"),
    # what changes with time, applied sample by sample
    "onset": (0.0, "s", "time at which the parameters named onset_... change"),
    "onset_supply_pressure": (0.0, "Pa", "change of the supply"),
    "onset_constant_torque": (0.0, "N m", "change of the constant torque"),
    "onset_coulomb": (0.0, "N m", "change of the Coulomb level"),
    "onset_leak_1": (0.0, "m^3/(s Pa)", "change of the leak of muscle 1"),
    "onset_valve_centre": (0.0, "V", "change of the valve's centre"),
    "onset_load": (0.0, "kg", "change of the load"),
    "onset_angle_offset": (0.0, "deg", "change of the offset of the angle"),
    "onset_pressure_offset_2": (0.0, "Pa", "change of the offset of pressure sensor 2"),
    "force_fade": (0.0, "-", "share of the muscles' force that fades away"),
    "force_fade_time": (12.0, "s", "time constant of the fading"),
    "pressure_drift": (0.0, "Pa/s", "rate at which the offset of pressure sensor 1 changes"),
    "supply_ripple": (0.0, "Pa", "amplitude of a periodic change of the supply"),
    "supply_ripple_frequency": (1.3, "Hz", "its frequency"),
    "hum_torque": (0.0, "N m", "amplitude of a torque periodic in time"),
    "hum_frequency": (3.1, "Hz", "its frequency"),
    "coulomb_drift": (0.0, "N m/s", "rate at which the Coulomb level changes"),
    "supply_drift": (0.0, "Pa/s", "rate at which the supply pressure changes"),
    # disturbance
    "torque_noise": (0.0, "N m", "rms of a coloured disturbance torque"),
    "torque_noise_time": (0.1, "s", "correlation time of the disturbance torque"),
}
PARAMETERS |= {f"hyst_d{i + 1}": (1.0, "m", "break-away distance") for i in range(ELEMENTS)}
PARAMETERS |= {f"hyst_w{i + 1}": (0.0, "-", "share of the half width") for i in range(ELEMENTS)}
"""Nominal value (zero where it means 'switched off'), unit and meaning of every parameter by name;
the order is that of the compiled parameter vector. The last are those of Maxwell-slip elements."""


def nominal(changes: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the nominal parameters with some of them changed; unknown names are refused."""
    values = {name: value for name, (value, _, _) in PARAMETERS.items()}
    for name, value in (changes or {}).items():
        if name not in values:
            raise KeyError(f"unknown rig parameter {name!r}")
        values[name] = float(value)
    return values


def elements(smallest: float, largest: float, count: int = ELEMENTS) -> dict[str, float]:
    """Return parameters of equal Maxwell-slip elements, break-aways between two ends in m."""
    spread = np.geomspace(smallest, largest, count).tolist()
    values: dict[str, float] = {}
    for i in range(ELEMENTS):
        values[f"hyst_d{i + 1}"] = spread[i] if i < count else 1.0
        values[f"hyst_w{i + 1}"] = 1.0 / count if i < count else 0.0
    return values
