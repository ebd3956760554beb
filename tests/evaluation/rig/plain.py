"""The rig's equations a second time, in plain Python: what `plant.c` must agree with."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from workbench.evaluation.rig import plant
from workbench.evaluation.rig.parameters import ELEMENTS
from workbench.evaluation.rig.plant import INDEX, PERCENT, VOLTS

V_, F_ = VOLTS.tolist(), (PERCENT / 100).tolist()
SLIP_1, SLIP_2 = INDEX["slip_1_1"], INDEX["slip_2_1"]
ARM_MASS, ARM_X, ARM_Y = 0.987, 0.205, 0.0176
LOAD_X, LOAD_Y = 0.367, -0.024
G = 9.81


def distance_slope(angle: float) -> float:
    """Return d(distance)/d(angle) of muscle 1."""
    x = 0.0444 + 0.032 * math.cos(angle)
    y = 0.416 - 0.032 * math.sin(angle)
    return 0.032 * (-x * math.sin(angle) - y * math.cos(angle)) / math.hypot(x, y)


def gravity(angle: float, load: float, p: SimpleNamespace) -> float:
    """Return the torque of gravity on the joint (positive angles are against gravity)."""
    moment = ARM_MASS * (ARM_X * math.cos(angle) - ARM_Y * math.sin(angle))
    moment += load * (LOAD_X * math.cos(angle) - LOAD_Y * math.sin(angle))
    # A small tilt about the axis that is level with the arm at 90 deg acts on the cosine only.
    tilted = (ARM_MASS * ARM_X + load * LOAD_X) * math.cos(angle) * math.sin(p.tilt)
    return float(-G * (moment * p.vertical + tilted))


def lengths(
    x: NDArray[np.float64] | list[float], p: SimpleNamespace
) -> list[tuple[float, float, float]]:
    """Return for both muscles the distance, its slope over the angle, and the fibre length."""
    result = []
    for k, (a, sign) in enumerate(((x[0], 1.0), (plant.SPAN - x[0], -1.0))):
        total = plant.distance(a)
        s = x[INDEX["fibre_1"] + k] if p.tendon_stiffness > 0 else total - plant.FITTINGS
        result.append((total, sign * distance_slope(a), s))
    return result


def slips(p: SimpleNamespace) -> list[tuple[int, float, float]]:
    """Return number, break-away and weight of the slip elements that are used."""
    found = [(i, *(getattr(p, f"hyst_{key}{i + 1}") for key in "dw")) for i in range(ELEMENTS)]
    return [element for element in found if element[2] != 0.0]


def active(p: SimpleNamespace) -> list[int]:
    """Return the indices of the states that the switched-on effects use."""
    used = set(range(INDEX["spool_speed"] + 1))
    switches = {
        "reservoir": p.supply_volume, "exhaust": p.silencer_volume, "line": p.line_volume,
        "bristle": p.lugre_stiffness, "memory": p.hyst_law, "load_": p.load_stiffness,
        "fibre": p.tendon_stiffness,
        "creep": abs(p.creep_fast) + abs(p.creep_slow), "slip": len(slips(p)),
    }  # fmt: skip
    for name, i in INDEX.items():
        if any(name.startswith(start) and value > 0 for start, value in switches.items()):
            used.add(i)
    spare = {b + i for b in (SLIP_1, SLIP_2) for i in range(ELEMENTS)}
    spare -= {b + i for b in (SLIP_1, SLIP_2) for i, _, _ in slips(p)}
    return sorted(used - spare)


def opening(x: float) -> float:
    """Return the fraction of the full conductance at spool voltage x from the centre."""
    if x <= 0.0:
        return 0.0
    if x >= 5.0:
        return 1.0
    i = 1
    while V_[i] < x:
        i += 1
    return float(F_[i - 1] + (F_[i] - F_[i - 1]) * (x - V_[i - 1]) / (V_[i] - V_[i - 1]))


def flow(c: float, up: float, down: float, t_up: float, p: SimpleNamespace) -> float:
    """Return the mass flow from pressure up to down (absolute, up >= down), conductance c."""
    b, r_lin = p.critical_ratio, p.linear_ratio
    r = down / up
    if r <= b:
        psi = 1.0
    elif r <= r_lin:
        psi = math.sqrt(1.0 - ((r - b) / (1.0 - b)) ** 2)
    else:
        psi = math.sqrt(1.0 - ((r_lin - b) / (1.0 - b)) ** 2) * (1.0 - r) / (1.0 - r_lin)
    return float(c * p.reference_density * up * math.sqrt(p.reference_temperature / t_up) * psi)


def exchange(
    c: float, pa: float, ta: float, pb: float, tb: float, p: SimpleNamespace
) -> tuple[float, float]:
    """Return the mass flow from a to b (signed) and the temperature it carries."""
    if pa >= pb:
        return flow(c, pa, pb, ta, p), ta
    return -flow(c, pb, pa, tb, p), tb


def maxwell_rate(z: float, d: float, speed: float) -> float:
    """Return dz/dt of one element: it follows the length until |z| reaches its break-away d."""
    if (z >= d and speed > 0.0) or (z <= -d and speed < 0.0):
        return 0.0
    return speed


def bouc_wen_rate(z: float, d: float, n: float, beta: float, speed: float) -> float:
    """Return dz/dt of the Bouc-Wen memory; n = 1 and beta = 1 is Dahl's law."""
    a = abs(z)
    against = beta * abs(speed) * z * a ** (n - 1.0)
    return float((speed - against - (1.0 - beta) * speed * a**n) / d)


def friction_level(speed: float, tension: float, p: SimpleNamespace) -> float:
    """Return the dry friction level at a speed; tension is F1 + F2."""
    dry = p.coulomb + p.load_friction * tension
    if p.stribeck_torque != 0.0:
        dry += p.stribeck_torque * math.exp(-((speed / p.stribeck_speed) ** 2))
    return float(dry)


def friction(
    speed: float, bristle: float, tension: float, p: SimpleNamespace
) -> tuple[float, float]:
    """Return the friction torque (against the motion) and the rate of the bristle."""
    dry = friction_level(speed, tension, p)
    drag = p.viscous * speed + p.quadratic_drag * speed * abs(speed)
    if p.lugre_stiffness > 0.0:
        rate = speed - p.lugre_stiffness * abs(speed) * bristle / dry
        return p.lugre_stiffness * bristle + p.lugre_damping * rate + drag, rate
    return dry * math.tanh(speed / p.coulomb_speed) + drag, 0.0


def stops(angle: float, speed: float, p: SimpleNamespace) -> float:
    """Return the torque of the stops at 0 and 60 degrees; a stop can only push."""
    if angle < 0.0:
        return max(0.0, float(-p.stop_stiffness * angle - p.stop_damping * speed))
    if angle > plant.SPAN:
        return min(0.0, float(-p.stop_stiffness * (angle - plant.SPAN) - p.stop_damping * speed))
    return 0.0


def slipped(
    x: NDArray[np.float64], anchor: NDArray[np.float64], p: SimpleNamespace
) -> NDArray[np.float64]:
    """Return x with its slip elements moved exactly from those of the anchor state."""
    if not slips(p):
        return x
    new, old = lengths(x, p), lengths(anchor, p)
    for k, base in enumerate((SLIP_1, SLIP_2)):
        step = new[k][2] - old[k][2]
        for i, d, _ in slips(p):
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
        v = p.volume_gain * plant.volume(s) + p.dead_volume
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
        for i, d, w in slips(p):
            share += w * float(x[base + i]) / d
        loop = (p.hyst_force + p.hyst_slope * max(0.0, gauge) * 1e-5) * share
        loop *= (1.0, p.hyst_share_2)[k]
        gain = (p.force_gain_1, p.force_gain_2)[k]
        if p.hyst_place == 1:
            raw = p.force_gain * gain * plant.raw_force(s, acting, p) + loop
            static = plant.clamp(raw, p.slack_width, p.slack_law)
        else:
            static = plant.force(s, acting, gain, p) + loop
        if p.tendon_stiffness > 0.0:
            tension[k] = max(0.0, p.tendon_stiffness * (total - plant.FITTINGS - s))
            rate = (tension[k] - static) / p.muscle_viscosity
            dx[at[f"fibre_{k + 1}"]] = rate
        else:
            tension[k] = static + p.muscle_viscosity * rate
            if p.tension_only:
                tension[k] = max(0.0, tension[k])
        for i, d, _ in slips(p):
            dx[base + i] = maxwell_rate(float(x[base + i]), d, rate)
        if p.hyst_law == 1:
            dx[at[f"memory_{k + 1}"]] = bouc_wen_rate(
                memory, p.hyst_breakaway, p.hyst_exponent, p.hyst_beta, rate
            )
        gas.append(
            (m, u, v, pressure, u / (m * p.cv), p.volume_gain * plant.volume_slope(s) * rate)
        )

    # valve and everything the gas flows through
    spool = float(x[at["spool"]])
    edge = spool
    if p.valve_deadband > 0.0:
        edge = max(0.0, spool - p.valve_deadband) + min(0.0, spool + p.valve_deadband)
    up, down = opening(edge), opening(-edge)
    fill = (p.edge_supply_1 * (up + p.centre_leakage), down + p.centre_leakage)
    vent = (down + p.centre_leakage, up + p.centre_leakage)
    supply = p.supply_pressure + ambient
    if p.supply_volume > 0.0:
        inside = float(x[at["reservoir"]]) * rt / p.supply_volume
        refill, _ = exchange(p.supply_conductance, supply, t_amb, inside, t_amb, p)
        if p.supply_linear > 0.0:
            refill = p.supply_linear * (supply - inside)
        supply = inside
        dx[at["reservoir"]] += refill
    between, t_between = (0.0, t_amb)
    if p.leak_between > 0.0:
        between, t_between = exchange(p.leak_between, gas[0][3], gas[0][4], gas[1][3], gas[1][4], p)
    for k in (0, 1):
        m, u, v, pressure, temperature, dv = gas[k]
        port, t_port = pressure, temperature
        if p.line_volume > 0.0:
            port, t_port = float(x[at[f"line_{k + 1}"]]) * rt / p.line_volume, t_amb
        outlet = ambient
        if p.silencer_volume > 0.0:
            outlet = float(x[at[f"exhaust_{k + 1}"]]) * rt / p.silencer_volume
        inflow, t_in = exchange(p.conductance * fill[k], supply, t_amb, port, t_port, p)
        outflow, t_out = exchange(p.conductance * vent[k], port, t_port, outlet, t_amb, p)
        if p.supply_volume > 0.0:
            dx[at["reservoir"]] -= inflow
        if p.silencer_volume > 0.0:
            escape, _ = exchange(p.silencer_conductance, outlet, t_amb, ambient, t_amb, p)
            dx[at[f"exhaust_{k + 1}"]] = outflow - escape
        streams = [(inflow, t_in), (-outflow, t_out)]
        if p.line_volume > 0.0:
            through, t_through = exchange(
                p.line_conductance, port, t_port, pressure, temperature, p
            )
            dx[at[f"line_{k + 1}"]] = inflow - outflow - through
            streams = [(through, t_through)]
        leak = (p.leak_1, p.leak_2)[k]
        if leak > 0.0:
            lost, t_lost = exchange(leak, pressure, temperature, ambient, t_amb, p)
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

    drag, dx[at["bristle"]] = friction(speed, float(x[at["bristle"]]), tension[0] + tension[1], p)
    torque = -tension[0] * slope[0] - tension[1] * slope[1] - drag + stops(angle, speed, p)
    torque += p.constant_torque + p.external_torque - p.spring_torque * (angle - plant.SPAN / 2)
    torque += p.pressure_torque * ((gas[0][3] - gas[1][3]) * 1e-5) ** 2
    if p.cogging_torque != 0.0:
        torque += p.cogging_torque * np.sin(p.cogging_periods * angle)
    load_inertia = p.load * p.load_inertia_per_kg
    if p.load_stiffness > 0.0 and p.load > 0.0:
        la, ls = at["load_angle"], at["load_speed"]
        coupling = p.load_stiffness * (angle - x[la]) + p.load_damping * (speed - x[ls])
        weight = gravity(float(x[la]), p.load, p) - gravity(float(x[la]), 0.0, p)
        dx[la], dx[ls] = x[ls], (coupling + weight) / load_inertia
        torque += gravity(angle, 0.0, p) - coupling
        dx[1] = torque / p.arm_inertia
    else:
        dx[1] = (torque + gravity(angle, p.load, p)) / (p.arm_inertia + load_inertia)
    dx[0] = speed
    return dx


def run(state: NDArray[np.float64], command: NDArray[np.float64], p: SimpleNamespace, step: float):
    """Return the state after one command in volt per step of the Runge-Kutta rule of plant.c."""
    x = np.array(state, float)
    for v in command:
        k1 = derivative(x, v, p)
        k2 = derivative(slipped(x + 0.5 * step * k1, x, p), v, p)
        k3 = derivative(slipped(x + 0.5 * step * k2, x, p), v, p)
        k4 = derivative(slipped(x + step * k3, x, p), v, p)
        x = slipped(x + step / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4), x, p)
    return x
