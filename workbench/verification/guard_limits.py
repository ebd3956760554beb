"""Limits of a guard from what a plant declares: ranges, converters, stops, and how fast it can be.

The plant is held at the ends of its commands, one after the other, from rest. The fastest change of
each output from sample to sample there, times a margin, is the largest plausible one; the time in
which the first output has moved by 20 steps of its converter is the time in which a command moves
it. Its linear model there, by the curve of its actuator if it declares one, is that of the
estimator.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress

import numpy as np

from controllers.estimator import MOST_SENSORS, Estimator, design_estimator
from controllers.guard import CommandLimits, Guard, Guarded, ReferenceLimits, SensorLimits
from controllers.protocol import Controller
from workbench.arrays import Vector
from workbench.errors import NumericalError, check_choice
from workbench.linearisation import LinearModel, linear_model, linearise
from workbench.linearisation.actuator_inverse import (
    ActuatorInverse,
    places_of,
    straightened_point,
)
from workbench.model import ActuatorCurve, Model, Output
from workbench.model.quantities import of_names, told_units
from workbench.operating_point import OperatingPoint, operating_point
from workbench.simulation import Trajectory, simulate

TOLERANCE = 0.02
"""Error that a plant that moves does not keep, as a fraction of the range."""

MARGIN = 3.0
"""How much faster than under full command from rest a measurement may change."""

SAMPLES = 500
"""For how long the plant is held at an end of its command."""

PACE = 0.1
"""Tolerances per sample with which a reference out of range goes to its end."""

SWINGS = 12.0
"""Changes of an error's side after which a loop is taken to oscillate."""

SETTLED = 0.1
"""Share of its way by which a settled output still moves, and by which another plant's differs."""

AWAY = 10.0
"""Way, in tolerances, behind which a plant is stopped to tell how long that takes."""

LONGEST = 20_000
"""Most samples for which stopping a plant is looked at."""

LEAST_PATIENCE = 2000.0
"""Fewest samples after which nothing gets better."""


def guarded(
    controller: Controller, plant: Model | LinearModel, *, at: Mapping[str, float] | None = None
) -> Guarded:
    """Put a controller into a guard with the limits that its plant declares.

    A command may be at its end, or an error may stay, for 100 times what the plant needs, and
    `LEAST_PATIENCE` at least; the inner law acts for as long as it needs to stop the plant from
    full speed; other times, and that as the least, are those of `Guard`.

    Args:
        at: Where the plant rests, values by name in SI; by default where its nominal inputs hold
            it, or the operating point of the linear model.
    """
    plant = plant if isinstance(plant, Model) else linear_model(plant)
    point = operating_point(plant, at or {}) if isinstance(plant, Model) else plant.operating_point
    model = point.model
    held = list(_held(point, controller.sample_time))
    outputs = {q.name: q for q in model.outputs}
    for name in (*controller.sensors, *controller.controlled):
        check_choice("sensor of the controller", name, outputs)
    for name in controller.actuators:
        check_choice("actuator of the controller", name, [q.name for q in model.inputs])
    ranges = {name: _range(model, outputs[name]) for name in outputs}
    tolerances = {name: _tolerance(outputs[name], ranges[name]) for name in outputs}
    changes = {
        name: max((float(np.abs(np.diff(run[name])).max()) for run in held), default=math.inf)
        for name in outputs
    }
    sensors = tuple(
        SensorLimits(
            *_sensible(q, ranges[q.name]),
            jump=MARGIN * changes[q.name] + 10.0 * q.noise_rms + 2.0 * q.resolution,
            doubt=tolerances[q.name],
            **_reached([run[q.name] for run in held]),
        )
        for q in of_names(model.outputs, controller.sensors)
    )
    references = tuple(
        ReferenceLimits(
            *ranges[name],
            _above_noise(outputs[name], tolerances[name]),
            float(controller.sensors.index(name) if name in controller.sensors else -1),
            pace=PACE * tolerances[name],
            **_braking([run[name] for run in held], *ranges[name], tolerances[name]),
        )
        for name in controller.controlled
    )
    response = min(
        (
            _response(run[name], 20.0 * outputs[name].resolution or 0.1 * tolerances[name])
            for run in held
            for name in controller.controlled[:1]
        ),
        default=math.inf,
    )
    commands = tuple(
        CommandLimits(q.nominal, q.lower, q.upper)
        for q in of_names(model.inputs, controller.actuators)
    )
    estimator = _estimator(controller, plant, point, held, tolerances)
    ends = [[getattr(own, side) for own in commands] for side in ("lower", "upper")]
    guard = Guard(
        sensors,
        references,
        commands,
        estimator=estimator,
        inner=max(
            Guard.inner,
            _to_rest(estimator, references, [run.states - point.x for run in held], *ends),
        ),
        patience=max(100.0 * response, LEAST_PATIENCE),
        swings=SWINGS,
    )
    return Guarded(controller, guard, told_units((*model.outputs, *model.inputs)))


def _to_rest(
    estimator: Estimator | None,
    references: Sequence[ReferenceLimits],
    held: Sequence[Vector],
    lower: Sequence[float],
    upper: Sequence[float],
) -> float:
    """Return after how many samples the inner law has stopped the followed outputs.

    In as long again they move by less than a tolerance then. It stops the linear model
    where it is after a held command has moved an output by `AWAY` tolerances, or as far as it can.
    """
    most = 0
    if estimator is None or not len(estimator.K):
        return most
    own, n = estimator, estimator.F.shape[0] - len(references)
    sensors = [int(limits.sensor) for limits in references]
    if min(sensors) < 0:
        return most
    tolerance = np.array([limits.tolerance for limits in references])
    for x in held:
        moved = np.abs(x @ own.C[sensors, :n].T) / tolerance
        far = np.flatnonzero(moved.max(axis=1) > AWAY)
        z = np.append(x[far[0] if len(far) else -1], np.zeros(len(references)))
        start = own.C[sensors] @ z
        target = tuple(own.rest_followed + start)
        last = 0
        for k in range(LONGEST):
            before = own.C[sensors] @ z
            z = own.predicted(z, tuple(np.clip(own.inner(z, target), lower, upper)))
            moves = np.abs(own.C[sensors] @ z - before) * (k + Guard.inner)
            if np.any(np.maximum(np.abs(before - start), moves) > tolerance):
                last = k
            elif k > 1.2 * last + Guard.inner:
                break
        most = max(most, last)
    return float(most)


def _tolerance(output: Output, reach: tuple[float, float]) -> float:
    span = reach[1] - reach[0] if reach[1] - reach[0] < math.inf else 2.0 * output.scale
    return max(TOLERANCE * span, 20.0 * output.resolution)


def _above_noise(output: Output, tolerance: float) -> float:
    """Return a tolerance of which a quarter that changes its side, a swing, is no noise."""
    return max(tolerance, 20.0 * math.hypot(output.noise_rms, output.correlated_noise_rms))


def _estimator(
    controller: Controller,
    plant: Model | LinearModel,
    point: OperatingPoint,
    held: Sequence[Trajectory],
    tolerances: Mapping[str, float],
) -> Estimator | None:
    """Return the estimator of a plant, whose other inputs rest; None if much is measured."""
    model = point.model
    followed = tuple(controller.controlled)
    if (
        not held
        or not set(followed) & set(controller.sensors)
        or len(controller.sensors) > MOST_SENSORS
    ):
        return None
    curves = model.traits.curves if len(model.traits.curves) == len(model.inputs) else ()
    straight = straightened_point(point, curves) if curves else point
    linear = linearise(straight, verdict=False) if curves or isinstance(plant, Model) else plant
    places = [[q.name for q in model.inputs].index(name) for name in controller.actuators]
    if len(linear.input_names) == len(model.inputs):
        linear = linear.select(inputs=[linear.input_names[k] for k in places])
    elif linear.input_names != tuple(controller.actuators):
        return None
    noise = [
        max(math.hypot(q.noise_rms, 0.3 * q.resolution), 1e-3 * tolerances[q.name])
        for q in of_names(model.outputs, controller.sensors)
    ]
    commands = [model.inputs[k] for k in places]
    reach = [min(q.upper - q.nominal, q.nominal - q.lower) for q in commands]
    commanded, entered = _curve(point, straight, curves)
    return design_estimator(
        linear,
        sensors=controller.sensors,
        followed=followed,
        change=np.max([np.abs(np.diff(run.states, axis=0)).max(axis=0) for run in held], axis=0),
        noise=np.array(noise),
        tolerance=np.array([tolerances[name] for name in followed]),
        reach=np.array(reach),
        curve=(commanded[places], entered[places]) if curves else (commanded, entered),
        sample_time=controller.sample_time,
    )


def _curve(
    point: OperatingPoint, straight: OperatingPoint, curves: Sequence[ActuatorCurve]
) -> tuple[Vector, Vector]:
    """Return commands, and those that do the same along straight lines, shape (n_inputs, n)."""
    values = np.linspace(-1.0, 1.0, 81)
    commands, entered = np.zeros((2, len(curves), len(values)))
    for curve in curves:
        i, k = places_of(point.model, curve)
        off = straight.u[k] - straight.x[i]
        commands[k], entered[k] = ActuatorInverse(point, curve)(values), curve.full * values + off
    highest = np.maximum.accumulate(commands, axis=1)
    rising = np.concatenate([[True], np.all(np.diff(highest, axis=1) > 0.0, axis=0)])
    return commands[:, rising], entered[:, rising]


def _held(point: OperatingPoint, sample_time: float) -> Iterator[Trajectory]:
    """Yield what the plant does while it is held at each end of each command."""
    for i, quantity in enumerate(point.model.inputs):
        for end in (quantity.lower, quantity.upper):
            if math.isfinite(end):
                u = point.u.copy()
                u[i] = end
                yield from _trajectory(point.model, point.x, u, sample_time)


def _trajectory(model: Model, x: Vector, u: Vector, h: float) -> Iterator[Trajectory]:
    """Yield what a command does, for as long as the plant stays where its laws hold."""
    for samples in (SAMPLES, SAMPLES // 4, SAMPLES // 16, SAMPLES // 64):
        with suppress(NumericalError):
            yield simulate(model, np.tile(u, (samples, 1)), sample_time=h, start=x, check=False)
            return


def _response(y: Vector, distance: float) -> float:
    """Return after how many samples an output has moved by a distance; infinite if never."""
    left = np.flatnonzero(np.abs(y - y[0]) > distance)
    return float(left[0]) if len(left) else math.inf


def _reached(held: Sequence[Vector]) -> dict[str, float]:
    """Return between what an output may be expected, where commands at their ends settle it."""
    ends = [y[-(len(y) // 5) :] for y in held]
    least, most = min(map(np.min, held), default=0.0), max(map(np.max, held), default=0.0)
    more = SETTLED * (most - least)
    if not held or any(np.ptp(y) > more for y in ends):
        return {}
    return {"least": float(least - more), "most": float(most + more)}


def _braking(
    held: Sequence[Vector], lower: float, upper: float, tolerance: float
) -> dict[str, float]:
    """Return the fastest change of an output's pace per sample, and how long a reversal takes.

    Only that between the ends of its range counts, which no stop makes.
    """
    best: dict[str, float] = {}
    for whole in held:
        out = np.flatnonzero((whole < lower + tolerance) | (whole > upper - tolerance))
        y = whole[: max(int(out[0]) - 1, 0)] if len(out) else whole
        change = np.abs(np.diff(y, 2))
        if len(change) and change.max() > best.get("brake", 0.0):
            lag = 4.0 * float(np.flatnonzero(change >= 0.5 * change.max())[0])
            best = {"brake": float(change.max()), "lag": lag}
    return best


def _range(model: Model, output: Output) -> tuple[float, float]:
    """Return where an output may be asked to be: its stops, or the range of its sensor."""
    for name, low, high in model.traits.stops:
        if name == output.name:
            return model.bound(low), model.bound(high)
    return output.lower, output.upper


def _sensible(output: Output, reach: tuple[float, float]) -> tuple[float, float]:
    """Return what a sensor may read: its range, or a tenth more than the stops allow."""
    more = 0.1 * (reach[1] - reach[0]) if math.isfinite(reach[1] - reach[0]) else math.inf
    lower = output.lower if math.isfinite(output.lower) else reach[0] - more
    upper = output.upper if math.isfinite(output.upper) else reach[1] + more
    return lower, upper
