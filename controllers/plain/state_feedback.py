"""State feedback with integral action for any linear model, on a Kalman filter of its states.

K and Kq (`controllers.plain.observer_law`) minimise the sum of (y / y_scale)^2 +
(q / (T y_scale))^2 + (u / u_scale)^2 over all outputs and commands (LQI), or K is given.

Units: SI.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np

from controllers.design import Design
from controllers.plain.limits import FEEDBACK, LoopLimits, LoopSpecification
from controllers.plain.loop import loop_of, speeds
from controllers.plain.many_loops import stacked
from controllers.plain.measured_outputs import designed_for, much_better
from controllers.plain.observer_law import (
    DISTURBANCES,
    ObservedModel,
    ObserverLaw,
    ObserverSpecification,
    disturbances,
    doubts,
)
from controllers.plain.pace import at_pace
from controllers.plain.references import better
from controllers.plain.selection import Answer, Place, answered, best_of, steps
from controllers.riccati import balanced_regulator
from controllers.specification import number
from workbench.arrays import Matrix, Vector
from workbench.errors import TIMES_S, WorkbenchError, check_range
from workbench.linearisation import LinearModel


@dataclass(frozen=True)
class LQISpecification(ObserverSpecification):
    """What a state feedback for any linear model is designed for.

    Args:
        error_scale: Error that weighs as much as all of the command, in SI of the output, or one
            for each; by default (0) what makes the best loop within its limits.
        integral_time: Time T in which the integral of an error weighs as much as the error, in s;
            by default (0) two time constants of the loop.
    """

    error_scale: float | tuple[float, ...] = 0.0
    integral_time: float = number(0.0, 0.0, TIMES_S[1])

    def __post_init__(self) -> None:
        super().__post_init__()
        for scale in np.atleast_1d(self.error_scale):
            check_range("error scale", float(scale), 0.0, 1e30)


def design_lqi(linear: LinearModel, specification: LQISpecification | None = None) -> ObserverLaw:
    """Design a state feedback with integral action for any linear model.

    The loop is as fast as the frequency w at which the plant makes the error that weighs as much as
    all of the commands from all of the commands. A Kalman filter takes away the margins that an LQR
    has: of all w and filters it is the law that `controllers.plain.limits` takes. With several
    outputs, the speed of each is then changed by itself as long as that is better.

    Raises:
        WorkbenchError: If the outputs cannot be led to references by the commands, a Riccati
            equation has no solution, or a limit that was given is not held.
    """
    want = (specification or LQISpecification()).sampled(linear)

    def designed(limits: LoopLimits) -> ObserverLaw:
        walks, late = disturbances(limits, want.disturbance), limits.late
        # A law that knows which commands are on their way is large, and takes longer to judge.
        ways = [(replace(limits, foreseen=True), 40), *([(late, 20)] if late.chain else [])]
        found = []
        for own, count in ways:
            law, _ = _fastest(own, want, speeds(want.sample_time, count), walks)
            model = ObservedModel(limits.predicted, want, own.chain)
            found.append(at_pace(late, model.led(late, law)))
        held = late.held(late.judge(stacked(found)), FEEDBACK)
        return better(late, [found[k] for k in held])

    return designed_for(want, linear, designed, reading_helps)


def reachable_speed(limits: LoopLimits) -> float:
    """Return about how fast a loop within limits is, in rad/s: that of a state feedback."""
    return float(np.exp(np.mean(np.log(_coarsely(limits)[1]))))


def reading_helps(limits: LoopLimits, wider: LoopLimits) -> bool:
    """Tell whether a state feedback within limits is much better if it reads more outputs."""

    def reached(tried: LoopLimits) -> tuple[float, Answer]:
        law = _coarsely(tried)[0]
        return tried.excess(law), answered(tried, stacked([law]))

    return much_better(limits, wider, reached)


def _coarsely(limits: LoopLimits) -> tuple[ObserverLaw, tuple[float, ...]]:
    told = {f.name: getattr(limits.want, f.name) for f in fields(LoopSpecification)}
    coarse = speeds(limits.want.sample_time, 20)
    # Steps before a delay that is not the plant's own show nothing of what slow filters do.
    walks = DISTURBANCES if limits.want.delay else disturbances(limits)
    return _fastest(limits, LQISpecification(**told), coarse, walks[::2])


def _fastest(
    limits: LoopLimits, want: LQISpecification, tried: list[float], walks: Sequence[float]
) -> tuple[ObserverLaw, tuple[float, ...]]:
    """Return the best state feedback and the speed of each output, in rad/s."""
    loop = limits.predicted
    model = ObservedModel(loop, want, limits.chain)
    outputs, sizes = len(loop.measured), loop.sizes(tried)
    given = np.broadcast_to(np.array(want.error_scale, dtype=float), outputs)

    @cache
    def regulated(chosen: tuple[int, ...], calm: float) -> ObserverLaw:
        error = calm * np.array([sizes[k, i] for i, k in enumerate(chosen)])
        speed, n = [tried[k] for k in chosen], len(model.F)
        gains, slow = _lqi(model, want, np.array(speed), np.where(given > 0.0, given, error))
        top = 0.5 / want.sample_time
        lags = tuple(min(want.reference_speed or 2.0 * w, top) for w in speed)
        return model.law(gains[:, :n], -gains[:, n:], slow, {"reference_speed": lags})

    def designed(chosen: tuple[int, ...], at: tuple[float, float, float]) -> ObserverLaw:
        speed = float(np.exp(np.mean(np.log([tried[k] for k in chosen]))))
        disturbance, doubt, calm = at
        return model.observed(regulated(chosen, calm), disturbance, speed, doubt)

    # The speed at which all of the command makes such an error, of the first output.
    k = min(int(np.searchsorted(sizes[:, 0], given[0])), len(tried) - 1)
    all_alike = [k] if np.all(given > 0.0) else range(len(tried))

    def found(calm: Sequence[float]) -> tuple[ObserverLaw, Place]:
        filters = list(itertools.product(walks, doubts(loop), calm))
        start = [((k,) * outputs, at) for k in all_alike for at in filters]
        return best_of(limits, designed, start, FEEDBACK, len(tried), APART)

    law, (chosen, _) = found(CALM[:1])
    if not given.any() and (beyond := limits.excess(law)) > 1.0:
        # Below the pace of the plant an error is as large as ever, and late outputs ask for less.
        calmer, _ = found(CALM[1:])
        if limits.excess(calmer) < beyond:
            time, seen, _ = steps(limits, stacked([calmer]))
            risen = np.argmax(np.einsum("kii->ki", seen[0, :, :, :outputs]) > RISEN, axis=0)
            return calmer, tuple((1.0 / time[np.maximum(risen, 1)]).tolist())
    return law, tuple(tried[k] for k in chosen)


CALM = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Errors that weigh as much as all of the command, over those that it makes at the speed: where no
loop is within its limits with the first, the others are tried."""

APART = (4, 8, 12)
"""Steps between speeds that are tried by which one output is slower or faster than all others."""

RISEN = 0.63
"""Part of a step after which a loop's time constant is over."""


def _lqi(
    model: ObservedModel, want: LQISpecification, speed: Vector, error: Vector
) -> tuple[Matrix, float]:
    """Return gains on states and integrals, shape (m, n + p), in SI; the slowest pole, in rad/s."""
    (F, G, C), h, loop = model.left, want.sample_time, model.loop
    C = C[: len(speed)]
    time = np.full_like(speed, want.integral_time) if want.integral_time else 2.0 / speed
    (n, m), p = G.shape, len(C)
    joined = np.block([[F, np.zeros((n, p))], [-h * C, np.eye(p)]])
    entry = np.vstack([G * loop.command_scale, np.zeros((p, m))])
    weight = np.zeros((n + p, n + p))
    weight[:n, :n] = (C / error[:, None] ** 2).T @ C
    weight[n:, n:] = np.diag(1.0 / (time * error) ** 2)
    size = np.append(model.sizes[:n], time * loop.output_scale)
    gains = loop.command_scale[:, None] * balanced_regulator(joined, entry, weight, size)
    closed = np.linalg.eigvals(joined - (entry / loop.command_scale) @ gains)
    slow = -math.log(min(max(np.max(np.abs(closed)), 1e-12), 1.0 - 1e-9)) / h
    return model.foretold(gains), slow


def state_feedback_by_hand(
    linear: LinearModel,
    gain: Sequence[float] | Sequence[Sequence[float]],
    *,
    integral_gain: float | Sequence[Sequence[float]] = 0.0,
    specification: ObserverSpecification | None = None,
) -> ObserverLaw:
    """Return the state feedback u = u0 + (us + K xs) r - K x + Kq q with K given.

    The states are those of the linear model, in its order, estimated by a Kalman filter.

    Args:
        gain: K, shape (n_states,), or a row for each command, in SI of the command per SI of the
            states.
        integral_gain: Kq, a number or shape (n_commands, n_outputs), in SI of the command per SI of
            the output and s; 0 for none.

    Example:
        >>> import control
        >>> plant = control.ss([[0, 1], [0, -2]], [[0], [1]], [[1, 0]], 0)
        >>> state_feedback_by_hand(plant, (9.0, 4.0)).gain
        ((9.0, 4.0),)
    """
    want = (specification or ObserverSpecification()).sampled(linear)
    loop = loop_of(linear, want.measured, want.actuator, want.also_measured)
    K, Kq = (np.atleast_2d(np.asarray(given, dtype=float)) for given in (gain, integral_gain))
    states, shape = loop.linear.state_names, (len(loop.actuators), len(loop.measured))
    if K.shape != (shape[0], len(states)):
        raise WorkbenchError(
            f"the gain has {' x '.join(map(str, np.shape(gain)))} entries and the model the states"
            f" {', '.join(states)}; give one entry for each, a row for each of"
            f" {', '.join(loop.actuators)}"
        )
    Kq = np.zeros(shape) if not np.any(Kq) else Kq
    if Kq.shape != shape:
        raise WorkbenchError(
            f"the integral gain has shape {Kq.shape}; give {shape}: a row for each of"
            f" {', '.join(loop.actuators)}, an entry for each of {', '.join(loop.measured)}"
        )
    h = want.sample_time
    model = ObservedModel(loop, want)
    law = model.law(K, Kq, 0.0, {"reference_speed": (0.0,) * len(loop.measured)})
    return model.observed(law, want.disturbance or 0.3, 0.02 / h)


LQI = Design(
    name="lqi",
    family="state feedback",
    summary="state feedback with integral action and Kalman filter, for any linear model",
    function=design_lqi,
    specification=LQISpecification,
)
