"""Linear MPC of any followed outputs by any commands, for any linear model.

It is that of `controllers.mpc.whole_model`: each command takes the place of an opening, on a curve
that is a straight line through rest, fully open at the farther end of the command's range, and the
disturbances are those of the commands.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from controllers.mpc.disturbance_observer import DisturbanceObserver
from controllers.mpc.formulation import Change
from controllers.mpc.whole_model import (
    LinearMPC,
    MPCSpecification,
    Problem,
    acting_later,
    linear_mpc_design,
    mpc_of,
    observer_of,
    reference_paths,
)
from controllers.plain.limits import LoopLimits, LoopSpecification
from controllers.plain.loop import Loop, followed_by, named, outputs_of, speeds
from controllers.plain.many_loops import stacked
from controllers.plain.measured_outputs import designed_for
from controllers.plain.observer_law import DISTURBANCES, disturbances, doubts, random_walk
from controllers.plain.pace import at_pace
from controllers.plain.pairing import gain_at_rest
from controllers.plain.references import better, lags, led
from controllers.plain.selection import best_of
from controllers.valve_inverse import ValveInverse
from workbench.arrays import Matrix
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.state_space import linear_model
from workbench.model.units import quantity

FASTEST = 0.15
"""Largest speed of a reference that is tried, times the sample time: a horizon has its samples."""

ERRORS = tuple(10.0 ** (k / 4.0) for k in range(-20, 9))
"""Errors between which it is chosen, over what the commands move the output by at the speed."""

ALIKE = ((10, 1.0), (14, 1.0), (18, 1.0), (20, 1.0), (23, 1.0), (14, 1e3), (18, 1e3))
"""Places of those that are tried for all outputs alike, and how far commands may be from where they
will rest, over the usual: where a slow part of a plant answers long after the output has arrived,
they are far from there for as long."""

FOUND_IN: tuple[float, ...] = (10.0, 3.0, 1.0)
"""Time constants of the loop in which disturbances and offsets are found, ratios; the last are
tried of what is late by whole samples."""

ENDLESS = 1e6
"""Where a command without an end is taken to end, over its scale: beyond all that is asked."""


BEYOND, STIFFEST = 1e5, 1e12
"""Cost of an output beyond its limits over that of an error as large, a ratio; and the largest with
which a quadratic program is solved to all digits that count."""


@dataclass(frozen=True)
class PlainMPCSpecification(LoopSpecification):
    """What a linear MPC for any linear model is designed for.

    Args:
        speed: Speed of the references' lags, in rad/s; the horizon is four of its time constants.
            By default (0) the horizon is that of the best loop within its limits, and the lags are
            what leads a step best.
        error_scale: Error that weighs as much as a third of the command, in SI of the output, or
            one for each; by default (0) what makes the best loop.
        rate_time: Time in which a command may cross half of its range, or its scale where that has
            no end, in s; by default (0) two prediction samples, or what its slew lets it.
        disturbance: What the disturbance of the command is taken to walk by in ten time constants
            of the loop, rms, as a fraction of the command; what suits the loop by default (0).
        output_limits: Outputs that shall stay between two values, each as
            ``(name, lowest, highest)``, numbers in SI or texts with a unit such as ``"-30 cm/s"``;
            followed ones, or others, which are then read too. They give way where they must, at a
            cost far beyond that of the same error.
    """

    speed: float = 0.0
    error_scale: float | tuple[float, ...] = 0.0
    rate_time: float = 0.0
    disturbance: float = 0.0
    output_limits: tuple[tuple[str, float | str, float | str], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("speed", self.speed, 0.0, self.turning(0.5), "rad/s")
        for name in ("error_scale", "rate_time", "disturbance"):
            for value in np.atleast_1d(getattr(self, name)):
                check_range(name.replace("_", " "), float(value), 0.0, 1e30)
        rows = tuple(map(_limits_of_output, self.output_limits))
        object.__setattr__(self, "output_limits", rows)

    def reading_limited(self, linear: LinearModel) -> PlainMPCSpecification:
        """Return the specification that reads the limited outputs too, with limits in SI.

        Raises:
            WorkbenchError: If there is no such output, or it rests beyond its limits.
        """
        rest = dict(zip(linear.output_names, linear.y0.tolist(), strict=True))
        units = {q.name: q.unit for q in outputs_of(linear)}
        rows = []
        for name, *ends in self.output_limits:
            check_choice("limited output", name, rest)
            low, high = (
                quantity(f"limit of {name}", end, units[name]) if isinstance(end, str) else end
                for end in ends
            )
            rows.append(_limits_of_output((name, low, high)))
            check_range(f"{name} at rest", rest[name], low, high, fix="limits hold what rests")
        followed, *_ = followed_by(linear, self.measured, self.actuator)
        read = dict.fromkeys((*named(self.also_measured), *(n for n, *_ in rows)))
        also = tuple(n for n in read if n not in followed)
        return replace(self, also_measured=also, output_limits=tuple(rows))


def _limits_of_output(row: Any) -> tuple[str, float | str, float | str]:
    """Return name, lowest and highest value as they are told, in a tuple or in a list."""
    try:
        name, low, high = row if isinstance(row, (tuple, list)) else (row,)
        told = isinstance(low, str) or isinstance(high, str)
        if isinstance(name, str) and (told or 0.0 + low < 0.0 + high):
            return name, low, high
    except (TypeError, ValueError):
        pass
    raise WorkbenchError(
        f"output_limits holds {row!r}; give each output its name, the lowest and the highest value,"
        " numbers in SI or texts with a unit, -inf and inf for none, such as ('speed', -0.3, 0.3)"
    )


def design_plain_mpc(
    linear: LinearModel,
    specification: PlainMPCSpecification | None = None,
    *,
    change: Change | None = None,
) -> LinearMPC:
    """Design a linear MPC without offset for any linear model.

    Args:
        change: Takes the problem of the design, a `controllers.mpc.formulation.Formulation` of
            expressions of CasADi, and returns the one that is solved.

    Raises:
        WorkbenchError: If the outputs cannot be led to references by the commands, or a Riccati
            equation has no solution.
    """
    want = (specification or PlainMPCSpecification()).sampled(linear)
    if want.output_limits:
        want = want.reading_limited(linear_model(linear))
    # What else is measured is held against the model at rest, from which a plant is far elsewhere.
    law = designed_for(want, linear, partial(_within, want), lambda *_: False)
    return law.changed(change) if change else law


def _within(want: PlainMPCSpecification, limits: LoopLimits) -> LinearMPC:
    late = limits.late
    found = [_best(want, late, limits.predicted)]
    if samples := late.whole_samples:
        found.append(_best(want, late, limits.loop.at_once(), samples))
    held = late.held(late.judge(stacked(found)), "a linear MPC")
    return better(late, [found[k] for k in held])


def _best(
    want: PlainMPCSpecification, limits: LoopLimits, loop: Loop, samples: int = 0
) -> LinearMPC:
    """Return the best MPC that predicts with a loop whose commands act some samples late."""
    h = want.sample_time
    # Over many time constants of an unstable mode no prediction has a meaning.
    growing = float(np.max(loop.linear.poles.real, initial=0.0))
    # What a command at its end does not hold any more, a horizon must foresee.
    ended, top = bool(np.isfinite(loop.upper - loop.lower).any()), FASTEST / h
    top = min(top, limits.surest)
    if growing > 1e-6 / h and ended:
        top = min(max(2.0 * growing, 0.02 / h), 0.3 / h)
    low = min(growing, 0.5 * top)
    tried = [want.speed] if want.speed else [w for w in speeds(h, 16) if low <= w <= top]
    if growing > 0.0 and not want.speed:
        least = max(len(tried), 4 if ended else 8)
        tried = np.geomspace(top, max(low, tried[-1]), least).tolist()

    outputs = len(loop.measured)
    given = np.broadcast_to(np.array(want.error_scale, dtype=float), outputs)
    walks, times = disturbances(limits, want.disturbance), FOUND_IN[:1]
    if samples:
        # What is on its way is no disturbance: a filter of any speed lets a delay be.
        walks, times = walks[::3], FOUND_IN

    # The horizon does not depend on the disturbance, nor the observer on the error.
    @cache
    def horizon(speed: float, error: tuple[float, ...], far: float) -> LinearMPC:
        own, numbers = _problem(loop, want, speed, DISTURBANCES[0], error, far=far)
        seen = observer(speed, DISTURBANCES[0], 1.0, times[0])
        law = mpc_of(loop.shown, own, numbers, observer=seen)
        return replace(law, name="linear MPC")

    @cache
    def observer(speed: float, walk: float, doubt: float, time: float) -> DisturbanceObserver:
        own, numbers = _problem(loop, want, speed, walk, loop.output_scale, doubt, time)
        return observer_of(loop.shown, own, numbers)

    def designed(places: tuple[int, ...], at: tuple[float, ...]) -> LinearMPC:
        speed, far, *seen = at
        sizes = np.array([ERRORS[k] for k in places]) * loop.sizes([speed])[0]
        error = np.where(given > 0.0, given, sizes)
        law = horizon(speed, tuple(error.tolist()), far)
        law = replace(law, observer=observer(speed, *seen))
        return acting_later(law, samples) if samples else law

    alike = ALIKE[:1] if np.all(given > 0.0) else ALIKE
    grid = itertools.product(tried, alike, walks, doubts(loop), times)
    start = [((k,) * outputs, (speed, far, *seen)) for speed, (k, far), *seen in grid]
    law, _ = best_of(limits, designed, start, "a linear MPC", len(ERRORS))
    if want.speed:
        return at_pace(limits, law)

    def lagging(speed: tuple[float, ...]) -> LinearMPC:
        path = reference_paths(speed, h, law.prediction.preview_index)
        return replace(law, reference_speed=speed, path=path)

    return at_pace(limits, led(limits, lagging, lags(limits, law.reference_speed)))


def _straight(loop: Loop) -> tuple[ValveInverse, ...]:
    """Return the curve of each command, or a straight line, fully open at its farther end."""
    full, rest = np.maximum(*_rooms(loop)).tolist(), loop.linear.u0.tolist()
    return tuple(
        ValveInverse((0.0, far), (0.0, 1.0), at) if curve is None or left else curve.scaled(far)
        for far, at, curve, left in zip(full, rest, loop.curves, loop.fading, strict=True)
    )


def _rooms(loop: Loop) -> tuple[Matrix, Matrix]:
    """Return what each command may change by below and above rest, in SI."""
    rooms = (loop.linear.u0 - loop.lower, loop.upper - loop.linear.u0)
    below, above = (np.where(room < math.inf, room, ENDLESS * loop.command_scale) for room in rooms)
    return below, above


def _problem(
    loop: Loop,
    want: PlainMPCSpecification,
    speed: float,
    disturbance: float,
    error: npt.ArrayLike,
    doubt: float = 1.0,
    time: float = FOUND_IN[0],
    far: float = 1.0,
) -> tuple[Problem, MPCSpecification]:
    """Return what an MPC is told, whose openings are fractions of full ones, in SI."""
    below, above = _rooms(loop)
    full = np.maximum(below, above)
    share, usual = loop.command_scale / full, MPCSpecification
    own, h = loop.linear, want.sample_time
    noise, p = want.loop_noise(loop), len(loop.measured)
    noise[p:] *= doubt
    step = h * max(1, round(0.1 / speed / h))
    lag = min(speed, 0.5 / h)
    entry = own.B * loop.command_scale
    if entry.shape[1] > p:
        # As many as outputs, of the commands that hold them.
        gain = gain_at_rest(loop) * loop.command_scale / loop.output_scale[:, None]
        entry = entry @ np.linalg.svd(gain)[2][:p].T
    # By default what has no end is not held back.
    ended = np.isfinite(loop.upper - loop.lower) | (want.rate_time > 0.0)
    rate = np.where(ended, share, 1.0) / (want.rate_time or 2.0 * step)
    slow = loop.slew / full
    scales = {q.name: q.scale for q in outputs_of(loop.shown)}
    limits = [(name, float(low), float(high)) for name, low, high in want.output_limits]
    limited = tuple(
        (loop.sensors.index(name), min(0.5 * (high - low), scales[name]))
        for name, low, high in limits
    )
    problem = Problem(
        curves=_straight(loop),
        actuators=loop.actuators,
        sensors=loop.sensors,
        weights=(
            np.asarray(error) ** -2.0,
            (far * usual.opening_scale * share) ** -2,
            # A move of all of the command weighs 1: less of it would be a lag in every loop.
            share**-2,
        ),
        ends=((-below / full).tolist(), (above / full).tolist()),
        move_limit=tuple((np.minimum(rate, slow) * step).tolist()),
        output_limits=tuple((low, high) for _, low, high in limits),
        disturbances=(entry, speed / time * random_walk(disturbance, speed)),
        reference_speed=(lag,) * p,
        first_limit=tuple((slow * h).tolist()) if np.isfinite(slow).any() else (),
        offsets=tuple((speed / time * math.sqrt(h) * noise[p:]).tolist()),
        limited=limited,
    )
    stiff = BEYOND * float(np.max((loop.output_scale / np.asarray(error)) ** 2.0))
    numbers = MPCSpecification(
        prediction_time=step,
        softness=min(stiff, STIFFEST),
        state_noise=own.B * loop.command_scale * random_walk(disturbance, speed),
        sensor_noise=tuple(noise.tolist()),
        sample_time=h,
    )
    return problem, numbers


PLAIN_MPC = linear_mpc_design(
    name="plain-mpc",
    summary="linear MPC without offset, for any linear model",
    function=design_plain_mpc,
    specification=PlainMPCSpecification,
)
