"""State feedback and sliding mode for any linear model, on a Kalman filter of its states.

With deviations from rest, the estimate x and the references r of the outputs y = C x behind two
lags of speeds w_r, sample k:

    x     = xp + M (y - C xp)                        Kalman filter, gain M
    s     = S x - Sr r - Sq q                        the surface; 0 for a state feedback
    u     = u0 + Kr r - K x + Kq q - rho sat(s / layer), clipped to its ends
    xp+   = F x + G (u_clipped - u0),    q+ = q + h P (r - y)

P leads to what moves no command that is at its end, where fewer are left than outputs: nothing is
summed while the only one is. State feedback: K and Kq minimise the sum of (y / y_scale)^2 +
(q / (T y_scale))^2 + (u / u_scale)^2 over all outputs and commands (LQI), or K is given. Sliding
mode, of one output by one command: s = 0 is the surface on which the model with its integral has
given poles (Ackermann and Utkin's formula), K, Kr and Kq keep the model on it, and rho, a share of
the command, leads there. With xs r and us r the state and command at which the output is r, Kr is
us + K xs, or the share of it whose zero takes the place of the slowest pole: the integral then
holds the rest, and no overshoot is needed to empty it. Sr is found the same way.

Source: Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, chapters 3 to 5; Ackermann and
Utkin, Sliding mode control design based on Ackermann's formula, IEEE Trans. AC-43, 1998.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Numbers, Told
from controllers.design import Design
from controllers.linear_law import LinearLaw
from controllers.plain.limits import (
    FEEDBACK,
    LAGS,
    Answer,
    LoopLimits,
    ReadingSpecification,
    much_better,
    stacked,
)
from controllers.plain.loop import (
    Loop,
    LoopSpecification,
    PlainLaw,
    listed,
    loop_of,
    speeds,
)
from controllers.plain.pairing import zeros
from controllers.reference.horizon import lagged
from controllers.sampling import Rows, product, rows, total
from controllers.sliding_mode import sliding_design
from controllers.specification import number
from workbench.arrays import Matrix, Vector
from workbench.errors import TIMES_S, WorkbenchError, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.zero_order_hold import zero_order_hold


class ObservedState(NamedTuple):
    """What a `ObserverLaw` remembers.

    Args:
        predicted: Predicted states xp, deviations in SI.
        error_integral: Integrals q of the errors, in SI of the outputs times s.
        filtered: References after the first lag, deviations in SI.
        target: References after the second lag, deviations in SI.
        paced: References before the lags at their pace, deviations in SI, and by how much they
            moved in the last sample; None without a pace.
        commands: Commands, in SI; None without a slew.
    """

    predicted: Numbers
    error_integral: Numbers
    filtered: Numbers
    target: Numbers
    paced: Numbers | None = None
    commands: Numbers | None = None


@dataclass(frozen=True, kw_only=True, repr=False)
class ObserverLaw(PlainLaw):
    """State feedback with integral action, with or without a sliding mode.

    All is in SI, with n states, the offsets of what is measured and not followed the last of them,
    m commands, p outputs that are followed, and s that are measured, those first.

    Args:
        F: Transition of the states over a sample, shape (n, n).
        G: Effect of the commands, shape (n, m).
        C: Measured outputs, shape (s, n).
        M: Gain of the Kalman filter, shape (n, s).
        gain: K, shape (m, n).
        integral_gain: Kq, shape (m, p).
        reference_gain: Kr, shape (m, p).
        target: xs, shape (n, p).
        start: Integrals at rest per deviation of the outputs, shape (p, p), in s.
        surface: S, shape (n,), in SI of the command per SI of the states.
        surface_integral: Sq, in SI of the command per SI of the output and s.
        surface_reference: Sr, in SI of the command per SI of the output.
        reach: rho, in SI of the command per s; 0 for a state feedback.
        layer: Half width of the boundary layer, in the unit of the surface.
        reference_speed: Speeds w_r of the references' lags, in rad/s; 0 for none.
    """

    F: Rows
    G: Rows
    C: Rows
    M: Rows
    gain: Rows
    integral_gain: Rows
    reference_gain: Rows
    target: Rows
    start: Rows
    surface: tuple[float, ...] = ()
    surface_integral: float = 0.0
    surface_reference: float = 0.0
    reach: float = 0.0
    layer: float = 1.0
    reference_speed: tuple[float, ...]

    def initial_state(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> ObservedState:
        """Return the state of a plant that the commands at rest hold where it is measured."""
        y = self.deviations(measurement)[: len(self.controlled)]
        x, q = product(self.target, y), product(self.start, y)
        return ObservedState(x, q, y, y, self.resting(y), self.kept(None, self.rest))

    def law(
        self, state: ObservedState, measurement: Numbers, reference: Numbers, arithmetic: Arithmetic
    ) -> tuple[Numbers, ObservedState, Told]:
        y = self.deviations(measurement)
        now, paced = self.followed(state.paced, reference, arithmetic)
        lags = [
            lagged(first, second, asked, speed * self.sample_time) if speed else (asked, asked)
            for first, second, asked, speed in zip(
                state.filtered, state.target, now, self.reference_speed, strict=True
            )
        ]
        filtered, r = (tuple(part) for part in zip(*lags, strict=True))
        residual = tuple(v - total(0.0, c, state.predicted) for v, c in zip(y, self.C, strict=True))
        x = product(self.M, residual, state.predicted)
        q = state.error_integral
        asked = product(self.reference_gain, r, self.rest)
        asked = product(self.integral_gain, q, asked)
        asked = tuple(u - total(0.0, k, x) for u, k in zip(asked, self.gain, strict=True))
        told: Told = {}
        if self.reach:
            s = total(0.0, self.surface, x)
            s = s - self.surface_reference * r[0] - self.surface_integral * q[0]
            asked = (asked[0] - self.reach * arithmetic.clip(s / self.layer, -1.0, 1.0),)
            told["surface"] = s
        command = self.applied(state.commands, asked, arithmetic)
        change = tuple(self.sample_time * (a - b) for a, b in zip(r, y, strict=False))
        free = [u == v for u, v in zip(command, asked, strict=True)]
        change = _freed(change, self.integral_gain, free, arithmetic)
        if self.reach:
            # Outside its layer a surface is reached as fast as may be, and farther off no faster.
            away = s * self.surface_integral * change[0] < 0.0
            held = arithmetic.where(away, 0.0 * change[0], change[0])
            outside = arithmetic.largest(s, -s) > self.layer
            change = (arithmetic.where(outside, held, change[0]),)
        summed = tuple(a + b for a, b in zip(q, change, strict=True))
        move = tuple(u - rest for u, rest in zip(command, self.rest, strict=True))
        predicted = product(self.G, move, product(self.F, x))
        kept = self.kept(state.commands, command)
        following = ObservedState(predicted, summed, filtered, r, paced, kept)
        sent = self.sent(state.commands, command, arithmetic)
        return sent, following, {**self.told(asked), **told}

    def around_rest(self) -> LinearLaw:
        own = (self.F, self.G, self.C, self.M, self.gain, self.integral_gain, self.reference_gain)
        F, G, C, M, K, Kq, Kr = (np.array(part) for part in own)
        n, p, h = len(F), len(self.controlled), self.sample_time
        # Rows of what is linear in the state, measurements and references.
        places = np.cumsum([n, p, p, p, len(C), p])
        parts = np.split(np.eye(places[-1]), places[:-1])
        predicted, q, filtered, target, y, asked = parts
        speed = np.array(self.reference_speed)[:, None]
        fresh = np.where(speed > 0.0, speed * h, 1.0)
        filtered, r = lagged(filtered, target, asked, fresh)
        x = predicted + M @ (y - C @ predicted)
        u = Kr @ r + Kq @ q - K @ x
        if self.reach:
            s = self.surface @ x - self.surface_reference * r[0] - self.surface_integral * q[0]
            u = u - self.reach / self.layer * s
        table = np.vstack([F @ x + G @ u, q + h * (r - y[:p]), filtered, r])
        k = places[3]
        return LinearLaw(table[:, :k], table[:, k:], u[:, :k], u[:, k:])


def _freed(change: Numbers, gain: Rows, free: Sequence[Any], arithmetic: Arithmetic) -> Numbers:
    """Return what of a change, in any units, moves no command that is not free.

    As long as no fewer are free than there are outputs, that is all of it: the others take over.
    Else each such command's row of the gain is made orthogonal to those before it, and taken away.
    """
    spare = len(gain) - len(change)
    bound = sum(arithmetic.where(may, 0.0, 1.0) for may in free)
    if len(change) == 1:
        # What is left of the only one is nothing, to the last digit, by whatever it enters.
        return (arithmetic.where(bound < spare + 0.5, change[0], 0.0 * change[0]),)
    taken: list[tuple[Numbers, Any]] = []
    for row, may in zip(gain, free, strict=True):
        if not any(row):
            continue
        size = sum(k * k for k in row)
        own: Numbers = row
        for other, norm in taken:
            share = total(0.0, row, other) / norm
            own = tuple(a - share * b for a, b in zip(own, other, strict=True))
        norm = total(0.0, (1.0,) * len(own), tuple(a * a for a in own))
        # What the others already hold back leaves nothing but rounding.
        small = norm < 1e-12 * size
        norm = arithmetic.where(small, size, norm)
        away = tuple(arithmetic.where(small, 0.0 * a, a) for a in own)
        away = tuple(arithmetic.where(bound < spare + 0.5, 0.0 * a, a) for a in away)
        own = tuple(arithmetic.where(may, 0.0 * a, a) for a in away)
        share = total(
            0.0, (1.0,) * len(own), tuple(a * b for a, b in zip(own, change, strict=True))
        )
        change = tuple(c - share / norm * a for a, c in zip(own, change, strict=True))
        taken.append((own, norm))
    return change


SHARES = (0.0, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
"""Shares of rest elsewhere that are tried for integrals to hold after a step of the reference."""

DISTURBANCES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""Disturbances of the command that are tried for a Kalman filter, as fractions of it."""


def doubts(loop: Loop) -> tuple[float, ...]:
    """Return the doubts of what is measured and not followed that are tried, ratios.

    A filter that is told of less noise leans on those measurements more, which is what the margins
    at the command ask of it, as loop transfer recovery asks for more noise at the command. Source:
    Doyle and Stein, Multivariable feedback design, IEEE Trans. AC-26, 1981.
    """
    return (1.0,) if loop.read is None else (1.0, 0.1)


@dataclass(frozen=True)
class ObserverSpecification(ReadingSpecification):
    """What every law on a Kalman filter of the states is told.

    Args:
        reference_speed: Speed of the reference's lags, in rad/s; by default (0) what leads a step
            best.
        disturbance: What the disturbance of the command is taken to walk by in ten time constants
            of the loop, rms, as a fraction of the command; what suits the loop by default (0).
    """

    reference_speed: float = number(0.0, 0.0, 1.0 / TIMES_S[0])
    disturbance: float = number(0.0, 0.0, 1e3, words="disturbance of the command")

    @property
    def disturbances(self) -> tuple[float, ...]:
        """Disturbances that are tried, fractions."""
        return (self.disturbance,) if self.disturbance else DISTURBANCES


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
    want = specification or LQISpecification()

    def designed(limits: LoopLimits) -> ObserverLaw:
        law, _ = _fastest(limits, want, speeds(want.sample_time), want.disturbances)
        return limits.late.at_pace(_ObservedModel(limits.loop, want).led(limits.late, law))

    return want.designed(linear, designed, reading_helps)


def reachable_speed(limits: LoopLimits) -> float:
    """Return about how fast a loop within limits is, in rad/s: that of a state feedback."""
    return float(np.exp(np.mean(np.log(_coarsely(limits)[1]))))


def reading_helps(limits: LoopLimits, wider: LoopLimits) -> bool:
    """Tell whether a state feedback within limits is much better if it reads more outputs."""

    def answered(tried: LoopLimits) -> tuple[float, Answer]:
        law = stacked([_coarsely(tried)[0].around_rest()])
        return float(tried.judge(law).excess[0]), tried.answered(law)

    return much_better(limits, wider, answered)


def _coarsely(limits: LoopLimits) -> tuple[ObserverLaw, tuple[float, ...]]:
    told = {f.name: getattr(limits.want, f.name) for f in fields(LoopSpecification)}
    coarse = speeds(limits.want.sample_time, 20)
    return _fastest(limits, LQISpecification(**told), coarse, DISTURBANCES[::2])


def _fastest(
    limits: LoopLimits, want: LQISpecification, tried: list[float], disturbances: Sequence[float]
) -> tuple[ObserverLaw, tuple[float, ...]]:
    """Return the best state feedback and the speed of each output, in rad/s."""
    loop, model = limits.loop, _ObservedModel(limits.loop, want)
    outputs, sizes = len(loop.measured), loop.sizes(tried)
    given = np.broadcast_to(np.array(want.error_scale, dtype=float), outputs)

    @cache
    def regulated(chosen: tuple[int, ...], calm: float) -> ObserverLaw:
        error = calm * np.array([sizes[k, i] for i, k in enumerate(chosen)])
        speed, n = [tried[k] for k in chosen], len(model.F)
        gains, slow = _lqi(model, want, np.array(speed), np.where(given > 0.0, given, error))
        top = 0.5 / want.sample_time
        lags = tuple(min(want.reference_speed or 2.0 * w, top) for w in speed)
        return model.law(gains[:, :n], -gains[:, n:], slow, reference_speed=lags)

    def designed(chosen: tuple[int, ...], at: tuple[float, float, float]) -> ObserverLaw:
        speed = float(np.exp(np.mean(np.log([tried[k] for k in chosen]))))
        disturbance, doubt, calm = at
        return model.observed(regulated(chosen, calm), disturbance, speed, doubt)

    all_alike = range(len(tried))
    if np.all(given > 0.0):
        # The speed at which all of the command makes such an error, of the first output.
        k = min(int(np.searchsorted(sizes[:, 0], given[0])), len(tried) - 1)
        all_alike = range(k, k + 1)

    def best(calm: Sequence[float]) -> tuple[ObserverLaw, tuple[int, ...]]:
        filters = list(itertools.product(disturbances, doubts(loop), calm))
        start = [((k,) * outputs, at) for k in all_alike for at in filters]
        law, (chosen, _) = limits.best_of(designed, start, FEEDBACK, len(tried), APART)
        return law, chosen

    def excess(law: ObserverLaw) -> float:
        return float(limits.judge(stacked([law.around_rest()])).excess[0])

    law, chosen = best(CALM[:1])
    if not given.any() and (beyond := excess(law)) > 1.0:
        # Below the pace of the plant an error is as large as ever, and late outputs ask for less.
        calmer, _ = best(CALM[1:])
        if excess(calmer) < beyond:
            time, seen, _ = limits.steps(stacked([calmer.around_rest()]))
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
    model: _ObservedModel, want: LQISpecification, speed: Vector, error: Vector
) -> tuple[Matrix, float]:
    """Return gains on states and integrals, shape (m, n + p), in SI; the slowest pole, in rad/s."""
    h, loop, F, G = want.sample_time, model.loop, model.F, model.G
    C = loop.linear.C
    time = np.full_like(speed, want.integral_time) if want.integral_time else 2.0 / speed
    (n, m), p = G.shape, len(C)
    joined = np.block([[F, np.zeros((n, p))], [-h * C, np.eye(p)]])
    entry = np.vstack([G * loop.command_scale, np.zeros((p, m))])
    weight = np.zeros((n + p, n + p))
    weight[:n, :n] = (C / error[:, None] ** 2).T @ C
    weight[n:, n:] = np.diag(1.0 / (time * error) ** 2)
    size = np.append(loop.linear.state_scales, time * loop.output_scale)
    gains = loop.command_scale[:, None] * _regulator(joined, entry, weight, size)
    closed = np.linalg.eigvals(joined - (entry / loop.command_scale) @ gains)
    slow = -math.log(min(max(np.max(np.abs(closed)), 1e-12), 1.0 - 1e-9)) / h
    return gains, slow


def random_walk(disturbance: float, speed: float) -> float:
    """Return the random walk of the integral of the command's disturbance, a fraction, per s."""
    return disturbance * math.sqrt(10.0 / speed)


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
    want = specification or ObserverSpecification()
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
    model = _ObservedModel(loop, want)
    return model.observed(model.law(K, Kq), want.disturbance or 0.3, 0.02 / h)


@dataclass(frozen=True)
class PlainSlidingModeSpecification(ObserverSpecification):
    """What a sliding mode for any linear model is designed for.

    Args:
        slope: Speed of the poles on the surface, in rad/s; poles of the model that are faster stay.
            By default (0) the best loop within its limits.
        reach: What may lead to the surface, as a fraction of the command.
        layer_bandwidth: Pole inside the boundary layer, in rad/s; twice the slope by default (0).
    """

    slope: float = 0.0
    reach: float = number(0.5, 1e-6, 10.0, words="reach to the surface")
    layer_bandwidth: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("slope of the surface", self.slope, 0.0, 0.2 / self.sample_time, "rad/s")
        top = 0.5 / self.sample_time
        check_range("bandwidth of the layer", self.layer_bandwidth, 0.0, top, "rad/s")


def design_plain_sliding_mode(
    linear: LinearModel, specification: PlainSlidingModeSpecification | None = None
) -> ObserverLaw:
    """Design a sliding mode with boundary layer and integral for any linear model.

    Raises:
        WorkbenchError: If the command does not reach all states, or several outputs are followed.
    """
    want = specification or PlainSlidingModeSpecification()
    h = want.sample_time
    slopes = [want.slope] if want.slope else [w for w in speeds(h) if w <= 0.2 / h]

    def within(limits: LoopLimits) -> ObserverLaw:
        loop = limits.loop
        if len(loop.actuators) > 1 or len(loop.measured) > 1:
            raise WorkbenchError(
                f"a sliding mode of the workbench has one surface, and {loop.words} needs"
                f" {len(loop.actuators)}; follow one output by one command, or take another family,"
                " such as lqi"
            )
        model = _ObservedModel(loop, want)
        sliding = cache(partial(_sliding, model, want))

        def designed(slope: float, disturbance: float, doubt: float) -> ObserverLaw:
            return model.observed(sliding(slope), disturbance, slope, doubt)

        tried = itertools.product(slopes, want.disturbances, doubts(loop))
        designs = [partial(designed, *numbers) for numbers in tried]
        law = limits.best(designs, "a sliding mode")
        return limits.late.at_pace(model.led(limits.late, law))

    def helps(limits: LoopLimits, wider: LoopLimits) -> bool:
        # What is refused need not be looked at.
        return limits.outputs == 1 and reading_helps(limits, wider)

    return want.designed(linear, within, helps)


def _sliding(
    model: _ObservedModel, want: PlainSlidingModeSpecification, slope: float
) -> ObserverLaw:
    """Return a law that has no observer yet, whose surface has a slope in rad/s."""
    loop = model.loop
    A, B, C = loop.linear.A, loop.linear.B, loop.linear.C
    n = len(A)
    # With q' = -C x in the place of the error's integral, whose reference is at rest.
    joined = np.block([[A, np.zeros((n, 1))], [-C, np.zeros((1, 1))]])
    entry = np.vstack([B, [[0.0]]])
    poles = [-abs(p) if abs(p) > slope else -slope for p in np.linalg.eigvals(A)]
    # Behind a zero that is slower, no other pole keeps a step from overshooting by far.
    slow = sorted(z.real for z in zeros(loop) if -slope < z.real < 0.0 and not z.imag)
    for z in slow[: poles.count(-slope) - 1]:
        poles[poles.index(-slope)] = z
    size = np.append(loop.linear.state_scales, loop.output_scale / slope)
    surface = _surface(joined, entry, sorted(poles)[:n], size, loop.actuators[0])
    kept = surface @ joined
    bandwidth = want.layer_bandwidth or 2.0 * slope
    reach = want.reach * float(loop.command_scale[0])
    return model.law(
        kept[None, :n],
        -kept[None, n:],
        slow=slope,
        name="sliding mode",
        surface=tuple(surface[:n].tolist()),
        surface_integral=-float(surface[n]),
        reach=reach,
        reference_speed=(want.reference_speed or slope,),
        layer=reach / bandwidth,
    )


def _surface(A: Matrix, B: Matrix, poles: list[float], size: Vector, actuator: str) -> Matrix:
    """Return S with S B = 1 such that the model has these poles on S x = 0.

    Where B is along the first axis and A an upper Hessenberg matrix, that is the last axis times
    (A - p) for each pole p: its powers need not be formed.

    Source: Ackermann and Utkin, 1998; Petkov, Christov and Konstantinov, Computational Methods for
    Linear Control Systems, 1991 (Hessenberg form).
    """
    from scipy.linalg import hessenberg

    n = len(A)
    a, b = A * size / size[:, None], B[:, 0] / size
    first = np.linalg.qr(np.column_stack([b, np.eye(n)]))[0]
    a, turned = hessenberg(first.T @ a @ first, calc_q=True)
    steps = np.abs(np.diag(a, -1))
    if not np.any(b) or np.any(steps <= 1e-14 * np.abs(a).max()):
        raise WorkbenchError(
            f"{actuator} does not reach all states of the linear model with the integral of the"
            " error; leave the others out of the model, or take a PID"
        )
    row = np.eye(n)[-1]
    for pole in poles:
        row = row @ (a - pole * np.eye(n))
        row = row / np.abs(row).max()
    row = row @ (first @ turned).T / size
    return np.asarray(row / float((row @ B)[0]))


def _regulator(F: Matrix, G: Matrix, weight: Matrix, size: Vector) -> Matrix:
    """Return the gains, shape (m, n), of commands whose squares weigh 1, states of these sizes.

    Source: Laub, A Schur method for solving algebraic Riccati equations, IEEE Trans. AC-24, 1979;
    Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22, 2001.
    """
    from scipy.linalg.lapack import dgebal, dgges

    f, g = F * size / size[:, None], G / size[:, None]
    q = weight * size * size[:, None]
    q = q + 1e-12 * np.trace(q) * np.eye(len(f))
    n, (left, right) = len(f), np.zeros((2, 2 * len(f), 2 * len(f)))
    left[:n, :n], left[n:, :n], left[n:, n:] = f, -q, np.eye(n)
    right[:n, :n], right[:n, n:], right[n:, n:] = np.eye(n), g @ g.T, f.T
    both = np.abs(left) + np.abs(right)
    np.fill_diagonal(both, 0.0)
    exponent = np.log2(dgebal(both, scale=1, permute=0)[3])
    even = np.exp2(np.round(0.5 * (exponent[n:] - exponent[:n])))
    scale = np.concatenate([even, 1.0 / even])
    left, right = left * scale[:, None] / scale, right * scale[:, None] / scale
    _, _, found, *_, ends, _, _ = dgges(_decays, left, right, jobvsl=0, sort_t=1)
    ends = ends[:, :n] * np.concatenate([1.0 / even, even])[:, None]
    if found != n or not abs(np.linalg.det(ends[:n])) > 0.0:
        raise WorkbenchError(
            "no regulator exists for this linear model; a mode that grows or integrates is out of"
            " the commands' reach, or hardly shows in the outputs: follow another output, or take a"
            " PID"
        )
    p = np.linalg.solve(ends[:n].T, ends[n:].T)
    p = 0.5 * (p + p.T)
    return np.asarray(np.linalg.solve(np.eye(g.shape[1]) + g.T @ p @ g, g.T @ p @ f) / size)


def _decays(real: float, imaginary: float, over: float) -> bool:
    return real * real + imaginary * imaginary < over * over


class _ObservedModel:
    """What every law on a Kalman filter of a loop's states shares.

    Raises:
        WorkbenchError: If the outputs cannot be held at references by the commands.
    """

    def __init__(self, loop: Loop, want: ObserverSpecification) -> None:
        own, size = loop.linear, loop.linear.state_scales
        self.loop, self.want, self.scales = loop, want, size
        self.F, self.G = zero_order_hold(own.A, own.B, want.sample_time)
        n, (p, m) = len(self.F), own.D.shape
        rest = np.block([[own.A, own.B], [own.C, np.zeros((p, m))]])
        right = np.vstack([np.zeros((n, p)), np.diag(loop.output_scale)])
        rest = rest * np.append(size, loop.command_scale)
        scale = np.maximum(np.max(np.abs(rest), axis=1), 1e-300)[:, None]
        rest, right = rest / scale, right / scale
        target = np.linalg.lstsq(rest, right, rcond=None)[0]
        if np.max(np.abs(rest @ target - right)) > 1e-6 * np.max(right):
            raise WorkbenchError(
                f"{listed(loop.measured)} cannot be held at a reference by"
                f" {listed(loop.actuators)}; follow another output"
            )
        target = target / loop.output_scale
        self.target = target[:n] * size[:, None]
        self.command = target[n:] * loop.command_scale[:, None]

    def observed(
        self, law: ObserverLaw, disturbance: float, speed: float, doubt: float = 1.0
    ) -> ObserverLaw:
        """Put a state feedback on a Kalman filter.

        Measurements that nobody follows have an offset each, a state that is found in ten time
        constants: far from rest, or with friction, a plant shows them otherwise than its model.

        Args:
            disturbance: What that of each command walks by in ten time constants of the loop, rms,
                as a fraction of the command.
            speed: Speed of the loop, in rad/s.
            doubt: Noise of what is measured and not followed that the filter is told, over that
                which it has.
        """
        h, noise, size = self.want.sample_time, self.want.loop_noise(self.loop), self.scales
        n, m, p = len(self.F), len(self.command), len(self.loop.measured)
        noise[p:] *= doubt
        k = len(noise) - p
        # The disturbance is white noise, held over a sample.
        entry = self.G * (random_walk(disturbance, speed) * self.loop.command_scale)
        q = entry @ entry.T / h
        q = q + 1e-15 * np.diag(np.diag(q)) + 1e-300 * np.eye(n)
        q = np.pad(q, (0, k)) + np.diag(np.append(np.zeros(n), (0.1 * speed * h * noise[p:]) ** 2))
        F, G = np.pad(self.F, (0, k)), np.pad(self.G, ((0, k), (0, 0)))
        F[n:, n:] = np.eye(k)
        C = np.hstack([self.loop.seen, np.eye(p + k, k, -p)])
        size = np.append(size, noise[p:])
        predictor = _regulator(F.T, C.T / noise, q, 1.0 / size).T / noise
        return replace(
            law,
            F=rows(F),
            G=rows(G),
            C=rows(C),
            # From the gain of the predictor to that of the correction.
            M=rows(np.linalg.solve(F, predictor)),
            gain=rows(np.hstack([law.gain, np.zeros((m, k))])),
            target=rows(np.pad(law.target, ((0, k), (0, 0)))),
            surface=law.surface and (*law.surface, *[0.0] * k),
        )

    def law(
        self,
        gain: Matrix,
        integral_gain: Matrix,
        slow: float = 0.0,
        name: str = "state feedback",
        surface: tuple[float, ...] = (),
        surface_integral: float = 0.0,
        **more: Any,
    ) -> ObserverLaw:
        """Return a state feedback that has no observer yet.

        Args:
            slow: Pole that a zero takes the place of, in rad/s; none by default (0).
        """
        loop, xs = self.loop, self.target
        law = ObserverLaw(
            F=rows(self.F),
            G=rows(self.G),
            C=rows(loop.seen),
            M=(),
            gain=rows(gain),
            integral_gain=rows(integral_gain),
            reference_gain=(),
            target=rows(xs),
            start=(),
            surface=surface,
            surface_integral=surface_integral,
            sample_time=self.want.sample_time,
            name=name,
            **{"reference_speed": (0.0,) * len(loop.measured)} | loop.ends | more,
        )
        # What the integrals hold at rest is what no zero takes the place of.
        whole = slow * np.diag(self._whole(law))
        shares = 1.0 - np.clip(1.0 / np.where(whole, whole, math.inf), 0.0, 1.0)
        return self.held(law, shares.tolist())

    def _whole(self, law: ObserverLaw) -> Matrix:
        """Return integrals that hold all of rest elsewhere, shape (p, p), in s; 0 without them."""
        loop, xs = self.loop, np.array(law.target)
        if law.surface:
            return np.full((1, 1), float(np.dot(law.surface, xs[:, 0])) / law.surface_integral)
        into, out = loop.command_scale[:, None], loop.output_scale
        forward = self.command + np.array(law.gain) @ xs
        scaled = np.array(law.integral_gain) / into * out, forward / into * out
        return np.asarray(out[:, None] * np.linalg.lstsq(*scaled, rcond=None)[0] / out)

    def held(self, law: ObserverLaw, shares: Sequence[float]) -> ObserverLaw:
        """Return the law whose integrals hold shares of rest elsewhere, the references the others.

        Args:
            shares: One for each followed output, dimensionless.
        """
        start, xs, along = self._whole(law) * np.array(shares), np.array(law.target), 0.0
        if law.surface:
            along = float(np.dot(law.surface, xs[:, 0])) * (1.0 - shares[0])
        forward = self.command + np.array(law.gain) @ xs - np.array(law.integral_gain) @ start
        return replace(
            law, reference_gain=rows(forward), start=rows(start), surface_reference=along
        )

    def led(self, limits: LoopLimits, law: ObserverLaw) -> ObserverLaw:
        """Return the law whose references enter, behind lags and past integrals, as suits best."""
        whole, lags = np.diag(self._whole(law)), (1.0,) if self.want.reference_speed else LAGS
        own = np.diag(law.start) / np.where(whole, whole, 1.0)
        top, speeds = 0.5 / law.sample_time, law.reference_speed
        each = [tuple(own.tolist()), *((share,) * len(own) for share in SHARES if whole.any())]
        tried = [
            tuple((min(k * w, top), share) for w, share in zip(speeds, shares, strict=True))
            for k in lags
            for shares in each
        ]

        def entered(chosen: Sequence[tuple[float, float]]) -> ObserverLaw:
            speed, shares = zip(*chosen, strict=True)
            return replace(self.held(law, shares), reference_speed=speed)

        return limits.led(entered, tried)


LQI = Design(
    name="lqi",
    family="state feedback",
    summary="state feedback with integral action and Kalman filter, for any linear model",
    function=design_lqi,
    specification=LQISpecification,
)

PLAIN_SLIDING_MODE = sliding_design(
    name="plain-sliding-mode",
    summary="sliding mode with boundary layer and integral, for any linear model",
    function=design_plain_sliding_mode,
    specification=PlainSlidingModeSpecification,
)
