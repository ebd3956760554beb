"""Inertia and hysteresis learned while a joint moves, from its angle and its pressures.

At rest a joint does not show its inertia, and a wrong load costs more speed than anything else:
what is fed forward to brake a move is wrong by as much. While it moves, the pressure difference
beyond that of rest is

    dp - dp0(theta) = m (d2theta/dt2 + a1 dtheta/dt) / b + eta lost(z) + c

with the inertia m and the hysteresis eta relative to those of the design, and c what neither
explains, a random walk. Tendons that give way act as inertia does: they weaken b. All terms pass
the filter (w / (s + w))^2, so that no derivative of what is measured is taken; z follows the
filtered speed. The three unknowns are those of a Kalman filter

    x = (m, eta, c),   y = phi' x + v,   K = P phi / (r^2 + phi' P phi),   P <- P - K phi' P + Q

whose gains vanish at rest, where phi = (0, 0, 1): half way along its first move a joint knows its
load, and keeps it. m and eta are learned along planned moves alone, and forgotten by the way that
is gone, not by time.

Source: recursive least squares as a Kalman filter: Åström and Wittenmark, Adaptive Control, 1995,
section 2.2; regression of filtered signals: Slotine and Li, Applied Nonlinear Control, 1991, 9.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from controllers.arithmetic import Arithmetic, Number, Numbers
from controllers.joint.hysteresis_compensation import HysteresisCompensation
from controllers.joint.model import JointModel


class Learned(NamedTuple):
    """What is known of a joint from its motion.

    Args:
        inertia: Inertia m relative to that of the design.
        hysteresis: Hysteresis eta relative to that of the design.
        rest: Pressure difference c that neither explains, in Pa.
        covariance: Upper triangle of the matrix P, row by row.
        angles: Angle after each of two filters, in rad.
        differences: Pressure difference beyond that of rest after each of two filters, in Pa.
        turn: Position in the loop of the hysteresis, -1..1.
    """

    inertia: Number
    hysteresis: Number
    rest: Number
    covariance: Numbers
    angles: Numbers
    differences: Numbers
    turn: Number


@dataclass(frozen=True)
class MotionLearning:
    """Kalman filter of inertia and hysteresis.

    Args:
        bandwidth: Bandwidth w of both filters, in rad/s.
        inertia: How far the relative inertia is off before it moved, rms.
        hysteresis: How far the relative hysteresis is off before it moved, rms.
        walk: Random walk of what neither explains, rms over 1 s, in Pa.
        noise: Error r of the equation above, rms, in Pa.
        forgetting: Random walk of both over 1 rad of planned way, rms.
        spread: Way over which the hysteresis of a muscle is really gained after a turn, relative to
            that of the law, a ratio: what comes later than the law says is no inertia.
        sample_time: Time h between samples, in s.
    """

    bandwidth: float = 32.0
    inertia: float = 0.25
    hysteresis: float = 0.25
    walk: float = 2e4
    noise: float = 4.5e4
    forgetting: float = 0.05
    spread: float = 5.0
    sample_time: float = 0.002

    def start(self, angle: Number, beyond: Number) -> Learned:
        """Return what is known at rest at an angle, in rad.

        Inertia and hysteresis are those of the design; ``beyond`` is the pressure difference beyond
        that of rest, in Pa.
        """
        known = (self.inertia**2, 0.0, 0.0, self.hysteresis**2, 0.0, self.walk**2)
        return Learned(1.0, 1.0, beyond, known, (angle, angle), (beyond, beyond), 0.0)

    def step(
        self,
        state: Learned,
        angle: Number,
        beyond: Number,
        planned: tuple[Number, Number],
        joint: JointModel,
        hysteresis: HysteresisCompensation | None,
        arithmetic: Arithmetic,
    ) -> Learned:
        """Learn from one sample.

        Angle in rad, pressure difference beyond that of rest in Pa, planned speed in rad/s with
        the mean pressure in Pa.
        """
        h, w = self.sample_time, self.bandwidth
        fresh = 1.0 - math.exp(-w * h)
        speed, mean = planned
        first, second = _filtered(state.angles, angle, fresh)
        y1, y = _filtered(state.differences, beyond, fresh)
        velocity = w * (first - second)
        acceleration = w * w * (angle - 2.0 * first + second)
        turn, lost = 0.0 * angle, 0.0 * angle
        if hysteresis is not None:
            turn = hysteresis.turned(state.turn, velocity / self.spread, h, arithmetic)
            lost = hysteresis.difference(turn, mean)
        push = (acceleration + joint.a1 * velocity) / joint.b
        way = h * arithmetic.largest(speed, -speed)
        moves = arithmetic.where(way > 0.0, 1.0, 0.0)

        a, b, c, d, e, f = state.covariance
        a, d, f = a + self.forgetting**2 * way, d + self.forgetting**2 * way, f + h * self.walk**2
        # P phi, with phi = (push, lost, 1).
        pa, pd, pf = a * push + b * lost + c, b * push + d * lost + e, c * push + e * lost + f
        size = self.noise**2 + push * pa + lost * pd + pf
        wrong = (y - state.inertia * push - state.hysteresis * lost - state.rest) / size
        # At rest c alone is corrected (a Schmidt-Kalman filter).
        after = (
            a - moves * pa * pa / size,
            b - moves * pa * pd / size,
            c - pa * pf / size,
            d - moves * pd * pd / size,
            e - pd * pf / size,
            f - pf * pf / size,
        )
        return Learned(
            arithmetic.clip(state.inertia + moves * pa * wrong, *INERTIA),
            arithmetic.clip(state.hysteresis + moves * pd * wrong, *HYSTERESIS),
            state.rest + pf * wrong,
            after,
            (first, second),
            (y1, y),
            turn,
        )


INERTIA = (0.35, 2.0)
"""Least and largest relative inertia that is believed."""

HYSTERESIS = (0.0, 2.5)
"""Least and largest relative hysteresis that is believed."""


def _filtered(state: Numbers, value: Number, fresh: float) -> Numbers:
    first = state[0] + fresh * (value - state[0])
    return first, state[1] + fresh * (first - state[1])
