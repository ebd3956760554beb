"""State feedback or a sliding mode on a Kalman filter of the states: the law, and its model.

With deviations from rest, the estimate x and the references r of the outputs y = C x behind two
lags of speeds w_r, sample k:

    x     = xp + M (y - C xp)                        Kalman filter, gain M
    s     = S x - Sr r - Sq q                        the surface; 0 for a state feedback
    u     = u0 + Kr r - K x + Kq q - rho sat(s / layer), clipped to its ends
    xp+   = F x + G (u_clipped - u0),    q+ = q + h P (r - y)

P leads to what moves no command that is at its end, where fewer are left than outputs: nothing is
summed while the only one is. rho, a share of the command, leads to the surface s = 0. Beyond the
layer q moves no command, and is that for which s is at its edge: what leads to the surface need not
make up for how far a command at its end took the states from it. With xs r
and us r the state and command at which the outputs are r, Kr is us + K xs, or the share of it whose
zero takes the place of the slowest pole: the integral then holds the rest, and no overshoot is
needed to empty it. Sr is found the same way.

Units: SI.

Source: Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, chapters 3 to 5; Seshagiri and
Khalil, Robust output feedback regulation of minimum-phase nonlinear systems using conditional
integrators, Automatica 41, 2005.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Numbers, Rows, Told, product, rows, total
from controllers.linear_law import LinearLaw
from controllers.plain.limits import LoopLimits, LoopSpecification
from controllers.plain.loop import Loop, listed
from controllers.plain.plain_law import PlainLaw
from controllers.plain.references import LAGS, led
from controllers.reference.horizon import lagged
from controllers.riccati import balanced_regulator
from controllers.specification import number
from workbench.arrays import Matrix
from workbench.errors import TIMES_S, WorkbenchError
from workbench.linearisation.exact_delays import SAME, Channels, foretold, held
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
        size: Sizes of the outputs that are followed.
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
    size: tuple[float, ...]
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
        change = _freed(change, self.integral_gain, self.size, free, arithmetic)
        if self.reach:
            beyond = s - arithmetic.clip(s, -self.layer, self.layer)
            q = (q[0] + beyond / self.surface_integral,)
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


def _freed(
    change: Numbers,
    gain: Rows,
    unit: tuple[float, ...],
    free: Sequence[Any],
    arithmetic: Arithmetic,
) -> Numbers:
    """Return what of a change, counted in units of its own, moves no command that is not free.

    As long as no fewer are free than there are outputs, that is all of it: the others take over.
    Else each such command's row of the gain is made orthogonal to those before it, and taken away.
    """
    spare = len(gain) - len(change)
    bound = sum(arithmetic.where(may, 0.0, 1.0) for may in free)
    if len(change) == 1:
        # What is left of the only one is nothing, to the last digit, by whatever it enters.
        return (arithmetic.where(bound < spare + 0.5, change[0], 0.0 * change[0]),)
    change = tuple(c / one for c, one in zip(change, unit, strict=True))
    taken: list[tuple[Numbers, Any]] = []
    for entries, may in zip(gain, free, strict=True):
        if not any(entries):
            continue
        row = tuple(k * one for k, one in zip(entries, unit, strict=True))
        size = sum(k * k for k in row)
        own: Numbers = row
        for other, norm in taken:
            share = total(0.0, row, other) / norm
            own = tuple(a - share * b for a, b in zip(own, other, strict=True))
        norm = sum(a * a for a in own)
        # What the others already hold back leaves nothing but rounding.
        small = norm < 1e-12 * size
        norm = arithmetic.where(small, size, norm)
        away = tuple(arithmetic.where(small, 0.0 * a, a) for a in own)
        away = tuple(arithmetic.where(bound < spare + 0.5, 0.0 * a, a) for a in away)
        own = tuple(arithmetic.where(may, 0.0 * a, a) for a in away)
        share = sum(a * b for a, b in zip(own, change, strict=True))
        change = tuple(c - share / norm * a for a, c in zip(own, change, strict=True))
        taken.append((own, norm))
    return tuple(c * one for c, one in zip(change, unit, strict=True))


SHARES = (0.0, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
"""Shares of rest elsewhere that are tried for integrals to hold after a step of the reference."""

DISTURBANCES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
LATE_DISTURBANCES = (*DISTURBANCES, 1e-4, 1e-5, 1e-6, 1e-7)
"""Disturbances of the command that are tried for a Kalman filter, as fractions of it; also of what
is late, where a filter that is quicker than the delay takes the margins."""


def doubts(loop: Loop) -> tuple[float, ...]:
    """Return the doubts of what is measured and not followed that are tried, ratios.

    A filter that is told of less noise leans on those measurements more, which is what the margins
    at the command ask of it, as loop transfer recovery asks for more noise at the command. Source:
    Doyle and Stein, Multivariable feedback design, IEEE Trans. AC-26, 1981.
    """
    return (1.0,) if loop.read is None else (1.0, 0.1)


@dataclass(frozen=True)
class ObserverSpecification(LoopSpecification):
    """What every law on a Kalman filter of the states is told.

    Args:
        reference_speed: Speed of the reference's lags, in rad/s; by default (0) what leads a step
            best.
        disturbance: What the disturbance of the command is taken to walk by in ten time constants
            of the loop, rms, as a fraction of the command; what suits the loop by default (0).
    """

    reference_speed: float = number(0.0, 0.0, 1.0 / TIMES_S[0])
    disturbance: float = number(0.0, 0.0, 1e3, words="disturbance of the command")


def disturbances(limits: LoopLimits, given: float = 0.0) -> tuple[float, ...]:
    """Return disturbances that are tried, fractions; 0 if none is given."""
    return (given,) if given else LATE_DISTURBANCES if limits.is_late else DISTURBANCES


def random_walk(disturbance: float, speed: float) -> float:
    """Return the random walk of the integral of the command's disturbance, a fraction, per s."""
    return disturbance * math.sqrt(10.0 / speed)


class ObservedModel:
    """What every law on a Kalman filter of a loop's states shares.

    Commands that are on their way are states, the last one first, behind those that are filtered:
    they are known, and what disturbs a command enters where it acts.
    """

    def __init__(
        self, loop: Loop, want: ObserverSpecification, chain: Channels | None = None
    ) -> None:
        own, size, h = loop.linear, loop.linear.state_scales, want.sample_time
        self.loop, self.want = loop, want
        p, m = own.D.shape
        A, B, C, D = own.A, own.B, loop.shown.C, np.zeros_like(loop.shown.D)
        if chain:
            (A, B, C, D), size = chain.at_once(m), size[list(chain.kept)]
        self.filtered = *zero_order_hold(A, B, h), C
        self.ahead, self.left, n = 0, self.filtered, len(A)
        self.F, self.G, self.C = self.filtered
        if chain:
            self.ahead = math.floor(min(chain.delays) / h + SAME)
            self.left = held(chain.later(-self.ahead * h), m, h)[:3]
            self.F, self.G, self.C = held(chain, m, h)[:3]
        self.sizes = np.append(size, np.tile(loop.command_scale, (len(self.F) - n) // m))
        rest = np.block([[A, B], [C[:p], D[:p]]])
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
        self.command = target[n:] * loop.command_scale[:, None]
        on_the_way = np.tile(self.command, ((len(self.F) - n) // m, 1))
        self.target = np.vstack([target[:n] * size[:, None], on_the_way])

    def foretold(self, rows: Matrix) -> Matrix:
        """Return rows on states and integrals, shape (k, n + p), in SI, of those that are ahead.

        What enters is rows on the states that are left, and the integrals, when all commands on
        their way have acted.
        """
        return np.asarray(rows @ self._foretold)

    @cached_property
    def _foretold(self) -> Matrix:
        (F, G, C), p = self.left, len(self.loop.measured)
        F = np.block([[F, np.zeros((len(F), p))], [-self.want.sample_time * C[:p], np.eye(p)]])
        return foretold(F, np.pad(G, ((0, p), (0, 0))), self.ahead, len(self.filtered[0]))

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
        from scipy.linalg import block_diag

        loop, h, noise = self.loop, self.want.sample_time, self.want.loop_noise(self.loop)
        (F, G, C), m, p = self.filtered, len(self.command), len(loop.measured)
        noise[p:] *= doubt
        n, k = len(F), len(noise) - p
        # The disturbance is white noise, held over a sample.
        entry = G * (random_walk(disturbance, speed) * loop.command_scale)
        q = entry @ entry.T / h
        q = q + 1e-15 * np.diag(np.diag(q)) + 1e-300 * np.eye(n)
        q = np.pad(q, (0, k)) + np.diag(np.append(np.zeros(n), (0.1 * speed * h * noise[p:]) ** 2))
        offsets, still = np.eye(p + k, k, -p), np.eye(k)
        F, C = block_diag(F, still), np.hstack([C, offsets])
        size = np.append(self.sizes[:n], noise[p:])
        predictor = balanced_regulator(F.T, C.T / noise, q, 1.0 / size).T / noise
        # From the gain of the predictor to that of the correction; what dies in a sample has none.
        scaled, wanted = F * size / size[:, None], predictor / size[:, None]
        M = size[:, None] * np.linalg.lstsq(scaled, wanted, rcond=None)[0]
        known = np.zeros((len(self.F) - n, p + k))
        return replace(
            law,
            F=rows(block_diag(self.F, still)),
            G=rows(np.pad(self.G, ((0, k), (0, 0)))),
            C=rows(np.hstack([self.C, offsets])),
            M=rows(np.vstack([M[:n], known, M[n:]])),
            gain=rows(np.hstack([law.gain, np.zeros((m, k))])),
            target=rows(np.pad(law.target, ((0, k), (0, 0)))),
            surface=law.surface and (*law.surface, *[0.0] * k),
        )

    def law(self, gain: Matrix, integral: Matrix, slow: float, told: dict[str, Any]) -> ObserverLaw:
        """Return a law that has no observer yet, a zero in the place of a slow pole, in rad/s."""
        loop = self.loop
        law = ObserverLaw(
            F=rows(self.F),
            G=rows(self.G),
            C=rows(self.C),
            M=(),
            gain=rows(gain),
            integral_gain=rows(integral),
            size=tuple(loop.output_scale.tolist()),
            reference_gain=(),
            target=rows(self.target),
            start=(),
            sample_time=self.want.sample_time,
            **{"name": "state feedback"} | loop.ends | told,
        )
        # What the integrals hold at rest is what no zero takes the place of.
        whole = slow * np.diag(self._whole(law))
        shares = 1.0 - np.clip(1.0 / np.where(whole, whole, math.inf), 0.0, 1.0)
        return self.held(law, shares.tolist())

    def _whole(self, law: ObserverLaw) -> Matrix:
        """Return integrals that hold all of rest elsewhere, shape (p, p), in s; 0 without them."""
        xs, into, out = (
            np.array(law.target),
            self.loop.command_scale[:, None],
            self.loop.output_scale,
        )
        if law.surface:
            return np.full((1, 1), float(np.dot(law.surface, xs[:, 0])) / law.surface_integral)
        forward = self.command + np.array(law.gain) @ xs
        scaled = np.array(law.integral_gain) / into * out, forward / into * out
        return np.asarray(out[:, None] * np.linalg.lstsq(*scaled, rcond=None)[0] / out)

    def held(self, law: ObserverLaw, shares: Sequence[float]) -> ObserverLaw:
        """Return the law whose integrals hold shares of rest elsewhere, references the others."""
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

        return led(limits, entered, tried)
