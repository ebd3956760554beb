"""Do designs tolerate what nobody modelled: drawn machines, on the rig and on the own plant.

The designs are those of the shipped study ``tolerant``; none of them knows of any draw. They are
made once, and each runs its steps on every drawn machine, on the rig and on the workbench's own
plant with the same sizes.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from controllers.largest_bandwidth import MarginedDesign
from controllers.protocol import Controller
from workbench.arrays import Vector
from workbench.computing.processes import parallel
from workbench.errors import WorkbenchError
from workbench.evaluation.kept_answers import answered
from workbench.evaluation.rig import plant
from workbench.evaluation.rig.excitation import RATE
from workbench.evaluation.rig.plant import derivative
from workbench.evaluation.rig.simulate import follow
from workbench.evaluation.variations import Draw
from workbench.study.designs import bandwidth_against_delay
from workbench.study.read import load_study, shipped_study
from workbench.study.study import Study
from workbench.verification import Scenario, Steps, verify
from workbench.verification.each_step import each_step, step_responses
from workbench.verification.responses import oscillation, steady_error, variation_rate

REST = 200
"""Samples at the end of a step along which the valve rests."""


@functools.cache
def tolerant_study() -> Study:
    """Return the study whose designs are tried."""
    return load_study(shipped_study("tolerant"))


Designs = Mapping[str, MarginedDesign[Controller]]
"""Designs by controller of the study."""


def tolerant_designs(*, jobs: int = 1) -> Iterator[tuple[str, MarginedDesign[Controller]]]:
    """Design the controllers of the study, each told as soon as it is there."""
    recipes = tolerant_study().controllers
    for i, found in parallel([(r.designed, ()) for r in recipes.values()], jobs=jobs):
        yield list(recipes)[i], found


def traded(
    designs: Designs, *, jobs: int = 1
) -> Iterator[tuple[str, tuple[tuple[float, float], ...]]]:
    """Search the fastest designs for less and more delay and lag than the study's have.

    Yields:
        Controller with largest delays, in s, and speeds, in rad/s, its own among them.
    """
    recipes = tolerant_study().controllers
    shares = (0.0, 0.5, 1.5, 2.0)
    calls = [(bandwidth_against_delay, (recipes[name], shares)) for name in designs]
    for i, points in parallel(calls, jobs=jobs):
        name = list(designs)[i]
        fastest = recipes[name].fastest
        assert fastest is not None
        own = (fastest.uncertainty.delay[1], designs[name].speed)
        yield name, tuple(sorted((*points, own)))


def at_rest(parameters: Mapping[str, float], angle_deg: float) -> Vector:
    """Return the state of the rig at rest at an angle, in SI, with gauge pressures of 6 bar in sum.

    Args:
        parameters: Parameters of the rig by name, in SI.
    """
    given, bar = dict(parameters), 6.0

    def state(difference: float) -> Vector:
        pair = (0.5 * (bar + difference), 0.5 * (bar - difference))
        return plant.initial(angle_deg, pair, given, stretched=True)

    low, high = -0.97 * bar, 0.97 * bar
    for _ in range(40):
        middle = 0.5 * (low + high)
        pushed = float(derivative(state(middle), given["valve_centre"], given)[1])
        low, high = (middle, high) if pushed < 0.0 else (low, middle)
    return state(0.5 * (low + high))


def on_rig(law: Any, draw: Draw, scenario: Scenario) -> dict[str, Any]:
    """Run a controller on the rig of a draw along steps and measure it, in SI."""
    parameters, signal, settle = draw.rig, _steps(scenario), scenario.settle
    time = np.arange(round((scenario.duration + settle) * RATE)) / RATE - settle
    start = at_rest(parameters, math.degrees(signal.values[0]))
    run = follow(law, parameters, start, signal.sample(time), seed=draw.number)
    judged = slice(round(settle * RATE), None)
    return measured(time[judged], run.states[judged, 0], run.valve[judged], signal)


def on_own_plant(law: Any, draw: Draw, scenario: Scenario) -> dict[str, Any]:
    """Run a controller on the own plant of a draw along steps and measure it, in SI."""
    recipe = tolerant_study().plant
    rig = recipe.varied(effects=[e for part in draw.parts for e in part.effects]).build()
    values = {name: value for part in draw.parts for name, value in part.own.items()}
    rig = rig.with_parameters(
        {k: min(max(v, rig.parameter(k).lower), rig.parameter(k).upper) for k, v in values.items()}
    )
    run = verify(law, rig, scenario, seed=draw.number)
    return measured(run.time, run["angle"], run["valve"], _steps(scenario))


def _steps(scenario: Scenario) -> Steps:
    signal = scenario.references["angle"]
    assert isinstance(signal, Steps)
    return signal


SIMULATORS: dict[str, Callable[..., dict[str, Any]]] = {"rig": on_rig, "own plant": on_own_plant}
"""On what drawn machines run."""


def measured(time: Vector, angle: Vector, valve: Vector, signal: Steps) -> dict[str, Any]:
    """Return what is judged of a run along steps, in SI, by the names of metrics.

    Args:
        time: Sample times, shape (n,), in s.
        angle: True angle, shape (n,), in rad.
        valve: Command, shape (n,), in V.
    """
    steps = step_responses("angle", time, angle, signal.changes)
    parts = each_step(time, signal.changes)
    rests = [(time[p.part], angle[p.part], p.final) for p in parts]
    sizes = [d.step for d in tolerant_study().demands if d.step is not None]
    return {
        "settling_time": [
            s.settling.value
            for s in steps
            if any(math.isclose(abs(s.final - s.initial), size) for size in sizes)
        ],
        "overshoot": max(s.overshoot for s in steps),
        "oscillation": max(oscillation(t, y, window=0.6).value for t, y, _ in rests),
        "steady_error": [steady_error(t, end - y, window=0.4).value for t, y, end in rests],
        "stop_impacts": float(np.any(angle < 0.0) or np.any(angle > math.radians(60.0))),
        "chatter": variation_rate(time, valve).value,
        "valve_at_rest": max(float(np.std(valve[p.part][-REST:])) for p in parts),
    }


@dataclass(frozen=True)
class DrawnMachine:
    """A drawn machine on one simulator, with the controllers that are tried on it."""

    draw: Draw
    simulator: str
    laws: Mapping[str, Controller]

    @property
    def name(self) -> str:
        """Name of the machine."""
        return f"{self.simulator.replace(' ', '-')}-{self.draw.name}"


def run_machine(machine: DrawnMachine, _jobs: int) -> dict[str, Any]:
    """Run every design on one drawn machine; a machine that cannot rest or run has a reason."""
    scenario = next(iter(tolerant_study().scenarios.values()))
    found: dict[str, Any] = {}
    for name, law in machine.laws.items():
        try:
            found[name] = SIMULATORS[machine.simulator](law, machine.draw, scenario)
        except WorkbenchError as error:
            found[name] = {"reason": str(error)}
    draw = machine.draw
    kinds = list(draw.kinds)
    return {"draw": draw.name, "simulator": machine.simulator, "kinds": kinds, "runs": found}


def tolerance(
    drawn: Mapping[str, Sequence[Draw]], designs: Designs, out: Path, *, jobs: int = 1
) -> Iterator[dict[str, Any]]:
    """Run every design on drawn machines, by simulator, each kept as soon as it is there.

    What is kept of other designs counts for nothing: each set of designs has a folder of its own.
    """
    recipes = tolerant_study().controllers
    told = "".join(f"{recipes[name]!r} {design.speed}" for name, design in designs.items())
    out = out / hashlib.sha256(told.encode()).hexdigest()[:8]
    laws = {name: design.controller for name, design in designs.items()}
    machines = [DrawnMachine(draw, name, laws) for name, draws in drawn.items() for draw in draws]
    yield from answered(machines, out, run_machine, jobs=jobs)
