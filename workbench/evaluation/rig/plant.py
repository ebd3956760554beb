"""State vector of the rig and its time derivative in plain Python.

The gas of a muscle is described by its mass m and its internal energy U:

    dU/dt = c_p sum(flow T_carried) - p dV/dt - h S (T - T_ambient),
    p = (gamma - 1) U / V,   T = U / (m c_v).

Reservoir, lines and silencers are isothermal volumes with the mass as state.

Units: SI.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import arm, friction, hysteresis, muscle, valve
from workbench.evaluation.rig.parameters import ELEMENTS

STATES: list[str] = [
    "angle", "speed", "mass_1", "energy_1", "mass_2", "energy_2", "spool", "spool_speed",
    "reservoir", "exhaust_1", "exhaust_2", "line_1", "line_2", "bristle",
    *(f"slip_1_{i + 1}" for i in range(ELEMENTS)),
    *(f"slip_2_{i + 1}" for i in range(ELEMENTS)),
    "memory_1", "memory_2", "creep_fast_1", "creep_slow_1", "creep_fast_2", "creep_slow_2",
    "load_angle", "load_speed", "fibre_1", "fibre_2",
]  # fmt: skip
INDEX = {name: i for i, name in enumerate(STATES)}
SLIP_1, SLIP_2 = INDEX["slip_1_1"], INDEX["slip_2_1"]


def namespace(parameters: dict[str, float]) -> SimpleNamespace:
    """Return the parameters as attributes, with the slip elements gathered."""
    p = SimpleNamespace(**parameters)
    used = [i for i in range(ELEMENTS) if parameters[f"hyst_w{i + 1}"] != 0.0]
    p.slip = [(i, parameters[f"hyst_d{i + 1}"], parameters[f"hyst_w{i + 1}"]) for i in used]
    p.cv = p.gas_constant / (p.gamma - 1.0)
    return p


def active(p: SimpleNamespace) -> list[int]:
    """Return the indices of the states that the switched-on effects use."""
    used = set(range(INDEX["spool_speed"] + 1))
    switches = {
        "reservoir": p.supply_volume, "exhaust": p.silencer_volume, "line": p.line_volume,
        "bristle": p.lugre_stiffness, "memory": p.hyst_law, "load_": p.load_stiffness,
        "fibre": p.tendon_stiffness,
        "creep": abs(p.creep_fast) + abs(p.creep_slow), "slip": len(p.slip),
    }  # fmt: skip
    for name, i in INDEX.items():
        if any(name.startswith(start) and value > 0 for start, value in switches.items()):
            used.add(i)
    spare = {b + i for b in (SLIP_1, SLIP_2) for i in range(ELEMENTS)}
    spare -= {b + i for b in (SLIP_1, SLIP_2) for i, _, _ in p.slip}
    return sorted(used - spare)


def lengths(
    x: NDArray[np.float64] | list[float], p: SimpleNamespace
) -> list[tuple[float, float, float]]:
    """Return for both muscles the distance, its slope over the angle, and the fibre length."""
    result = []
    for k, (a, sign) in enumerate(((x[0], 1.0), (arm.SPAN - x[0], -1.0))):
        total = arm.distance(a)
        s = x[INDEX["fibre_1"] + k] if p.tendon_stiffness > 0 else total - arm.FITTINGS
        result.append((total, sign * arm.distance_slope(a), s))
    return result


def initial(
    angle_deg: float,
    gauge_bar: tuple[float, float],
    parameters: dict[str, float],
    *,
    spool: float = 0.0,
) -> NDArray[np.float64]:
    """Return a state at rest."""
    p = namespace(parameters)
    x = np.zeros(len(STATES))
    x[0] = x[INDEX["load_angle"]] = np.radians(angle_deg)
    x[INDEX["spool"]] = spool
    rt = p.gas_constant * p.ambient_temperature
    supply = p.supply_pressure + p.ambient_pressure
    x[INDEX["reservoir"]] = supply * p.supply_volume / rt
    fibres = []
    for k, a in enumerate((x[0], arm.SPAN - x[0])):
        fibres.append(arm.distance(a) - arm.FITTINGS)
        pressure = gauge_bar[k] * 1e5 + p.ambient_pressure
        x[INDEX[f"fibre_{k + 1}"]] = fibres[k]
        v = p.volume_gain * muscle.volume(fibres[k]) + p.dead_volume
        x[2 + 2 * k] = pressure * v / rt
        x[3 + 2 * k] = pressure * v / (p.gamma - 1.0)
        x[INDEX[f"exhaust_{k + 1}"]] = p.ambient_pressure * p.silencer_volume / rt
        x[INDEX[f"line_{k + 1}"]] = pressure * p.line_volume / rt
        for name in ("creep_fast", "creep_slow"):
            x[INDEX[f"{name}_{k + 1}"]] = pressure - p.ambient_pressure
    return x


def slipped(
    x: NDArray[np.float64], anchor: NDArray[np.float64], p: SimpleNamespace
) -> NDArray[np.float64]:
    """Return x with its slip elements moved exactly from those of the anchor state."""
    if not p.slip:
        return x
    new, old = lengths(x, p), lengths(anchor, p)
    for k, base in enumerate((SLIP_1, SLIP_2)):
        step = new[k][2] - old[k][2]
        for i, d, _ in p.slip:
            x[base + i] = min(d, max(-d, anchor[base + i] + step))
    return x


def derivative(
    state: NDArray[np.float64], command: float, p: SimpleNamespace
) -> NDArray[np.float64]:
    """Return dx/dt at the command in volt."""
    x: list[float] = state.tolist()  # plain floats are several times faster than array elements
    dx = np.zeros(len(x))
    angle, speed = float(x[0]), float(x[1])
    at = INDEX
    ambient, t_amb = p.ambient_pressure, p.ambient_temperature
    rt = p.gas_constant * t_amb

    tension = [0.0, 0.0]
    gas = []
    slope = [0.0, 0.0]
    for k, (total, lever, s) in enumerate(lengths(x, p)):
        slope[k] = lever
        v = p.volume_gain * muscle.volume(s) + p.dead_volume
        m, u = float(x[2 + 2 * k]), float(x[3 + 2 * k])
        pressure = (p.gamma - 1.0) * u / v
        gauge = pressure - ambient
        rate = lever * speed
        acting = gauge
        if p.creep_fast or p.creep_slow:
            fast, slow = at[f"creep_fast_{k + 1}"], at[f"creep_slow_{k + 1}"]
            acting += p.creep_fast * (x[fast] - gauge) + p.creep_slow * (x[slow] - gauge)
            dx[fast] = (gauge - x[fast]) / p.creep_fast_time
            dx[slow] = (gauge - x[slow]) / p.creep_slow_time
        memory = float(x[at[f"memory_{k + 1}"]])
        share = memory if p.hyst_law == 1 else 0.0
        base = (SLIP_1, SLIP_2)[k]
        for i, d, w in p.slip:
            share += w * float(x[base + i]) / d
        loop = (p.hyst_force + p.hyst_slope * max(0.0, gauge) * 1e-5) * share
        gain = (p.force_gain_1, p.force_gain_2)[k]
        if p.hyst_place == 1:
            raw = p.force_gain * gain * muscle.raw_force(s, acting, p) + loop
            static = muscle.clamp(raw, p.slack_width, p.slack_law)
        else:
            static = muscle.force(s, acting, gain, p) + loop
        if p.tendon_stiffness > 0.0:
            tension[k] = max(0.0, p.tendon_stiffness * (total - arm.FITTINGS - s))
            rate = (tension[k] - static) / p.muscle_viscosity
            dx[at[f"fibre_{k + 1}"]] = rate
        else:
            tension[k] = static + p.muscle_viscosity * rate
            if p.tension_only:
                tension[k] = max(0.0, tension[k])
        for i, d, _ in p.slip:
            dx[base + i] = hysteresis.maxwell_rate(float(x[base + i]), d, rate)
        if p.hyst_law == 1:
            dx[at[f"memory_{k + 1}"]] = hysteresis.bouc_wen_rate(
                memory, p.hyst_breakaway, p.hyst_exponent, p.hyst_beta, rate
            )
        gas.append(
            (m, u, v, pressure, u / (m * p.cv), p.volume_gain * muscle.volume_slope(s) * rate)
        )

    # valve and everything the gas flows through
    spool = float(x[at["spool"]])
    edge = spool
    if p.valve_deadband > 0.0:
        edge = max(0.0, spool - p.valve_deadband) + min(0.0, spool + p.valve_deadband)
    up, down = valve.opening(edge), valve.opening(-edge)
    fill = (up + p.centre_leakage, down + p.centre_leakage)
    vent = (down + p.centre_leakage, up + p.centre_leakage)
    supply = p.supply_pressure + ambient
    if p.supply_volume > 0.0:
        inside = float(x[at["reservoir"]]) * rt / p.supply_volume
        refill, _ = valve.exchange(p.supply_conductance, supply, t_amb, inside, t_amb, p)
        if p.supply_linear > 0.0:
            refill = p.supply_linear * (supply - inside)
        supply = inside
        dx[at["reservoir"]] += refill
    between, t_between = (0.0, t_amb)
    if p.leak_between > 0.0:
        between, t_between = valve.exchange(
            p.leak_between, gas[0][3], gas[0][4], gas[1][3], gas[1][4], p
        )
    for k in (0, 1):
        m, u, v, pressure, temperature, dv = gas[k]
        port, t_port = pressure, temperature
        if p.line_volume > 0.0:
            port, t_port = float(x[at[f"line_{k + 1}"]]) * rt / p.line_volume, t_amb
        outlet = ambient
        if p.silencer_volume > 0.0:
            outlet = float(x[at[f"exhaust_{k + 1}"]]) * rt / p.silencer_volume
        inflow, t_in = valve.exchange(p.conductance * fill[k], supply, t_amb, port, t_port, p)
        outflow, t_out = valve.exchange(p.conductance * vent[k], port, t_port, outlet, t_amb, p)
        if p.supply_volume > 0.0:
            dx[at["reservoir"]] -= inflow
        if p.silencer_volume > 0.0:
            escape, _ = valve.exchange(p.silencer_conductance, outlet, t_amb, ambient, t_amb, p)
            dx[at[f"exhaust_{k + 1}"]] = outflow - escape
        streams = [(inflow, t_in), (-outflow, t_out)]
        if p.line_volume > 0.0:
            through, t_through = valve.exchange(
                p.line_conductance, port, t_port, pressure, temperature, p
            )
            dx[at[f"line_{k + 1}"]] = inflow - outflow - through
            streams = [(through, t_through)]
        leak = (p.leak_1, p.leak_2)[k]
        if leak > 0.0:
            lost, t_lost = valve.exchange(leak, pressure, temperature, ambient, t_amb, p)
            streams.append((-lost, t_lost))
        if p.leak_between > 0.0:
            streams.append(((-between, between)[k], t_between))
        dm = sum(w for w, _ in streams)
        heat = sum(w * t for w, t in streams)
        if p.net_enthalpy == 1:
            heat = dm * (t_amb if dm > 0.0 else temperature)
        dx[2 + 2 * k] = dm
        if p.polytropic > 0.0:
            dx[3 + 2 * k] = (p.polytropic * pressure * (v * dm / m - dv) + pressure * dv) / (
                p.gamma - 1.0
            )
        else:
            dx[3 + 2 * k] = (
                p.gamma * p.cv * heat
                - pressure * dv
                - p.heat_transfer * p.heat_area * (temperature - t_amb)
            )

    target = command - p.valve_centre
    if target > 0.0:
        target *= p.valve_gain_up
    w = 2.0 * np.pi * p.spool_frequency
    rate, accel = float(x[at["spool_speed"]]), 0.0
    accel = w * w * (target - spool) - 2.0 * p.spool_damping * w * rate
    if p.valve_slew > 0.0:
        if abs(rate) >= p.valve_slew and accel * rate > 0.0:
            accel = 0.0
        rate = min(p.valve_slew, max(-p.valve_slew, rate))
    dx[at["spool"]], dx[at["spool_speed"]] = rate, accel

    drag, dx[at["bristle"]] = friction.torque(
        speed, float(x[at["bristle"]]), tension[0] + tension[1], p
    )
    torque = -tension[0] * slope[0] - tension[1] * slope[1] - drag + arm.stops(angle, speed, p)
    torque += p.constant_torque + p.external_torque - p.spring_torque * (angle - arm.SPAN / 2)
    torque += p.pressure_torque * ((gas[0][3] - gas[1][3]) * 1e-5) ** 2
    if p.cogging_torque != 0.0:
        torque += p.cogging_torque * np.sin(p.cogging_periods * angle)
    load_inertia = p.load * p.load_inertia_per_kg
    if p.load_stiffness > 0.0 and p.load > 0.0:
        la, ls = at["load_angle"], at["load_speed"]
        coupling = p.load_stiffness * (angle - x[la]) + p.load_damping * (speed - x[ls])
        weight = arm.gravity(float(x[la]), p.load, p) - arm.gravity(float(x[la]), 0.0, p)
        dx[la], dx[ls] = x[ls], (coupling + weight) / load_inertia
        torque += arm.gravity(angle, 0.0, p) - coupling
        dx[1] = torque / p.arm_inertia
    else:
        dx[1] = (torque + arm.gravity(angle, p.load, p)) / (p.arm_inertia + load_inertia)
    dx[0] = speed
    return dx


def pressures(states: NDArray[np.float64], parameters: dict[str, float]) -> NDArray[np.float64]:
    """Return the gauge pressures in Pa, shape (..., 2), of states of shape (..., n)."""
    p = namespace(parameters)
    flat = np.atleast_2d(states)
    out = np.empty((len(flat), 2))
    for j, x in enumerate(flat):
        for k, (_, _, s) in enumerate(lengths(x, p)):
            v = p.volume_gain * muscle.volume(s) + p.dead_volume
            out[j, k] = (p.gamma - 1.0) * x[3 + 2 * k] / v - p.ambient_pressure
    return out.reshape(*states.shape[:-1], 2)
