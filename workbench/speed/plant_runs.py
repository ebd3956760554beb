"""Open and closed loop of the arm, beside general integrators and other tools."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from controllers.guard import Guarded
from controllers.pid import design_pid
from controllers.protocol import Controller
from workbench.arrays import Vector
from workbench.linearisation import linearise
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.simulation import simulate
from workbench.simulation.equations import Buffered, Equations, compiled
from workbench.speed.measure import Comparison, Times, Way, timed, tried
from workbench.verification import Scenario, step_scenario, verify
from workbench.verification.sampled_plant import FullPlant

Rates = Callable[[Vector, float], Vector]
Step = Callable[[Vector, float], Vector]

SAMPLE_TIME = 0.002
TOLERANCE = 1e-7
"""Tolerance of the workbench's integrator; its error is measured."""

_PEERS = 1e-8
"""Tolerance of the others', relative and absolute, on scaled states."""

_TIGHT = 1e-9

LSODA, LSODA_FAST = "SciPy LSODA per sample", "SciPy LSODA per sample, compiled equations"
CVODES = "CasADi CVODES over a grid"
_CONTROL, _NUMBA = "python-control input_output_response", "numba Runge-Kutta 4 of fixed step"
CONTROL_LOOP = "python-control input_output_response per sample"
_DO_MPC = "do-mpc simulator per sample"

_FINE = 4
"""Runge-Kutta steps of fixed size per sample."""


@dataclass(frozen=True)
class _Plant:
    """The equations over scaled states, as machine code where a compiler is.

    Args:
        scale: Scales of the states, shape (n,), in SI.
        rates: Rates of the scaled states, per s.
        plain: The same as a function that CasADi interprets.
    """

    model: Model
    scale: Vector
    rates: Rates
    plain: Rates


def _plant(model: Model) -> _Plant:
    traced, values = model.exact, model.values
    scale = np.array([q.scale for q in model.states])
    z = ca.SX.sym("z", len(scale))
    rates = traced.rates_function(z * scale, traced.u, traced.p) / scale
    call = Buffered(compiled(ca.Function("scaled_rates", [z, traced.u, traced.p], [rates])))

    def of(state: Vector, voltage: float) -> Vector:
        return call(state, voltage, values)[0].copy()

    def called(state: Vector, voltage: float) -> Vector:
        found = np.asarray(traced.rates_function(state * scale, voltage, values), dtype=float)
        return np.asarray(found.ravel() / scale)

    return _Plant(model, scale, of, called)


def simulated(model: Model, voltage: Vector, tolerance: float) -> Vector:
    """Return the states of an open-loop run, shape (n, n_states), in SI.

    Args:
        voltage: Command of the valve, shape (n,), in V.
        tolerance: Local error allowed in a step, relative to the scales of the states.
    """
    run = simulate(model, voltage, sample_time=SAMPLE_TIME, tolerance=tolerance, check=False)
    return run.states


def pulses(seconds: float) -> Vector:
    """Return pulses of 0.9 V about the centre, in V."""
    t = SAMPLE_TIME * np.arange(round(seconds / SAMPLE_TIME))
    return np.asarray(5.0 + 0.9 * np.where((t % 4.0) < 2.0, 1.0, -1.0))


def sine(seconds: float) -> Vector:
    """Return a sine of 0.5 V in small steps, in V: at a pulse CVODES over a grid gives up."""
    t = SAMPLE_TIME * np.arange(round(seconds / SAMPLE_TIME))
    return np.asarray(5.0 + 0.5 * np.sin(math.pi * t))


def _with_scipy(rates: Rates, method: str, tolerance: float = _PEERS) -> Step:
    """Return what advances scaled states by a sample with SciPy's solver, begun anew."""
    from scipy.integrate import solve_ivp

    def step(z: Vector, u: float) -> Vector:
        found = solve_ivp(
            lambda _, state: rates(state, u),
            (0.0, SAMPLE_TIME),
            z,
            method,
            rtol=tolerance,
            atol=tolerance,
        )
        return np.asarray(found.y[:, -1])

    return step


def _run(step: Step, start: Vector, voltage: Vector) -> Vector:
    """Return the scaled states after each sample."""
    states, z = np.empty((len(voltage), len(start))), start
    for k, u in enumerate(voltage):
        states[k] = z = step(z, float(u))
    return states


def _apart(states: Vector, reference: Vector) -> float:
    n = min(len(states), len(reference))
    return float(np.abs(states[:n] - reference[:n]).max())


def open_loop(model: Model) -> tuple[Comparison, Comparison]:
    """Compare open-loop runs: a sine in small steps, and pulses."""
    plant = _plant(model)
    return (
        _open_loop(plant, "sine", "a sine of 0.5 V at 0.5 Hz, 2 s", sine(2.0)),
        _open_loop(plant, "pulses", "pulses of 0.9 V, 4.2 s", pulses(4.2)),
    )


def _open_loop(plant: _Plant, name: str, what: str, voltage: Vector) -> Comparison:
    start = plant.model.initial_state() / plant.scale
    exact = _run(_with_scipy(plant.rates, "DOP853", 1e-12), start, voltage)
    seconds = len(voltage) * SAMPLE_TIME
    times = timed(
        lambda: simulated(plant.model, voltage, TOLERANCE), per=seconds, repeats=10, warm=True
    )
    # The workbench tells the state at each sample, the others after each.
    error = _apart(times.result[1:] / plant.scale, exact)
    ways = [Way(f"workbench, tolerance {TOLERANCE:g}", times, error)]
    for way, method, rates, part in (
        (LSODA, "LSODA", plant.plain, 0.5),
        (LSODA_FAST, "LSODA", plant.rates, 1.0),
        ("SciPy Radau per sample, compiled equations", "Radau", plant.rates, 0.25),
        ("SciPy BDF per sample, compiled equations", "BDF", plant.rates, 0.25),
    ):
        samples = round(part * min(len(voltage), 1000))
        one = partial(_run, _with_scipy(rates, method), start, voltage[:samples])
        times = timed(one, per=samples * SAMPLE_TIME, repeats=2)
        ways.append(Way(way, times, _apart(times.result, exact)))
    ways += [
        tried(CVODES, "casadi", lambda _: _cvodes(plant, voltage, exact)),
        tried(_CONTROL, "control", lambda ct: _control(ct, plant, voltage, exact)),
        tried(_NUMBA, "numba", lambda nb: _numba(nb, plant, voltage, exact)),
    ]
    return Comparison(
        f"open-loop-{name}",
        f"Open loop of the arm: {what}",
        "simulated second",
        "largest difference to DOP853 at 1e-12, over the states' scales",
        tuple(ways),
        f"Tolerance of the others {_PEERS:g} on scaled states; all but the first LSODA and CVODES"
        " evaluate the same machine code. python-control interpolates inputs linearly between"
        " samples, which shifts a sampled input by half a sample.",
    )


def _cvodes(plant: _Plant, voltage: Vector, exact: Vector) -> Way:
    traced = plant.model.exact
    z = ca.SX.sym("z", len(plant.scale))
    rates = ca.substitute(traced.rates, traced.x, z * plant.scale) / plant.scale
    integrator = ca.integrator(
        "grid",
        "cvodes",
        {"x": z, "u": traced.u, "p": traced.p, "ode": rates},
        0.0,
        [SAMPLE_TIME * (i + 1) for i in range(len(voltage))],
        {"abstol": _PEERS, "reltol": _PEERS},
    )
    start, values = plant.model.initial_state() / plant.scale, plant.model.values
    times = timed(
        lambda: integrator(x0=start, u=voltage[None, :], p=values)["xf"],
        per=len(voltage) * SAMPLE_TIME,
    )
    error = _apart(np.asarray(times.result).T, exact)
    return Way(CVODES, times, error, "interpreted by CasADi")


def _responses(ct: Any, plant: _Plant) -> Callable[[Vector, Vector], Vector]:
    """Return what gives python-control's states at samples, from voltages there and a start."""
    n = len(plant.scale)
    system = ct.nlsys(
        lambda _t, x, u, _p: plant.rates(x, float(u[0])), None, inputs=1, outputs=n, states=n
    )
    accurate = {"rtol": _PEERS, "atol": _PEERS}

    def respond(voltage: Vector, start: Vector) -> Vector:
        t = SAMPLE_TIME * np.arange(len(voltage))
        run = ct.input_output_response(system, t, voltage[None], start, solve_ivp_kwargs=accurate)
        return np.asarray(run.states).T

    return respond


def _control(ct: Any, plant: _Plant, voltage: Vector, exact: Vector) -> Way:
    samples = min(len(voltage), 500)
    held = np.append(voltage[:samples], voltage[samples - 1])
    start = plant.model.initial_state() / plant.scale
    work = partial(_responses(ct, plant), held, start)
    times = timed(work, per=samples * SAMPLE_TIME, repeats=2)
    return Way(_CONTROL, times, _apart(times.result[1:], exact))


def _numba(numba: Any, plant: _Plant, voltage: Vector, exact: Vector) -> Way:
    """Time a loop that numba compiles around the generated equations."""
    model = plant.model
    equations = Equations((model.exact.rates_function,))
    function = equations.in_c(0)
    size, numbers = ctypes.c_void_p, ctypes.c_int
    rates = ctypes.CFUNCTYPE(numbers, size, size, size, size, numbers)(function.call)
    n = len(plant.scale)
    x, k, u = np.zeros(n), np.zeros(n), np.zeros(1)
    p = model.values
    arg = np.array([x.ctypes.data, u.ctypes.data, p.ctypes.data, 0], dtype=np.uintp)
    res = np.array([k.ctypes.data, 0], dtype=np.uintp)
    integers, scratch = np.zeros(10_000, dtype=np.int64), np.zeros(100_000)

    @numba.njit
    def run(start, voltage, states, x, k, u, arg, res, integers, scratch, h, steps):  # type: ignore[no-untyped-def]
        now, sums = start.copy(), np.zeros(len(start))
        for i in range(len(voltage)):
            u[0] = voltage[i]
            for _ in range(steps):
                sums[:] = 0.0
                for stage in range(4):
                    part = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                    for j in range(len(now)):
                        x[j] = now[j] + part * k[j]
                    rates(arg.ctypes, res.ctypes, integers.ctypes, scratch.ctypes, 0)
                    weight = 1.0 / 6.0 if stage in (0, 3) else 1.0 / 3.0
                    for j in range(len(now)):
                        sums[j] += weight * k[j]
                for j in range(len(now)):
                    now[j] += h * sums[j]
            for j in range(len(now)):
                states[i, j] = now[j]

    states = np.empty((len(voltage), n))
    memory = x, k, u, arg, res, integers, scratch

    def work() -> None:
        run(model.initial_state(), voltage, states, *memory, SAMPLE_TIME / _FINE, _FINE)

    work()
    times = timed(work, per=len(voltage) * SAMPLE_TIME, repeats=10)
    remark = f"{_FINE} steps per sample, no control of the error; compiling it is not counted"
    return Way(_NUMBA, times, _apart(states / plant.scale, exact), remark)


def accuracy(model: Model) -> tuple[float, str]:
    """Return the largest error on pulses, scaled by the states, and what it consists of."""
    plant, voltage = _plant(model), pulses(4.2)
    start = model.initial_state() / plant.scale
    exact = _run(_with_scipy(plant.rates, "DOP853", 1e-12), start, voltage)

    def errors(tolerance: float) -> Vector:
        return np.abs(simulated(model, voltage, tolerance)[1:] / plant.scale - exact[:-1])

    found = errors(TOLERANCE)
    k, i = np.unravel_index(found.argmax(), found.shape)
    tight = errors(_TIGHT)
    pace = timed(lambda: simulated(model, voltage, _TIGHT), per=len(voltage) * SAMPLE_TIME)
    return float(found.max()), (
        f"the {model.states[int(i)].name}'s at {SAMPLE_TIME * int(k):.3g} s, while the arm bounces"
        " on an end stop, whose contact begins within a step; rms"
        f" {np.sqrt(np.mean(found**2)):.1g}; at a tolerance of {_TIGHT:g} the largest is"
        f" {tight.max():.1g}, rms"
        f" {np.sqrt(np.mean(tight**2)):.1g}, at {1 / pace.median:.0f} x real time"
    )


def real_time(model: Model) -> Times:
    """Time pulses of 60 s, in s per simulated second."""
    voltage = pulses(60.0)
    return timed(lambda: simulated(model, voltage, TOLERANCE), per=60.0, repeats=5)


def loop_parts(model: Model, samples: int = 2000) -> str:
    """Say what a sample of the loop consists of, in us."""
    point = operating_point(model.without("bearing_friction"), {"angle": math.radians(30.0)})
    pid = design_pid(linearise(point, verdict=False))
    plant = FullPlant(model, SAMPLE_TIME, point.x, tolerance=1e-5)
    names = [q.name for q in model.outputs]
    seen = tuple(float(plant.outputs[names.index(name)]) for name in pid.sensors)
    memory = pid.initial_state(seen)

    guarded = Guarded(pid)
    inside = guarded.initial_state(seen)

    def law() -> None:
        for _ in range(samples):
            pid.step(memory, seen, (0.5,))

    def with_guard() -> None:
        for _ in range(samples):
            guarded.step(inside, seen, (0.5,))

    def held() -> None:
        for _ in range(samples):
            plant.hold((5.1,))

    plant_, law_, both = (
        1e6 * min(timed(work, per=samples).seconds) for work in (held, law, with_guard)
    )
    return (
        f"the plant {plant_:.1f}, the law {law_:.1f}, its guard {both - law_:.1f}, the rest"
        " sensors, converters and records"
    )


def closed_loop(model: Model) -> tuple[Comparison, Times]:
    """Compare closed loops of one controller in Python at 500 Hz; also the whole step scenario."""
    point = operating_point(model.without("bearing_friction"), {"angle": math.radians(30.0)})
    pid = design_pid(linearise(point, verdict=False))
    whole = step_scenario("angle", 15, 45, unit="deg")
    seconds = whole.settle + whole.samples * SAMPLE_TIME
    full = timed(lambda: verify(pid, model, whole, tolerance=1e-5), per=seconds, repeats=5)
    scenario = replace(
        step_scenario("angle", 28, 32, unit="deg").without_imperfections(), settle=0.0
    )
    length = scenario.samples * scenario.sample_time
    ours = timed(
        lambda: verify(pid, model, scenario, tolerance=1e-5)["angle"],
        per=length,
        repeats=5,
        warm=True,
    )
    plant = _plant(model)
    exact = _loop(pid, plant, scenario, _with_scipy(plant.rates, "DOP853", 1e-11))
    ways = [Way("workbench", ours, math.degrees(_apart(ours.result, exact)))]

    def other(name: str, step: Step, remark: str = "") -> Way:
        times = timed(partial(_loop, pid, plant, scenario, step), per=length, repeats=2)
        return Way(name, times, math.degrees(_apart(times.result, exact)), remark)

    def with_control(ct: Any) -> Way:
        respond = _responses(ct, plant)
        return other(CONTROL_LOOP, lambda z, u: respond(np.array([u, u]), z)[-1])

    ways += [
        other(LSODA_FAST, _with_scipy(plant.rates, "LSODA")),
        tried(CONTROL_LOOP, "control", with_control),
        tried(
            _DO_MPC,
            "do_mpc",
            lambda library: other(_DO_MPC, _do_mpc_step(library, plant), "CVODES of CasADi"),
        ),
    ]
    comparison = Comparison(
        "closed-loop",
        "Closed loop at 500 Hz: the same PID in Python, a step of 4°",
        "simulated second",
        "largest difference of the angle to DOP853 at 1e-11, in °",
        tuple(ways),
        "Sensors without noise and converters, so that all do the same.",
    )
    return comparison, full


def _loop(law: Controller, plant: _Plant, scenario: Scenario, step: Step) -> Vector:
    """Return the angle at the samples of a scenario, in rad."""
    model = plant.model
    z = operating_point(model, scenario.start_values()).x / plant.scale
    columns = [[q.name for q in model.outputs].index(name) for name in law.sensors]
    asked = scenario.references[law.controlled[0]].sample(
        scenario.sample_time * np.arange(scenario.samples)
    )
    valve, values = model.inputs[0], model.values
    read = model.exact.outputs_function
    memory: Any = None
    angles = np.empty(scenario.samples)
    u = model.nominal_input
    for k, reference in enumerate(np.asarray(asked).ravel()):
        outputs = np.asarray(read(z * plant.scale, u, values), dtype=float).ravel()
        seen = tuple(float(outputs[c]) for c in columns)
        angles[k] = seen[0]
        if memory is None:
            memory = law.initial_state(seen)
        command, memory, _ = law.step(memory, seen, (float(reference),))
        u = np.array([min(max(command[0], valve.lower), valve.upper)])
        z = step(z, float(u[0]))
    return angles


def _do_mpc_step(library: Any, plant: _Plant) -> Step:
    model = library.model.Model("continuous", "SX")
    z = model.set_variable("_x", "z", shape=(len(plant.scale), 1))
    u = model.set_variable("_u", "u")
    traced = plant.model.exact
    arguments = ca.vertcat(traced.x, traced.u, traced.p)
    rates = ca.substitute(
        traced.rates, arguments, ca.vertcat(z * plant.scale, u, plant.model.values)
    )
    model.set_rhs("z", rates / plant.scale)
    model.setup()
    simulator = library.simulator.Simulator(model)
    simulator.set_param(t_step=SAMPLE_TIME, abstol=_PEERS, reltol=_PEERS, integration_tool="cvodes")
    simulator.setup()

    def step(state: Vector, voltage: float) -> Vector:
        simulator.x0 = state
        return np.asarray(simulator.make_step(np.array([[voltage]]))).ravel()

    return step
