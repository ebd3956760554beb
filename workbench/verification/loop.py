"""The sampled loop: one controller, one plant, one scenario.

At t = k h, in this order:

1. the sensors read the plant: noise, then conversion (quantised), then clipped to their range;
2. the references of sample k (and the previewed ones) are read;
3. the controller steps;
4. the command is clipped to the input's range, changes by no more than its slew lets it, and is
   converted (quantised);
5. the command is held over [k h, (k + 1) h) while the plant moves.

The controller's own computing time is not simulated as a delay. It runs inside its guard; one that
has none is given that without limits, which refuses what is not finite (`controllers.guard`).
"""

from __future__ import annotations

import math
import numbers
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from controllers.guard import Guarded, unguarded
from controllers.protocol import Controller, check_controller
from workbench.arrays import Vector
from workbench.computing.counted import count
from workbench.errors import NumericalError, WorkbenchError, check_choice, check_finite, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.exact_delays import channels_of
from workbench.linearisation.state_space import linear_model
from workbench.model import Effect, Input, Model, Output, Parameter
from workbench.model.linear_system import LinearEquations
from workbench.operating_point import input_named, operating_point, usual_inputs
from workbench.plants.registry import model_of
from workbench.verification.closed_loop_run import Run
from workbench.verification.sampled_plant import TOLERANCE, FullPlant, LatePlant, LinearPlant
from workbench.verification.scenario import DEADLINE, Scenario, SignalFault


def verify(
    controller: Controller,
    plant: Model | LinearModel | Any,
    scenario: Scenario,
    *,
    seed: int = 0,
    tolerance: float = TOLERANCE,
    method: Literal["auto", "erk", "rosenbrock"] = "auto",
) -> Run:
    """Run a controller on a plant through a scenario.

    Args:
        plant: The full plant, or what stands for it, such as a nonlinear system of python-control
            or a function of CasADi; or a linear model or system, discretised exactly. A linear
            model by the opening meets the same command as the plant. One by the voltage receives
            ``controller.linear_command``, neither clipped nor quantised, so that a compensated
            valve curve does not count twice.
        tolerance: Local error allowed in a step of the plant, relative to its scales.
        method: ``"erk"``, ``"rosenbrock"`` for stiff plants, or ``"auto"``: the first, and the
            second where the first gives up.

    Raises:
        NumericalError: If the plant left the range of its laws so far that it cannot be simulated.
    """
    check_choice("integration method", method, ("auto", "erk", "rosenbrock"))
    check_controller(controller)
    if not isinstance(plant, (Model, LinearModel)):
        model = model_of(plant)
        linear = isinstance(model.equations, LinearEquations)
        plant = linear_model(plant) if linear else model
    if method == "auto":
        try:
            return verify(controller, plant, scenario, seed=seed, tolerance=tolerance, method="erk")
        except NumericalError:
            method = "rosenbrock"
    h = scenario.sample_time
    if not math.isclose(controller.sample_time, h, rel_tol=1e-6):
        raise WorkbenchError(
            f"controller {controller.name!r} steps every {controller.sample_time:g} s and scenario"
            f" {scenario.name!r} every {h:g} s; give the scenario"
            f" sample_time={controller.sample_time:g}, or the design sample_time={h:g}"
        )
    known = plant if isinstance(plant, Model) else plant.operating_point.model
    for name in controller.controlled:
        check_choice("controlled output", name, [q.name for q in known.outputs])
    for left in (name for name in controller.controlled if name not in scenario.references):
        raise WorkbenchError(
            f"controller {controller.name!r} follows {', '.join(controller.controlled)}, and"
            f" scenario {scenario.name!r} has references of {', '.join(scenario.references)}; give"
            f" one of {left}, such as Steps((0.0,), (VALUE,)) with its value at rest, or follow"
            " fewer outputs (measured)"
        )
    for actuator in controller.actuators:
        check_choice("actuator", actuator, [q.name for q in known.inputs])
    events: list[tuple[int, str, float]] = []
    sampled: FullPlant | LinearPlant
    if isinstance(plant, Model):
        model = _with_disturbances(plant, scenario, events)
        usual = usual_inputs(model).items()
        idle = {input_named(model, n): u for n, u in usual if n not in controller.actuators}
        start = scenario.start_values()
        rest = operating_point(
            model, {**idle, **start} if len(start) <= len(controller.actuators) else start
        )
        if events or channels_of(model) is None:
            sampled = FullPlant(model, h, rest.x, before=rest.u, tolerance=tolerance, method=method)
        else:
            sampled = LatePlant(model, h, (rest.x, rest.u))
        begin = rest.u
    elif scenario.changes or scenario.disturbances:
        raise WorkbenchError(
            f"scenario {scenario.name!r} changes the plant during the run, which a linear model"
            " cannot; use the full plant"
        )
    else:
        sampled = LinearPlant(plant, h, scenario.start_values())
        begin = plant.operating_point.u
    return _loop(controller, sampled, scenario, seed, events, begin)


def _loop(
    controller: Controller,
    plant: FullPlant | LinearPlant,
    scenario: Scenario,
    seed: int,
    events: list[tuple[int, str, float]],
    begin: Vector,
) -> Run:
    name, straight = plant.name, plant.straight
    inputs, outputs = plant.commanded, plant.measured
    law = controller
    controller = law if isinstance(law, Guarded) else Guarded(law)
    h, n = scenario.sample_time, scenario.samples
    warm = round(scenario.settle / h)
    names = [q.name for q in outputs]
    for sensor in controller.sensors:
        check_choice("sensor", sensor, names)
    columns = [names.index(sensor) for sensor in controller.sensors]
    sense = _sensors([outputs[i] for i in columns], columns, scenario, warm + n, seed)
    rows, targets = _references(controller, scenario, warm, n)
    spoil, missed = _spoiled(controller, scenario)
    convert = _actuators(controller, inputs, scenario, begin, real=not straight)
    straighten = controller.linear_command
    step, hold, late_samples = controller.step, plant.hold, scenario.late_samples

    states = np.empty((n, len(plant.state)))
    measurements, measured, commands, infos = [], [], [], []
    parameters = np.empty((n, len(plant.parameters)))
    parameters[:] = plant.parameters
    pending = sorted(events)
    memory: Any = None
    line: deque[tuple[float, ...]] = deque()
    try:
        for k in range(-warm, n):
            while pending and k >= pending[0][0]:
                _, parameter, value = pending.pop(0)
                assert isinstance(plant, FullPlant)
                plant.set_parameter(parameter, value)
                parameters[k:] = plant.parameters
            seen, asked = sense(k + warm, plant.outputs), rows[k + warm]
            if spoil and k >= 0:
                seen, asked = spoil(k, seen, asked)
            if k == -warm:
                _check_step(unguarded(law), seen, asked)
                memory = controller.initial_state(seen)
            late = k >= 0 and k in missed
            command, memory, info = controller.missed(memory) if late else step(memory, seen, asked)
            if late_samples:
                # Before the first one arrives, it is the command that holds the start.
                line.extend([command] * (1 if k > -warm else 1 + late_samples))
                command = line.popleft()
            command = convert(straighten(command) if straight else command)
            if k >= 0:
                states[k] = plant.state
                measurements.append(plant.outputs)
                measured.append(seen)
                commands.append(command)
                infos.append(info)
            hold(command)
    except NumericalError as error:
        raise NumericalError(
            f"{controller.name} on {name}, {scenario.name}, at {k * h:.3f} s: {error}"
        ) from None
    if infos and "iterations" in infos[0]:
        count("solver_iterations", int(np.nansum([info.get("iterations", 0.0) for info in infos])))
    check_finite(f"states of {name} with {controller.name}", states)
    return Run(
        controller=controller.name,
        plant=name,
        scenario=scenario,
        seed=seed,
        time=np.asarray(h * np.arange(n), dtype=float),
        references=targets,
        states=states,
        outputs=np.array(measurements, dtype=float),
        measured=np.array(measured, dtype=float).reshape(n, -1),
        inputs=np.array(commands, dtype=float),
        parameters=parameters,
        infos=tuple(infos),
        output_quantities=outputs,
        input_quantities=inputs,
        sensors=controller.sensors,
        controlled=controller.controlled,
        model=plant.model,
        integrator=plant.integrator,
        tolerance=plant.tolerance,
        state_names=plant.state_names,
        surface_layer=float(getattr(unguarded(controller), "layer", 1.0)),
        guarded=isinstance(law, Guarded),
    )


def _check_step(law: Controller, seen: Any, asked: Any) -> None:
    """Try one sample of a user's own law: it must return command, state and information."""
    if type(law).__module__.partition(".")[0] in ("controllers", "workbench"):
        return
    returned: Any = law.step(law.initial_state(seen), seen, asked)
    whole = isinstance(returned, tuple) and len(returned) == 3
    command, _, info = returned if whole else ((), None, None)
    if isinstance(command, (str, bytes)) or not hasattr(command, "__len__"):
        command = ()
    good = len(command) == len(law.actuators) and all(isinstance(c, numbers.Real) for c in command)
    if not good or not isinstance(info, Mapping):
        raise WorkbenchError(
            f"step of controller {law.name!r} returned {str(returned)[:80]}; it must return the"
            f" command as {len(law.actuators)} number(s), one per actuator, the next state, and a"
            " mapping with information, which may be empty"
        )


def _with_disturbances(
    model: Model, scenario: Scenario, events: list[tuple[int, str, float]]
) -> Model:
    """Attach one effect per disturbance and list every change of a parameter by its sample."""

    def sample(time: float) -> int:
        return int(np.ceil(time / scenario.sample_time - 1e-6))

    ports = {port.name: port for port in model.ports}
    for i, disturbance in enumerate(scenario.disturbances):
        check_choice("port of a disturbance", disturbance.port, ports)
        own, unit = f"disturbance_{i + 1}", ports[disturbance.port].unit
        level = Parameter("level", unit, abs(disturbance.level) or 1.0, value=0.0)
        added = Effect(own, (disturbance.port,), lambda at: at.value + at.p.level, (level,))
        model = model.with_effect(added)
        events.append((sample(disturbance.time), f"{own}.level", disturbance.level))
        if np.isfinite(disturbance.until):
            events.append((sample(disturbance.until), f"{own}.level", 0.0))
    for change in scenario.changes:
        model.parameter(change.parameter).with_value(change.value)
        events.append((sample(change.time), change.parameter, change.value))
    return model


def _sensors(
    sensors: Sequence[Output], columns: Sequence[int], scenario: Scenario, n: int, seed: int
) -> Callable[[int, Sequence[float]], tuple[float, ...]]:
    """Return a function (sample, measurements of all outputs) -> what the controller reads."""
    rng = np.random.default_rng(seed)
    chain = []
    for q, column in zip(sensors, columns, strict=True):
        # Every sensor draws, noisy or not, so that its noise does not depend on its neighbours.
        noise = (rng.standard_normal(n) * (q.noise_rms if scenario.noise else 0.0)).tolist()
        resolution = q.resolution if scenario.quantise else 0.0
        chain.append((column, noise, resolution, q.lower, q.upper))

    def sense(k: int, measurements: Sequence[float]) -> tuple[float, ...]:
        seen = []
        for column, drawn, resolution, lower, upper in chain:
            value = measurements[column] + drawn[k]
            if resolution:
                value = round(value / resolution) * resolution
            seen.append(lower if value < lower else upper if value > upper else value)
        return tuple(seen)

    return sense


def _spoiled(
    controller: Controller, scenario: Scenario
) -> tuple[
    Callable[[int, tuple[float, ...], tuple[float, ...]], tuple[Any, Any]] | None, frozenset[int]
]:
    """Return what puts the scenario's faults into signals, and the samples without a step."""
    names = [
        *controller.sensors,
        *(f"reference.{name}" for name in controller.controlled),
        DEADLINE,
    ]
    sensors, references = len(controller.sensors), len(controller.controlled)
    spans: list[tuple[int, int, int, SignalFault]] = []
    missed: set[int] = set()
    for fault in scenario.faults:
        check_choice("faulty signal", fault.signal, names)
        begin, end = (
            math.ceil(min(t, scenario.duration) / scenario.sample_time - 1e-6)
            for t in (fault.time, fault.until)
        )
        if fault.signal == DEADLINE:
            missed.update(range(begin, end))
        else:
            spans.append((names.index(fault.signal), begin, end, fault))
    if not spans:
        return None, frozenset(missed)
    kept: dict[int, float] = {}

    def spoil(
        k: int, seen: tuple[float, ...], asked: tuple[float, ...]
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        values = [*seen, *asked]
        for number, (i, begin, end, fault) in enumerate(spans):
            if begin <= k < end:
                places = [i] if i < sensors else range(i, len(values), references)
                kept.setdefault(number, values[i])
                for place in places:
                    values[place] = fault.of(values[place], kept[number])
        return tuple(values[:sensors]), tuple(values[sensors:])

    return spoil, frozenset(missed)


def _actuators(
    controller: Controller,
    inputs: Sequence[Input],
    scenario: Scenario,
    begin: Vector,
    *,
    real: bool,
) -> Callable[[tuple[float, ...]], tuple[float, ...]]:
    """Return a function from the controller's command to the values of all inputs.

    What the controller does not command stays where it is in the beginning.
    """
    names = [q.name for q in inputs]
    for actuator in controller.actuators:
        check_choice("actuator", actuator, names)
    idle = [q for q in inputs if q.name not in controller.actuators]
    sources = [*controller.actuators, *(q.name for q in idle)]
    resting = tuple(float(u) for q, u in zip(inputs, begin, strict=True) if q in idle)
    chain = [
        (sources.index(q.name), q.lower, q.upper, q.resolution if scenario.quantise else 0.0)
        if real
        else (sources.index(q.name), -math.inf, math.inf, 0.0)
        for q in inputs
    ]

    # What is slow starts from where the plant rests.
    paces = [q.slew * scenario.sample_time if real else math.inf for q in inputs]
    slow = [i for i, pace in enumerate(paces) if pace < math.inf]
    held = {i: float(begin[i]) for i in slow}

    def convert(command: tuple[float, ...]) -> tuple[float, ...]:
        values, given = [], [*command, *resting]
        for i in slow:
            low, high = held[i] - paces[i], held[i] + paces[i]
            source, lower, upper, _ = chain[i]
            given[source] = min(max(given[source], low, lower), high, upper)
            held[i] = given[source]
        for source, lower, upper, resolution in chain:
            value = given[source]
            value = lower if value < lower else upper if value > upper else value
            if resolution:
                value = round(value / resolution) * resolution
            values.append(value)
        return tuple(values)

    return convert


def _references(
    controller: Controller, scenario: Scenario, warm: int, n: int
) -> tuple[list[tuple[float, ...]], Mapping[str, Vector]]:
    """Return the reference row of every sample, and the trajectory of each controlled output."""
    preview = int(check_range("preview", controller.preview, 0, 1e5, "samples"))
    h = scenario.sample_time
    time = np.maximum(h * np.arange(-warm, n + preview), 0.0)
    trajectories = [scenario.references[name].sample(time) for name in controller.controlled]
    table = np.column_stack(trajectories) if trajectories else np.empty((len(time), 0))
    wide = np.hstack([table[i : i + warm + n] for i in range(preview + 1)])
    targets = {
        name: trajectory[warm : warm + n]
        for name, trajectory in zip(controller.controlled, trajectories, strict=True)
    }
    return [tuple(row) for row in wide.tolist()], targets
