"""Limits of a guard from what a plant declares: ranges, converters, stops, and how fast it can be.

The plant is held at the ends of its commands, one after the other, from rest. The fastest change of
each output from sample to sample there, times a margin, is the largest plausible one; the time in
which the first output has moved by 20 steps of its converter is the time in which a command moves
it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from controllers.guard import CommandLimits, Guard, Guarded, ReferenceLimits, SensorLimits
from controllers.protocol import Controller
from workbench.errors import NumericalError, check_choice
from workbench.model import Model, Output
from workbench.model.traits import bound_value
from workbench.operating_point import operating_point
from workbench.simulation import simulate

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel

Vector = npt.NDArray[np.float64]

TOLERANCE = 0.02
"""Error that a plant that moves does not keep, as a fraction of the range."""

MARGIN = 3.0
"""How much faster than under full command from rest a measurement may change."""

SAMPLES = 500
"""For how long the plant is held at an end of its command."""

MOVES = 2.0
"""How many times the plant would have moved before a measurement that stays counts as stuck."""

SLOW = 0.15
"""From what share of the fastest change on a measurement does not come to rest at once."""

FEWEST_STILL, LEAST_PATIENCE = 6.0, 2000.0
"""Fewest samples after which a measurement is stuck, and after which nothing gets better."""


def guarded(
    controller: Controller,
    plant: Model | LinearModel,
    *,
    at: Mapping[str, float] | None = None,
    hold: float = 5.0,
    settle: float = 10.0,
    ramp: float = 50.0,
    stuck: float | None = None,
    patience: float | None = None,
) -> Guarded:
    """Put a controller into a guard with the limits that its plant declares.

    Args:
        at: Where the plant rests, values by name in SI; by default where its nominal inputs hold
            it, or the operating point of the linear model.
        hold: How long the last command is held, in samples; more than a slow sensor repeats itself,
            or it is taken for one that froze in motion.
        settle: How long measurements must be plausible before the law returns, in samples.
        ramp: How long the reference then moves to what is asked, in samples.
        stuck: Samples of full command after which a measurement must have changed; by default
            `MOVES` times what the plant needs.
        patience: How long a command may be at its end, or an error may stay, in samples; by
            default 100 times what the plant needs, and `LEAST_PATIENCE` at least.

    Raises:
        WorkbenchError: If the plant lacks a sensor or an actuator of the controller.

    Example:
        >>> from controllers.open_loop import ConstantCommand
        >>> from workbench.plants.servo_axis import servo_axis
        >>> held = ConstantCommand((0.0,), actuators=("force",), sensors=("position",))
        >>> guarded(held, servo_axis()).guard.commands
        (CommandLimits(safe=0.0, lower=-350.0, upper=350.0),)
    """
    model, held = _held(plant, at or {}, controller.sample_time)
    outputs = {q.name: q for q in model.outputs}
    inputs = {q.name: q for q in model.inputs}
    for name in (*controller.sensors, *controller.controlled):
        check_choice("sensor of the controller", name, outputs)
    for name in controller.actuators:
        check_choice("actuator of the controller", name, inputs)
    ranges = {name: _range(model, outputs[name]) for name in outputs}
    changes = {name: max((_fastest(y[name]) for y in held), default=math.inf) for name in outputs}
    sensors = tuple(
        SensorLimits(
            *_sensible(outputs[name], ranges[name]),
            jump=MARGIN * changes[name]
            + 10.0 * outputs[name].noise_rms
            + 2.0 * outputs[name].resolution,
            watched=float(
                name in controller.controlled
                or 4.0 * outputs[name].noise_rms > outputs[name].resolution > 0.0
            ),
            motion=max(
                SLOW * changes[name],
                10.0 * outputs[name].resolution,
                10.0 * outputs[name].noise_rms,
            ),
        )
        for name in controller.sensors
    )
    references = []
    for name in controller.controlled:
        low, high = ranges[name]
        span = high - low if high - low < math.inf else 2.0 * outputs[name].scale
        tolerance = max(TOLERANCE * span, 20.0 * outputs[name].resolution)
        place = controller.sensors.index(name) if name in controller.sensors else -1
        references.append(ReferenceLimits(low, high, tolerance, float(place)))
    response = min(
        (
            _response(y[name], 20.0 * outputs[name].resolution or 0.1 * limits.tolerance)
            for y in held
            for name, limits in zip(controller.controlled[:1], references, strict=False)
        ),
        default=math.inf,
    )
    if stuck is None:
        stuck = max(MOVES * response, FEWEST_STILL)
    if patience is None:
        patience = max(100.0 * response, LEAST_PATIENCE)
    commands = tuple(
        CommandLimits(inputs[name].nominal, inputs[name].lower, inputs[name].upper)
        for name in controller.actuators
    )
    guard = Guard(
        sensors,
        tuple(references),
        commands,
        hold=hold,
        settle=settle,
        ramp=ramp,
        stuck=stuck,
        patience=patience,
    )
    return Guarded(controller, guard)


def _held(
    plant: Model | LinearModel, at: Mapping[str, float], sample_time: float
) -> tuple[Model, list[dict[str, Vector]]]:
    """Return the plant, and its outputs while it is held at each end of each command."""
    point = operating_point(plant, at) if isinstance(plant, Model) else plant.operating_point
    model = point.model
    found: list[dict[str, Vector]] = []
    for i, quantity in enumerate(model.inputs):
        for end in (quantity.lower, quantity.upper):
            if math.isfinite(end):
                u = point.u.copy()
                u[i] = end
                found.extend(_trajectory(model, point.x, u, sample_time))
    return model, found


def _trajectory(model: Model, x: Vector, u: Vector, h: float) -> Iterator[dict[str, Vector]]:
    """Yield the outputs under a command, for as long as the plant stays where its laws hold."""
    samples = SAMPLES
    while samples >= 2:
        try:
            run = simulate(model, np.tile(u, (samples, 1)), sample_time=h, start=x, check=False)
        except NumericalError:
            samples //= 4
            continue
        yield {q.name: run[q.name] for q in model.outputs}
        return


def _fastest(y: Vector) -> float:
    return float(np.max(np.abs(np.diff(y))))


def _response(y: Vector, distance: float) -> float:
    """Return after how many samples an output has moved by a distance; infinite if never."""
    left = np.flatnonzero(np.abs(y - y[0]) > distance)
    return float(left[0]) if len(left) else math.inf


def _range(model: Model, output: Output) -> tuple[float, float]:
    """Return where an output may be asked to be: its stops, or the range of its sensor."""
    values = {q.name: q.value for q in model.parameters}
    for name, low, high in model.traits.stops:
        if name == output.name:
            return bound_value(low, values), bound_value(high, values)
    return output.lower, output.upper


def _sensible(output: Output, reach: tuple[float, float]) -> tuple[float, float]:
    """Return what a sensor may read: its range, or a tenth more than the stops allow."""
    more = 0.1 * (reach[1] - reach[0]) if math.isfinite(reach[1] - reach[0]) else math.inf
    lower = output.lower if math.isfinite(output.lower) else reach[0] - more
    upper = output.upper if math.isfinite(output.upper) else reach[1] + more
    return lower, upper
