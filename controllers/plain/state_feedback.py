"""State feedback and sliding mode for any linear model, on a Kalman filter of its states.

With deviations from rest, the estimate x and the reference r of the output y = C x behind two lags
of speed w_r, sample k:

    x     = xp + M (y - C xp)                        Kalman filter, gain M
    s     = S x - Sr r - Sq q                        the surface; 0 for a state feedback
    u     = u0 + Kr r - K x + Kq q - rho sat(s / layer), clipped to its ends
    xp+   = F x + G (u_clipped - u0),    q+ = q + h (r - y) unless u is at an end

State feedback: K and Kq minimise the sum of (y / y_scale)^2 + (q / (T y_scale))^2 + (u / u_scale)^2
(LQI), or K is given. Sliding mode: s = 0 is the surface on which the model with its integral has
given poles (Ackermann and Utkin's formula), K, Kr and Kq keep the model on it, and rho, a share of
the command, leads there. With xs r and us r the state and command at which the output is r, Kr is
us + K xs, or the share of it whose zero takes the place of the slowest pole: the integral then
holds the rest, and no overshoot is needed to empty it. Sr is found the same way.

Source: Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, chapters 3 to 5; Ackermann and
Utkin, Sliding mode control design based on Ackermann's formula, IEEE Trans. AC-43, 1998.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Told
from controllers.design import Design
from controllers.plain.limits import LoopLimits
from controllers.plain.single_loop import LoopSpecification, PlainLaw, SingleLoop, speeds
from controllers.reference.horizon import lagged
from controllers.sampling import Rows, rows, total
from controllers.sliding_mode import sliding_design
from workbench.arrays import Matrix, Vector
from workbench.errors import TIMES_S, WorkbenchError, check_range
from workbench.linearisation.zero_order_hold import zero_order_hold

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


class ObservedState(NamedTuple):
    """What a `ObserverLaw` remembers.

    Args:
        predicted: Predicted states xp, deviations in SI.
        error_integral: Integral q of the error, in SI of the output times s.
        filtered: Reference after the first lag, a deviation in SI.
        target: Reference after the second lag, a deviation in SI.
        paced: Reference before the lags at its pace, a deviation in SI; None without a pace.
    """

    predicted: Numbers
    error_integral: Number
    filtered: Number
    target: Number
    paced: Number | None = None


@dataclass(frozen=True, kw_only=True, repr=False)
class ObserverLaw(PlainLaw):
    """State feedback with integral action, with or without a sliding mode.

    Args:
        F: Transition of the states over a sample, shape (n, n), in SI.
        G: Effect of the command, shape (n,), in SI.
        C: Output, shape (n,), in SI.
        M: Gain of the Kalman filter, shape (n,), in SI.
        gain: K, shape (n,), in SI of the command per SI of the states.
        integral_gain: Kq, in SI of the command per SI of the output and s.
        reference_gain: Kr, in SI of the command per SI of the output.
        target: xs, shape (n,), in SI of the states per SI of the output.
        start: Integral at rest, in s.
        surface: S, shape (n,), in SI of the command per SI of the states.
        surface_integral: Sq, in SI of the command per SI of the output and s.
        surface_reference: Sr, in SI of the command per SI of the output.
        reach: rho, in SI of the command per s; 0 for a state feedback.
        layer: Half width of the boundary layer, in the unit of the surface.
        reference_speed: Speed w_r of the reference's lags, in rad/s; 0 for none.
    """

    F: Rows
    G: tuple[float, ...]
    C: tuple[float, ...]
    M: tuple[float, ...]
    gain: tuple[float, ...]
    integral_gain: float
    reference_gain: float
    target: tuple[float, ...]
    start: float = 0.0
    surface: tuple[float, ...] = ()
    surface_integral: float = 0.0
    surface_reference: float = 0.0
    reach: float = 0.0
    layer: float = 1.0
    reference_speed: float = 0.0

    def initial_state(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> ObservedState:
        """Return the state of a plant that the command at rest holds where it is measured."""
        y = measurement[0] - self.rest_output
        paced = None if self.pace == math.inf else y
        return ObservedState(tuple(gain * y for gain in self.target), self.start * y, y, y, paced)

    def law(
        self, state: ObservedState, measurement: Numbers, reference: Numbers, arithmetic: Arithmetic
    ) -> tuple[Numbers, ObservedState, Told]:
        y = measurement[0] - self.rest_output
        r = self.followed(state.paced, reference[0] - self.rest_output, arithmetic)
        paced = None if self.pace == math.inf else r
        filtered = r
        if self.reference_speed:
            fresh = self.reference_speed * self.sample_time
            filtered, r = lagged(state.filtered, state.target, r, fresh)
        residual = y - total(0.0, self.C, state.predicted)
        x = tuple(p + m * residual for p, m in zip(state.predicted, self.M, strict=True))
        q = state.error_integral
        asked = self.rest + self.reference_gain * r + self.integral_gain * q
        asked = asked - total(0.0, self.gain, x)
        told: Told = {}
        if self.reach:
            s = total(0.0, self.surface, x)
            s = s - self.surface_reference * r - self.surface_integral * q
            asked = asked - self.reach * arithmetic.clip(s / self.layer, -1.0, 1.0)
            told["surface"] = s
        command = arithmetic.clip(asked, self.lower, self.upper)
        summed = q + self.sample_time * (r - y)
        free = arithmetic.where(command == asked, summed, q)
        move = command - self.rest
        predicted = tuple(total(g * move, row, x) for row, g in zip(self.F, self.G, strict=True))
        following = ObservedState(predicted, free, filtered, r, paced)
        return (command,), following, {"asked": asked, **told}


DISTURBANCES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003)
"""Disturbances of the command that are tried for a Kalman filter, as fractions of it."""


@dataclass(frozen=True)
class ObserverSpecification(LoopSpecification):
    """What every law on a Kalman filter of the states is told.

    Args:
        reference_speed: Speed of the reference's lags, in rad/s; by default (0) what leads a step
            best.
        disturbance: What the disturbance of the command is taken to walk by in ten time constants
            of the loop, rms, as a fraction of the command; what suits the loop by default (0).
    """

    reference_speed: float = 0.0
    disturbance: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("reference speed", self.reference_speed, 0.0, 1.0 / TIMES_S[0])
        check_range("disturbance of the command", self.disturbance, 0.0, 1e3)

    @property
    def disturbances(self) -> tuple[float, ...]:
        """Disturbances that are tried, fractions."""
        return (self.disturbance,) if self.disturbance else DISTURBANCES


@dataclass(frozen=True)
class LQISpecification(ObserverSpecification):
    """What a state feedback for any linear model is designed for.

    Args:
        error_scale: Error that weighs as much as all of the command, in SI of the output; by
            default (0) what makes the best loop within its limits.
        integral_time: Time T in which the integral of an error weighs as much as the error, in s;
            by default (0) two time constants of the loop.
    """

    error_scale: float = 0.0
    integral_time: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("error scale", self.error_scale, 0.0, 1e30)
        check_range("integral time", self.integral_time, 0.0, TIMES_S[1])


def design_lqi(linear: LinearModel, specification: LQISpecification | None = None) -> ObserverLaw:
    """Design a state feedback with integral action for any linear model.

    The loop is as fast as the frequency w at which the plant makes the error that weighs as much as
    all of the command from all of the command. A Kalman filter takes away the margins that an LQR
    has: of all w and filters it is the law that `controllers.plain.limits` takes.

    Raises:
        WorkbenchError: If the output cannot be led to a reference by the command, a Riccati
            equation has no solution, or a limit that was given is not held.
    """
    want = specification or LQISpecification()
    loop = want.loop(linear)
    limits = LoopLimits(loop, want)
    law, _ = _fastest(limits, want, speeds(want.sample_time), want.disturbances)
    if want.reference_speed:
        return limits.at_pace(law)
    led = limits.led(lambda w: replace(law, reference_speed=w), law.reference_speed, FEEDBACK)
    return limits.at_pace(led)


def reachable_speed(limits: LoopLimits, want: LoopSpecification) -> float:
    """Return about how fast a loop within limits is, in rad/s: that of a state feedback."""
    told = {f.name: getattr(want, f.name) for f in fields(LoopSpecification)}
    coarse = speeds(want.sample_time, 20)
    return _fastest(limits, LQISpecification(**told), coarse, DISTURBANCES[::2])[1]


def _fastest(
    limits: LoopLimits, want: LQISpecification, tried: list[float], disturbances: Sequence[float]
) -> tuple[ObserverLaw, float]:
    """Return the best state feedback and its speed, in rad/s."""
    loop, model = limits.loop, _ObservedModel(limits.loop, want)
    sizes = loop.sizes(tried)
    if want.error_scale:
        k = int(np.searchsorted(sizes, want.error_scale))
        tried = tried[min(k, len(tried) - 1) :][:1]
        sizes = [want.error_scale]
    speed_of: dict[ObserverLaw, float] = {}

    @cache
    def regulated(speed: float, error: float) -> tuple[Vector, float]:
        return _lqi(model, want, speed, error)

    def designed(speed: float, error: float, disturbance: float) -> ObserverLaw:
        gains, slow = regulated(speed, error)
        law = model.law(
            gains[:-1],
            -float(gains[-1]),
            slow,
            walk=_walk(disturbance, speed),
            reference_speed=min(want.reference_speed or 2.0 * speed, 0.5 / want.sample_time),
        )
        speed_of[law] = speed
        return law

    designs = [
        partial(designed, w, error, disturbance)
        for w, error in zip(tried, sizes, strict=True)
        for disturbance in disturbances
    ]
    law = limits.best(designs, FEEDBACK)
    return law, speed_of[law]


FEEDBACK = "a state feedback"


def _lqi(
    model: _ObservedModel, want: LQISpecification, speed: float, error: float
) -> tuple[Vector, float]:
    """Return gains on states and integral, in SI, and the slowest pole, in rad/s."""
    h, loop, F, G = want.sample_time, model.loop, model.F, model.G
    C = loop.linear.C
    time = want.integral_time or 2.0 / speed
    n = len(F)
    joined = np.block([[F, np.zeros((n, 1))], [-h * C, np.ones((1, 1))]])
    entry = np.vstack([G, [[0.0]]])
    weight = np.zeros((n + 1, n + 1))
    weight[:n, :n], weight[n, n] = C.T @ C / error**2, 1.0 / (time * error) ** 2
    size = np.append(loop.linear.state_scales, time * loop.output_scale)
    gains = _regulator(joined, entry, weight * loop.command_scale**2, size)
    closed = np.linalg.eigvals(joined - entry * gains)
    slow = -math.log(min(max(np.max(np.abs(closed)), 1e-12), 1.0 - 1e-9)) / h
    return gains, slow


def _walk(disturbance: float, speed: float) -> float:
    """Return the random walk of the integral of the command's disturbance, a fraction, per s."""
    return disturbance * math.sqrt(10.0 / speed)


def state_feedback_by_hand(
    linear: LinearModel,
    gain: Sequence[float],
    *,
    integral_gain: float = 0.0,
    specification: ObserverSpecification | None = None,
) -> ObserverLaw:
    """Return the state feedback u = u0 + (us + K xs) r - K x + Kq q with K given.

    The states are those of the linear model, in its order, estimated by a Kalman filter.

    Args:
        gain: K, shape (n_states,), in SI of the command per SI of the states.
        integral_gain: Kq, in SI of the command per SI of the output and s; 0 for none.

    Example:
        >>> import control
        >>> plant = control.ss([[0, 1], [0, -2]], [[0], [1]], [[1, 0]], 0)
        >>> state_feedback_by_hand(plant, (9.0, 4.0)).gain
        (9.0, 4.0)
    """
    want = specification or ObserverSpecification()
    loop = want.loop(linear)
    if len(gain) != len(loop.linear.state_names):
        raise WorkbenchError(
            f"the gain has {len(gain)} entries and the model the states"
            f" {', '.join(loop.linear.state_names)}; give one entry for each"
        )
    h = want.sample_time
    walk = _walk(want.disturbance or 0.3, 0.02 / h)
    model = _ObservedModel(loop, want)
    return model.law(np.asarray(gain, dtype=float), integral_gain, walk=walk)


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
    reach: float = 0.5
    layer_bandwidth: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("slope of the surface", self.slope, 0.0, 0.2 / self.sample_time, "rad/s")
        check_range("reach to the surface", self.reach, 1e-6, 10.0)
        top = 0.5 / self.sample_time
        check_range("bandwidth of the layer", self.layer_bandwidth, 0.0, top, "rad/s")


def design_plain_sliding_mode(
    linear: LinearModel, specification: PlainSlidingModeSpecification | None = None
) -> ObserverLaw:
    """Design a sliding mode with boundary layer and integral for any linear model.

    Raises:
        WorkbenchError: If the command does not reach all states.
    """
    want = specification or PlainSlidingModeSpecification()
    loop, h = want.loop(linear), want.sample_time
    slopes = [want.slope] if want.slope else [w for w in speeds(h) if w <= 0.2 / h]
    model = _ObservedModel(loop, want)
    designs = [
        partial(_sliding, model, want, slope, disturbance)
        for slope in slopes
        for disturbance in want.disturbances
    ]
    limits, family = LoopLimits(loop, want), "a sliding mode"
    law = limits.best(designs, family)
    if want.reference_speed:
        return limits.at_pace(law)
    led = limits.led(lambda w: replace(law, reference_speed=w), law.reference_speed, family)
    return limits.at_pace(led)


def _sliding(
    model: _ObservedModel, want: PlainSlidingModeSpecification, slope: float, disturbance: float
) -> ObserverLaw:
    loop = model.loop
    A, B, C = loop.linear.A, loop.linear.B, loop.linear.C
    n = len(A)
    # With q' = -C x in the place of the error's integral, whose reference is at rest.
    joined = np.block([[A, np.zeros((n, 1))], [-C, np.zeros((1, 1))]])
    entry = np.vstack([B, [[0.0]]])
    poles = [-abs(p) if abs(p) > slope else -slope for p in np.linalg.eigvals(A)]
    size = np.append(loop.linear.state_scales, loop.output_scale / slope)
    surface = _surface(joined, entry, sorted(poles)[:n], size, loop.actuator)
    kept = surface @ joined
    bandwidth = want.layer_bandwidth or 2.0 * slope
    reach = want.reach * loop.command_scale
    return model.law(
        kept[:n],
        -float(kept[n]),
        slow=slope,
        walk=_walk(disturbance, slope),
        name="sliding mode",
        surface=tuple(surface[:n].tolist()),
        surface_integral=-float(surface[n]),
        reach=reach,
        reference_speed=want.reference_speed or slope,
        layer=reach / bandwidth,
    )


def _surface(A: Matrix, B: Matrix, poles: list[float], size: Vector, actuator: str) -> Matrix:
    """Return S with S B = 1 such that the model has these poles on S x = 0."""
    n = len(A)
    a, b = A * size / size[:, None], B / size[:, None]
    reached = np.hstack([np.linalg.matrix_power(a, k) @ b for k in range(n)])
    size_of = np.linalg.norm(reached, axis=0)
    if np.any(size_of == 0.0) or np.linalg.cond(reached / size_of) > 1e13:
        raise WorkbenchError(
            f"{actuator} does not reach all states of the linear model with the integral of the"
            " error; leave the others out of the model, or take a PID"
        )
    # Last row of the inverse, on columns of equal size.
    row = np.linalg.solve((reached / size_of).T, np.eye(n)[-1]) / size_of[-1]
    for pole in poles:
        row = row @ (a - pole * np.eye(n))
    row = row / size
    return np.asarray(row / float((row @ B)[0]))


def _regulator(F: Matrix, G: Matrix, weight: Matrix, size: Vector) -> Vector:
    """Return the gains, shape (n,), of one command whose square weighs 1, states of these sizes.

    Source: Laub, A Schur method for solving algebraic Riccati equations, IEEE Trans. AC-24, 1979;
    Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22, 2001.
    """
    from scipy.linalg import matrix_balance
    from scipy.linalg.lapack import dgges

    f, g = F * size / size[:, None], G / size[:, None]
    q = weight * size * size[:, None]
    q = q + 1e-12 * np.trace(q) * np.eye(len(f))
    n, one, nothing = len(f), np.eye(len(f)), np.zeros_like(f)
    left, right = np.block([[f, nothing], [-q, one]]), np.block([[one, g @ g.T], [nothing, f.T]])
    both = np.abs(left) + np.abs(right)
    np.fill_diagonal(both, 0.0)
    exponent = np.log2(matrix_balance(both, permute=False, separate=True)[1][0])
    even = np.exp2(np.round(0.5 * (exponent[n:] - exponent[:n])))
    scale = np.concatenate([even, 1.0 / even])
    left, right = left * scale[:, None] / scale, right * scale[:, None] / scale
    _, _, found, *_, ends, _, _ = dgges(_decays, left, right, jobvsl=0, sort_t=1)
    ends = ends[:, :n] * np.concatenate([1.0 / even, even])[:, None]
    if found != n or not abs(np.linalg.det(ends[:n])) > 0.0:
        raise WorkbenchError(
            "no regulator exists for this linear model; a mode that grows or integrates is out of"
            " the command's reach, or hardly shows in the output: follow another output, or take a"
            " PID"
        )
    p = np.linalg.solve(ends[:n].T, ends[n:].T)
    p = 0.5 * (p + p.T)
    return np.asarray((g.T @ p @ f / (1.0 + g.T @ p @ g))[0] / size)


def _decays(real: float, imaginary: float, over: float) -> bool:
    return real * real + imaginary * imaginary < over * over


class _ObservedModel:
    """What every law on a Kalman filter of a loop's states shares.

    Raises:
        WorkbenchError: If the output cannot be held at a reference by the command.
    """

    def __init__(self, loop: SingleLoop, want: ObserverSpecification) -> None:
        own, size = loop.linear, loop.linear.state_scales
        self.loop, self.want = loop, want
        self.F, self.G = zero_order_hold(own.A, own.B, want.sample_time)
        n = len(self.F)
        rest = np.block([[own.A, own.B], [own.C, np.zeros((1, 1))]])
        right = np.append(np.zeros(n), 1.0)
        rest = rest * np.append(size, loop.command_scale)
        scale = np.maximum(np.max(np.abs(rest), axis=1), 1e-300)
        rest, right = rest / scale[:, None], right / scale
        target = np.linalg.lstsq(rest, right, rcond=None)[0]
        if np.max(np.abs(rest @ target - right)) > 1e-6 * np.max(right):
            raise WorkbenchError(
                f"{loop.measured} cannot be held at a reference by {loop.actuator}; follow another"
                " output"
            )
        self.target, self.command = target[:n] * size, float(target[n] * loop.command_scale)

    def filtered(self, walk: float) -> Vector:
        """Return the gain of a Kalman filter, shape (n,), in SI.

        Args:
            walk: Random walk of the integral of the command's disturbance over one second, as a
                fraction of the command, times s.
        """
        # The disturbance is white noise, held over a sample.
        q = (walk * self.loop.command_scale) ** 2 / self.want.sample_time * (self.G @ self.G.T)
        q = q + 1e-15 * np.diag(np.diag(q)) + 1e-300 * np.eye(len(q))
        noise, size = self.want.loop_noise(self.loop), self.loop.linear.state_scales
        predictor = _regulator(self.F.T, self.loop.linear.C.T / noise, q, 1.0 / size) / noise
        # From the gain of the predictor to that of the correction.
        return np.asarray(np.linalg.solve(self.F, predictor))

    def law(
        self,
        gain: Vector,
        integral_gain: float,
        slow: float = 0.0,
        walk: float = 0.0,
        name: str = "state feedback",
        surface: tuple[float, ...] = (),
        surface_integral: float = 0.0,
        **more: Any,
    ) -> ObserverLaw:
        """Put a state feedback on a Kalman filter.

        Args:
            slow: Pole that a zero takes the place of, in rad/s; none by default (0).
            walk: See `filtered`.
        """
        loop, xs = self.loop, self.target
        forward = self.command + float(gain @ xs)
        share = start = along = 0.0
        if surface:
            along = float(np.array(surface) @ xs)
            share = min(max(surface_integral / (slow * along), 0.0), 1.0)
            start = (1.0 - share) * along / surface_integral
            along *= share
        elif integral_gain:
            share = min(max(integral_gain / (slow * forward), 0.0), 1.0) if slow else 1.0
            start = (1.0 - share) * forward / integral_gain
            forward *= share
        return ObserverLaw(
            F=rows(self.F),
            G=tuple(self.G[:, 0].tolist()),
            C=tuple(loop.linear.C[0].tolist()),
            M=tuple(self.filtered(walk).tolist()),
            gain=tuple(gain.tolist()),
            integral_gain=float(integral_gain),
            reference_gain=forward,
            target=tuple(xs.tolist()),
            start=start,
            surface=surface,
            surface_integral=surface_integral,
            surface_reference=along,
            rest_output=loop.rest_output,
            sensors=(loop.measured,),
            controlled=(loop.measured,),
            actuators=(loop.actuator,),
            rest=loop.rest_command,
            lower=loop.lower,
            upper=loop.upper,
            sample_time=self.want.sample_time,
            name=name,
            **more,
        )


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
