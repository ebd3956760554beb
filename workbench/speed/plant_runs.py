"""Open and closed loop of the arm, beside general integrators and python-control."""

from __future__ import annotations

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
from workbench.computing.buffered import Buffered
from workbench.experiments import pulse_train
from workbench.linearisation import linearise
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.simulation import simulate
from workbench.simulation.equations import compiled
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
CONTROL_LOOP = "python-control input_output_response per sample"


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

    def run(self, rates: Rates, voltage: Vector, method: str, tolerance: float) -> Vector:
        """Return the scaled states after each sample, by a solver of SciPy that begins it anew."""
        step, z = _with_scipy(rates, method, tolerance), self.model.initial_state() / self.scale
        return np.array([z := step(z, float(u)) for u in voltage])


def _plant(model: Model) -> _Plant:
    traced, values = model.exact, model.values
    scale = np.array([q.scale for q in model.states])
    z = ca.SX.sym("z", len(scale))
    rates = traced.rates_function(z * scale, traced.u, traced.p) / scale
    plain = ca.Function("scaled_rates", [z, traced.u, traced.p], [rates])
    call = Buffered(compiled(plain))
    return _Plant(
        model,
        scale,
        lambda state, voltage: call(state, voltage, values)[0].flatten(),
        lambda state, voltage: np.asarray(plain(state, voltage, values), dtype=float).ravel(),
    )


def _with_scipy(rates: Rates, method: str, tolerance: float = _PEERS) -> Step:
    """Return what advances scaled states by a sample with SciPy's solver, begun anew."""
    from scipy.integrate import solve_ivp

    accurate = {"rtol": tolerance, "atol": tolerance}

    def step(z: Vector, u: float) -> Vector:
        found = solve_ivp(lambda _, x: rates(x, u), (0.0, SAMPLE_TIME), z, method, **accurate)
        return np.asarray(found.y[:, -1])

    return step


def simulated(model: Model, voltage: Vector, tolerance: float) -> Vector:
    """Return the states of an open-loop run, shape (n, n_states), in SI.

    Args:
        voltage: Command of the valve, shape (n,), in V.
        tolerance: Local error allowed in a step, relative to the scales of the states.
    """
    run = simulate(model, voltage, sample_time=SAMPLE_TIME, tolerance=tolerance, check=False)
    return run.states


def _apart(states: Vector, reference: Vector) -> float:
    n = min(len(states), len(reference))
    return float(np.abs(states[:n] - reference[:n]).max())


def open_loop(model: Model) -> Comparison:
    """Compare runs along a sine in small steps: at a pulse CVODES over a grid gives up."""
    plant, seconds = _plant(model), 2.0
    t = SAMPLE_TIME * np.arange(round(seconds / SAMPLE_TIME))
    voltage = np.asarray(5.0 + 0.5 * np.sin(math.pi * t))
    exact = plant.run(plant.rates, voltage, "DOP853", 1e-12)
    times = timed(lambda: simulated(model, voltage, TOLERANCE), per=seconds, repeats=10, warm=True)
    # The workbench tells the state at each sample, the others after each.
    error = _apart(times.result[1:] / plant.scale, exact)
    ways = [Way(f"workbench, tolerance {TOLERANCE:g}", times, error)]
    for way, rates, part in ((LSODA, plant.plain, 0.5), (LSODA_FAST, plant.rates, 1.0)):
        some = voltage[: round(part * len(voltage))]
        one = partial(plant.run, rates, some, "LSODA", _PEERS)
        times = timed(one, per=part * seconds, repeats=2)
        ways.append(Way(way, times, _apart(times.result, exact)))
    ways.append(tried(CVODES, "casadi", lambda _: _cvodes(plant, voltage, exact)))
    return Comparison(
        "open-loop",
        "Open loop of the arm: a sine of 0.5 V at 0.5 Hz, 2 s",
        "simulated second",
        "largest difference to DOP853 at 1e-12, over the states' scales",
        tuple(ways),
        f"Tolerance of the others {_PEERS:g} on scaled states.",
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


def accuracy(model: Model) -> tuple[float, str]:
    """Return the largest error on pulses, scaled by the states, and what it consists of."""
    plant, voltage = _plant(model), pulse_train(duration=4.2)
    exact = plant.run(plant.rates, voltage, "DOP853", 1e-12)

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


def loop_parts(model: Model) -> str:
    """Say what a sample of the loop consists of, in us."""
    samples = 2000
    pid, start = _designed(model)
    plant = FullPlant(model, SAMPLE_TIME, start, tolerance=1e-5)
    names = [q.name for q in model.outputs]
    seen = tuple(float(plant.outputs[names.index(name)]) for name in pid.sensors)
    guarded = Guarded(pid)
    memory, inside = pid.initial_state(seen), guarded.initial_state(seen)

    def each(step: Callable[[], object]) -> float:
        times = timed(lambda: [step() for _ in range(samples)], per=samples)
        return 1e6 * min(times.seconds)

    held, law, both = (
        each(lambda: plant.hold((5.1,))),
        each(lambda: pid.step(memory, seen, (0.5,))),
        each(lambda: guarded.step(inside, seen, (0.5,))),
    )
    return (
        f"the plant {held:.1f}, the law {law:.1f}, its guard {both - law:.1f}, the rest"
        " sensors, converters and records"
    )


def _designed(model: Model) -> tuple[Controller, Vector]:
    """Return a PID for 30 deg, and the state where it was designed."""
    point = operating_point(model.without("bearing_friction"), {"angle": math.radians(30.0)})
    return design_pid(linearise(point, verdict=False)), point.x


def closed_loop(model: Model) -> tuple[Comparison, Times]:
    """Compare closed loops of one controller in Python at 500 Hz; also the whole step scenario."""
    pid, _ = _designed(model)
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

    def other(name: str, step: Step) -> Way:
        times = timed(partial(_loop, pid, plant, scenario, step), per=length, repeats=2)
        return Way(name, times, math.degrees(_apart(times.result, exact)))

    def with_control(ct: Any) -> Way:
        n, t = len(plant.scale), np.array([0.0, SAMPLE_TIME])
        system = ct.nlsys(
            lambda _t, x, u, _p: plant.rates(x, float(u[0])), None, inputs=1, outputs=n, states=n
        )
        accurate = {"rtol": _PEERS, "atol": _PEERS}

        def step(z: Vector, u: float) -> Vector:
            held = np.full((1, 2), u)
            run = ct.input_output_response(system, t, held, z, solve_ivp_kwargs=accurate)
            return np.asarray(run.states)[:, -1]

        return other(CONTROL_LOOP, step)

    ways += [
        other(LSODA_FAST, _with_scipy(plant.rates, "LSODA")),
        tried(CONTROL_LOOP, "control", with_control),
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
