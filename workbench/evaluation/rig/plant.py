"""The equations of the rig: geometry, muscles, gas, valve and joint, and its own integrator.

The gas of a muscle is described by its mass m and its internal energy U:

    dU/dt = c_p sum(flow T_carried) - p dV/dt - h S (T - T_ambient),
    p = (gamma - 1) U / V,   T = U / (m c_v).

Reservoir, lines and silencers are isothermal volumes with the mass as state. Equations hold for
floats and for expressions of CasADi, which writes those of `rates` as C; `rig.c` repeats its steps.

Units: SI; contractions q in mm, commands in V.
"""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from workbench.computing.machine_code import PLAIN
from workbench.evaluation.rig.parameters import ELEMENTS, PARAMETERS
from workbench.simulation.equations import CFunction, Equations, address, in_c

Number = Any
"""A float or an expression of CasADi."""

SPAN = math.radians(60.0)
FITTINGS = 0.223
"""Distance between the joining points minus the length of the fibre."""


def where(condition: Number, one: Number, other: Number) -> Number:
    """Return one of two numbers, in their unit."""
    if isinstance(condition, ca.SX):
        return ca.if_else(condition, one, other)
    return one if condition else other


def _between(low: Number, value: Number, high: Number) -> Number:
    return ca.fmin(ca.fmax(value, low), high)


def _of_both(name: str) -> Callable[[Number], Number]:
    plain, symbolic = getattr(math, name), getattr(ca, name)
    return lambda value: symbolic(value) if isinstance(value, ca.SX) else plain(value)


cos, sin, sqrt = map(_of_both, ("cos", "sin", "sqrt"))


def distance(angle: Number) -> Number:
    """Return the distance between the joining points of muscle 1."""
    x, y = 0.0444 + 0.032 * cos(angle), 0.416 - 0.032 * sin(angle)
    return sqrt(x * x + y * y)


def distance_slope(angle: Number) -> Number:
    """Return d(distance)/d(angle) of muscle 1."""
    x, y = 0.0444 + 0.032 * cos(angle), 0.416 - 0.032 * sin(angle)
    return 0.032 * (-x * sin(angle) - y * cos(angle)) / sqrt(x * x + y * y)


NOMINAL_LENGTH = 0.200
FIBRE_ANGLE = math.radians(25.0)
NOMINAL_DIAMETER = 0.020
FIBRE_LENGTH = NOMINAL_LENGTH / math.cos(FIBRE_ANGLE)
TURNS = NOMINAL_LENGTH * math.tan(FIBRE_ANGLE) / (math.pi * NOMINAL_DIAMETER)
FLOOR_BELOW = 1.757
"""Contraction in mm below which the pressure-free force is the constant -9.2101 N."""


def clamp(x: Number, width: Number, law: float) -> Number:
    """Return x clamped at zero from below, rounded over `width` newtons by the chosen law."""
    if law == 0:
        return 0.5 * (x + sqrt(x * x + width * width))
    if law == 1:
        z = x / width
        return where(z > 35, x, where(z < -35, 0.0, width * ca.log1p(ca.exp(ca.fmin(z, 35.0)))))
    return ca.fmax(0.0, x)


def raw_force(s: Number, pressure: Number, p: SimpleNamespace) -> Number:
    """Return the tension at fibre length s and gauge pressure before clamp and gain."""
    q = (NOMINAL_LENGTH - s) * 1e3
    free = (((0.00045804 * q - 0.053424) * q + 2.0189) * q - 43.691) * q + 61.62
    free = where(q > FLOOR_BELOW, free, -9.2101)
    raw = (280.0 - 2.2 * q + 0.033 * q * q) * pressure * 1e-5 + free
    return raw * (1.0 + p.force_shape * (q / 30.0) * (q / 30.0))


def force(s: Number, pressure: Number, gain: Number, p: SimpleNamespace) -> Number:
    """Return the static tension at fibre length s and gauge pressure; never below zero."""
    return gain * p.force_gain * clamp(raw_force(s, pressure, p), p.slack_width, p.slack_law)


def volume(s: Number) -> Number:
    """Return the volume inside a muscle of fibre length s, its ends flattened."""
    d2 = (FIBRE_LENGTH**2 - s * s) / (math.pi * TURNS) ** 2
    d02 = NOMINAL_DIAMETER**2
    h = where(d2 > d02, 0.5 * sqrt(where(d2 > d02, d2 - d02, 0.0)), 1e-7)
    zone = math.pi * h / 6.0 * (0.75 * d2 + 0.75 * d02 + h * h)
    return 0.25 * math.pi * d2 * (s - 2.0 * h) + 2.0 * zone


def volume_slope(s: Number) -> Number:
    """Return dV/ds; the terms in dh/ds cancel because h^2 = (d^2 - d0^2)/4."""
    pitch = math.pi * TURNS
    d2 = (FIBRE_LENGTH**2 - s * s) / pitch**2
    h = 0.5 * sqrt(where(d2 > NOMINAL_DIAMETER**2, d2 - NOMINAL_DIAMETER**2, 0.0))
    return -0.5 * math.pi * s / pitch**2 * (s - h) + 0.25 * math.pi * d2


def gravity(angle: Number, load: Number, p: SimpleNamespace) -> Number:
    """Return the torque of gravity on the joint (positive angles are against gravity)."""
    c, s = cos(angle), sin(angle)
    moment = 0.987 * (0.205 * c - 0.0176 * s) + load * (0.367 * c + 0.024 * s)
    # A small tilt about the axis that is level with the arm at 90 deg acts on the cosine only.
    tilted = (0.987 * 0.205 + load * 0.367) * c * sin(p.tilt)
    return -9.81 * (moment * p.vertical + tilted)


STATES: list[str] = [
    "angle", "speed", "mass_1", "energy_1", "mass_2", "energy_2", "spool", "spool_speed",
    "reservoir", "exhaust_1", "exhaust_2", "line_1", "line_2", "bristle",
    *(f"slip_1_{i + 1}" for i in range(ELEMENTS)),
    *(f"slip_2_{i + 1}" for i in range(ELEMENTS)),
    "memory_1", "memory_2", "creep_fast_1", "creep_slow_1", "creep_fast_2", "creep_slow_2",
    "load_angle", "load_speed", "fibre_1", "fibre_2",
]  # fmt: skip
INDEX = {name: i for i, name in enumerate(STATES)}

_LAWS = ("slack_law", "hyst_law", "hyst_place", "net_enthalpy")
_SWITCHES = (
    "load", "tendon_stiffness", "tension_only", "creep_fast", "creep_slow", "valve_deadband",
    "supply_volume", "supply_linear", "line_volume", "silencer_volume", "polytropic", "valve_slew",
    "lugre_stiffness", "load_stiffness", "stribeck_torque", "cogging_torque", "pressure_torque",
    "leak_1", "leak_2", "leak_between", *(f"hyst_w{i + 1}" for i in range(ELEMENTS)),
)  # fmt: skip
"""Parameters that choose a law, and those that switch something off where they are zero."""


def namespace(parameters: dict[str, Any]) -> SimpleNamespace:
    """Return the parameters as attributes."""
    p = SimpleNamespace(**parameters)
    p.cv = p.gas_constant / (p.gamma - 1.0)
    return p


def initial(
    angle_deg: float,
    gauge_bar: tuple[float, float],
    parameters: dict[str, float],
    *,
    stretched: bool = False,
) -> NDArray[np.float64]:
    """Return a state at rest."""
    p = namespace(parameters)
    x = np.zeros(len(STATES))
    x[0] = x[INDEX["load_angle"]] = np.radians(angle_deg)
    rt = p.gas_constant * p.ambient_temperature
    supply = p.supply_pressure + p.ambient_pressure
    x[INDEX["reservoir"]] = supply * p.supply_volume / rt
    for k, a in enumerate((float(x[0]), SPAN - float(x[0]))):
        fibre = rigid = distance(a) - FITTINGS
        if stretched and p.tendon_stiffness > 0.0:
            gain = (p.force_gain_1, p.force_gain_2)[k]
            for _ in range(50):  # Contracts: muscles are softer than tendons.
                tension = force(fibre, gauge_bar[k] * 1e5, gain, p)
                fibre += 0.5 * (rigid - tension / p.tendon_stiffness - fibre)
        pressure = gauge_bar[k] * 1e5 + p.ambient_pressure
        x[INDEX[f"fibre_{k + 1}"]] = fibre
        v = p.volume_gain * volume(fibre) + p.dead_volume
        x[2 + 2 * k] = pressure * v / rt
        x[3 + 2 * k] = pressure * v / (p.gamma - 1.0)
        x[INDEX[f"exhaust_{k + 1}"]] = p.ambient_pressure * p.silencer_volume / rt
        x[INDEX[f"line_{k + 1}"]] = pressure * p.line_volume / rt
        for name in ("creep_fast", "creep_slow"):
            x[INDEX[f"{name}_{k + 1}"]] = pressure - p.ambient_pressure
    return x


def gauge(state: NDArray[np.float64], p: dict[str, float]) -> tuple[float, float]:
    """Return the true gauge pressures in Pa."""
    out = []
    for k, s in enumerate(fibres(state.tolist(), namespace(p))):
        v = p["volume_gain"] * volume(s) + p["dead_volume"]
        out.append((p["gamma"] - 1) * float(state[3 + 2 * k]) / v - p["ambient_pressure"])
    return out[0], out[1]


Array = NDArray[np.float64]

VOLTS = np.array(
    [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 3.5, 4]
    + [4.5, 5]
)
PERCENT = np.array(
    [0, 0.2, 0.5, 0.8, 1.2, 1.7, 2.3, 3.0, 4.1, 5.6, 7.1, 10.7, 17, 24, 30, 36, 49, 64, 75, 86]
    + [97, 100]
)
"""Opening curve of the servovalve: spool in V, conductance in per cent of the full one."""


def opening(spool: Number) -> Number:
    """Return the fraction of the full conductance at spool voltage x from the centre."""
    pieces = np.array([VOLTS[:-1], np.diff(VOLTS), np.diff(PERCENT / 100)]).T.tolist()
    return sum(part * _between(0.0, (spool - v) / width, 1.0) for v, width, part in pieces)


def exchange(
    c: Number, pa: Number, ta: Number, pb: Number, tb: Number, p: SimpleNamespace
) -> tuple[Number, Number]:
    """Return the mass flow from a to b (signed) and the temperature it carries."""
    up, down, carried = ca.fmax(pa, pb), ca.fmin(pa, pb), where(pa >= pb, ta, tb)
    ratio = down / up
    y = ca.fmax(ca.fmin(ratio, p.linear_ratio) - p.critical_ratio, 0.0) / (1.0 - p.critical_ratio)
    psi = sqrt(1.0 - y * y) * ca.fmin((1.0 - ratio) / (1.0 - p.linear_ratio), 1.0)
    size = c * p.reference_density * up * sqrt(p.reference_temperature / carried) * psi
    return where(pa >= pb, size, -size), carried


def fibres(x: Any, p: SimpleNamespace) -> tuple[Number, Number]:
    """Return the lengths of both fibres."""
    if isinstance(p.tendon_stiffness, ca.SX) or p.tendon_stiffness > 0.0:
        return x[INDEX["fibre_1"]], x[INDEX["fibre_2"]]
    return distance(x[0]) - FITTINGS, distance(SPAN - x[0]) - FITTINGS


def on(value: Number) -> bool:
    """Tell whether something is switched on."""
    return isinstance(value, ca.SX) or value != 0.0


def _slips(p: SimpleNamespace) -> list[tuple[int, Number, Number]]:
    """Return number, break-away and weight of the slip elements that are used."""
    found = [(i, *(getattr(p, f"hyst_{key}{i + 1}") for key in "dw")) for i in range(ELEMENTS)]
    return [element for element in found if on(element[2])]


def rates(x: ca.SX, command: ca.SX, p: SimpleNamespace) -> ca.SX:
    """Return dx/dt at the command in volt."""
    at = {name: x[i] for name, i in INDEX.items()}
    dx: dict[str, Number] = dict.fromkeys(STATES, 0.0)
    angle, speed = at["angle"], at["speed"]
    ambient, t_amb = p.ambient_pressure, p.ambient_temperature
    rt, tension, slope, gas = p.gas_constant * t_amb, [], [], []
    for k, s in enumerate(fibres(x, p)):
        own = SPAN - angle if k else angle
        slope.append((-1.0 if k else 1.0) * distance_slope(own))
        v = p.volume_gain * volume(s) + p.dead_volume
        m, u, rate = at[f"mass_{k + 1}"], at[f"energy_{k + 1}"], slope[k] * speed
        pressure = (p.gamma - 1.0) * u / v
        gauge = acting = pressure - ambient
        if on(p.creep_fast) or on(p.creep_slow):
            for name in ("fast", "slow"):
                late = at[f"creep_{name}_{k + 1}"]
                acting += getattr(p, f"creep_{name}") * (late - gauge)
                dx[f"creep_{name}_{k + 1}"] = (gauge - late) / getattr(p, f"creep_{name}_time")
        memory = at[f"memory_{k + 1}"]
        share = memory if p.hyst_law == 1 else 0.0
        for i, d, w in _slips(p):
            share += w * at[f"slip_{k + 1}_{i + 1}"] / d
        loop = (p.hyst_force + p.hyst_slope * ca.fmax(0.0, gauge) * 1e-5) * share
        loop *= (1.0, p.hyst_share_2)[k]
        gain = (p.force_gain_1, p.force_gain_2)[k]
        if p.hyst_place == 1:
            raw = p.force_gain * gain * raw_force(s, acting, p) + loop
            static = clamp(raw, p.slack_width, p.slack_law)
        else:
            static = force(s, acting, gain, p) + loop
        if on(p.tendon_stiffness):
            tension.append(ca.fmax(0.0, p.tendon_stiffness * (distance(own) - FITTINGS - s)))
            rate = dx[f"fibre_{k + 1}"] = (tension[k] - static) / p.muscle_viscosity
        else:
            tension.append(static + p.muscle_viscosity * rate)
            if on(p.tension_only):
                tension[k] = ca.fmax(0.0, tension[k])
        # An element follows the length until it reaches its break-away.
        for i, d, _ in _slips(p):
            z = at[f"slip_{k + 1}_{i + 1}"]
            ends = ca.logic_or(ca.logic_and(z >= d, rate > 0.0), ca.logic_and(z <= -d, rate < 0.0))
            dx[f"slip_{k + 1}_{i + 1}"] = where(ends, 0.0, rate)
        if p.hyst_law == 1:
            a, n = ca.fabs(memory), p.hyst_exponent
            against = p.hyst_beta * ca.fabs(rate) * memory * a ** (n - 1.0)
            against += (1.0 - p.hyst_beta) * rate * a**n
            dx[f"memory_{k + 1}"] = (rate - against) / p.hyst_breakaway
        grown = p.volume_gain * volume_slope(s) * rate
        gas.append((m, v, pressure, u / (m * p.cv), grown))

    # Valve and everything the gas flows through.
    spool = edge = at["spool"]
    if on(p.valve_deadband):
        edge = ca.fmax(0.0, spool - p.valve_deadband) + ca.fmin(0.0, spool + p.valve_deadband)
    up, down = opening(edge) + p.centre_leakage, opening(-edge) + p.centre_leakage
    supply = p.supply_pressure + ambient
    if on(p.supply_volume):
        inside = at["reservoir"] * rt / p.supply_volume
        refill, _ = exchange(p.supply_conductance, supply, t_amb, inside, t_amb, p)
        dx["reservoir"] = p.supply_linear * (supply - inside) if on(p.supply_linear) else refill
        supply = inside
    between, t_between = exchange(p.leak_between, *gas[0][2:4], *gas[1][2:4], p)
    for k, (m, v, pressure, temperature, grown) in enumerate(gas):
        port, t_port, outlet = pressure, temperature, ambient
        if on(p.line_volume):
            port, t_port = at[f"line_{k + 1}"] * rt / p.line_volume, t_amb
        if on(p.silencer_volume):
            outlet = at[f"exhaust_{k + 1}"] * rt / p.silencer_volume
        fill, vent = (down, up) if k else (p.edge_supply_1 * up, down)
        inflow, t_in = exchange(p.conductance * fill, supply, t_amb, port, t_port, p)
        outflow, t_out = exchange(p.conductance * vent, port, t_port, outlet, t_amb, p)
        if on(p.supply_volume):
            dx["reservoir"] -= inflow
        if on(p.silencer_volume):
            escape, _ = exchange(p.silencer_conductance, outlet, t_amb, ambient, t_amb, p)
            dx[f"exhaust_{k + 1}"] = outflow - escape
        streams = [(inflow, t_in), (-outflow, t_out)]
        if on(p.line_volume):
            through = exchange(p.line_conductance, port, t_port, pressure, temperature, p)
            dx[f"line_{k + 1}"] = inflow - outflow - through[0]
            streams = [through]
        leak = (p.leak_1, p.leak_2)[k]
        lost, t_lost = exchange(leak, pressure, temperature, ambient, t_amb, p)
        streams += [(-lost, t_lost), (between if k else -between, t_between)]
        dm = sum(w for w, _ in streams)
        heat = sum(w * t for w, t in streams)
        if p.net_enthalpy == 1:
            heat = dm * where(dm > 0.0, t_amb, temperature)
        dx[f"mass_{k + 1}"] = dm
        if on(p.polytropic):
            work = p.polytropic * pressure * (v * dm / m - grown) + pressure * grown
            dx[f"energy_{k + 1}"] = work / (p.gamma - 1.0)
        else:
            lost = p.heat_transfer * p.heat_area * (temperature - t_amb)
            dx[f"energy_{k + 1}"] = p.gamma * p.cv * heat - pressure * grown - lost

    target = command - p.valve_centre
    target = where(target > 0.0, target * p.valve_gain_up, target)
    w, rate = 2.0 * math.pi * p.spool_frequency, at["spool_speed"]
    raised = w * w * (target - spool) - 2.0 * p.spool_damping * w * rate
    if on(p.valve_slew):
        ends = ca.logic_and(ca.fabs(rate) >= p.valve_slew, raised * rate > 0.0)
        raised, rate = where(ends, 0.0, raised), _between(-p.valve_slew, rate, p.valve_slew)
    dx["spool"], dx["spool_speed"] = rate, raised

    dry = p.coulomb + p.load_friction * (tension[0] + tension[1])
    dry += p.stribeck_torque * ca.exp(-((speed / p.stribeck_speed) ** 2))
    drag = p.viscous * speed + p.quadratic_drag * speed * ca.fabs(speed)
    if on(p.lugre_stiffness):
        bristle = at["bristle"]
        dx["bristle"] = speed - p.lugre_stiffness * ca.fabs(speed) * bristle / dry
        drag += p.lugre_stiffness * bristle + p.lugre_damping * dx["bristle"]
    else:
        drag += dry * ca.tanh(speed / p.coulomb_speed)
    torque = -tension[0] * slope[0] - tension[1] * slope[1] - drag
    # A stop can only push.
    low = ca.fmax(0.0, -p.stop_stiffness * angle - p.stop_damping * speed)
    high = ca.fmin(0.0, -p.stop_stiffness * (angle - SPAN) - p.stop_damping * speed)
    torque += where(angle < 0.0, low, where(angle > SPAN, high, 0.0))
    torque += p.constant_torque + p.external_torque - p.spring_torque * (angle - SPAN / 2)
    torque += p.pressure_torque * ((gas[0][2] - gas[1][2]) * 1e-5) ** 2
    torque += p.cogging_torque * sin(p.cogging_periods * angle)
    inertia = p.load * p.load_inertia_per_kg
    if on(p.load_stiffness) and on(p.load):
        there, moving = at["load_angle"], at["load_speed"]
        coupling = p.load_stiffness * (angle - there) + p.load_damping * (speed - moving)
        weight = gravity(there, p.load, p) - gravity(there, 0.0, p)
        dx["load_angle"], dx["load_speed"] = moving, (coupling + weight) / inertia
        dx["speed"] = (torque + gravity(angle, 0.0, p) - coupling) / p.arm_inertia
    else:
        dx["speed"] = (torque + gravity(angle, p.load, p)) / (p.arm_inertia + inertia)
    dx["angle"] = speed
    return ca.vertcat(*dx.values())


def _slipped(x: ca.SX, before: ca.SX, p: SimpleNamespace) -> ca.SX:
    """Return a state with its slip elements moved exactly from those of the one before."""
    moved = ca.SX(x)
    for k, (now, then) in enumerate(zip(fibres(x, p), fibres(before, p), strict=True)):
        for i, d, _ in _slips(p):
            at = INDEX[f"slip_{k + 1}_{i + 1}"]
            moved[at] = _between(-d, before[at] + (now - then), d)
    return moved


@functools.lru_cache(maxsize=64)
def _equations(
    laws: tuple[float, ...], switched: tuple[bool, ...]
) -> tuple[Equations, CFunction | None]:
    """Return a step of the classical Runge-Kutta rule and dx/dt, for what is switched on.

    Where there is a C compiler, the step for C code too.
    """
    x, before = (ca.SX.sym(name, len(STATES)) for name in ("x", "before"))
    u, values = ca.SX.sym("u"), ca.SX.sym("p", len(PARAMETERS))
    told: dict[str, Any] = dict(zip(PARAMETERS, ca.vertsplit(values), strict=True))
    told |= zip(_LAWS, laws, strict=True)
    told |= {name: 0.0 for name, there in zip(_SWITCHES, switched, strict=True) if not there}
    p = namespace(told)
    slope = ca.Function("rates", [x, u, values], [ca.densify(rates(x, u, p))], {"cse": True})
    slip = ca.Function("slip", [x, before, values], [ca.densify(_slipped(x, before, p))])
    at, held, own = ca.MX.sym("x", len(STATES)), ca.MX.sym("u"), ca.MX.sym("p", len(PARAMETERS) + 1)
    given, h, k = own[:-1], own[-1], [ca.MX.zeros(len(STATES))]
    for part in (0.0, 0.5, 0.5, 1.0):
        stage = slip(at + part * h * k[-1], at, given) if _slips(p) else at + part * h * k[-1]
        k.append(slope(stage, held, given))
    after = at + h / 6.0 * (k[1] + 2.0 * k[2] + 2.0 * k[3] + k[4])
    after = slip(after, at, given) if _slips(p) else after
    found = Equations((ca.Function("step", [at, held, own], [after]), slope), PLAIN)
    return found, found.in_c(0) if found.compiled else None


_laws, _switches, _values = (itemgetter(*names) for names in (_LAWS, _SWITCHES, PARAMETERS))


def _of(parameters: dict[str, float]) -> tuple[Equations, CFunction | None]:
    return _equations(_laws(parameters), tuple(map(bool, _switches(parameters))))


@functools.cache
def _library() -> ctypes.CDLL | None:
    library = in_c(Path(__file__).with_name("rig.c"))
    if library is not None:
        pointer, whole = ctypes.c_void_p, ctypes.c_int64
        library.run.argtypes = [pointer, whole, whole, whole, *[pointer] * 4]
        library.run.restype = None
    return library


def derivative(state: Array, command: float, parameters: dict[str, float]) -> Array:
    """Return dx/dt at the command in volt."""
    return _of(parameters)[0](1, state, [command], _values(parameters))


def run(
    parameters: dict[str, float], state: Array, command: Array, *, step: float, keep: int
) -> tuple[Array, Array]:
    """Integrate with one command in volt per step, in s.

    Returns the states before step 0, keep, 2 keep, ... and the state after the last step.
    """
    u, x = np.ascontiguousarray(command, float), np.array(state, float)
    p = np.array([*_values(parameters), step])
    out = np.empty((-(-len(u) // keep), len(x)))
    (equations, function), library = _of(parameters), _library()
    if function is not None and library is not None:
        places = (address(array) for array in (x, u, p, out))
        library.run(ctypes.byref(function), len(x), len(u), keep, *places)
        return out, x
    for j, volt in enumerate(u.tolist()):
        if j % keep == 0:
            out[j // keep] = x
        x = equations(0, x, [volt], p)
    return out, x
