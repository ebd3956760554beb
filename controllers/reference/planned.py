"""Planned reference: steps become smooth moves of limited jerk, everything else passes unchanged.

The reference r is the sum of a smooth trajectory and of jumps in value and in speed. A jump shows
as a speed or an acceleration that no joint has; it is taken out and goes into an offset delta,
which keeps r + delta smooth and returns to zero in the time T along the quintic

    delta(s) = p0 + p1 s + p2 s^2 + c3 s^3 + c4 s^4 + c5 s^5,         s = t / T
    c3 = -10 p0 - 6 p1 - 3 p2,  c4 = 15 p0 + 8 p1 + 3 p2,  c5 = -6 p0 - 3 p1 - p2

with the offset's value, speed and acceleration at the jump in p0, p1, p2, so that position, speed
and acceleration of the plan are continuous even if a jump comes during a move. For a step of size D
from rest this is the move of least mean square jerk; T is the shortest time within the limits

    60 D / T^3 <= jerk,    5.7735 D / T^2 <= acceleration,    1.875 D / T <= speed

A sine therefore passes without lag, with its speed and acceleration from differences, and a step
never asks for more than the joint can do. What comes next is known too: the move goes along its
quintic, the smooth trajectory along its first three derivatives.

A reference that is quantised, held between samples of its own, or noisy has no derivatives to take
differences of. With a ``bandwidth`` w the trajectory is what a filter of three equal poles at w
knows of it, sample k, e what the reference differs from its prediction:

    r = r- + k1 e,   r' = r'- + k2 e,   r'' = r''- + k3 e,   p = exp(-w h)
    k1 = 1 - p^3,  k2 = 1.5 (1 - p)^2 (1 + p) / h,  k3 = (1 - p)^3 / h^2

It follows a constant acceleration without lag, a sine of frequency v with an error of (v / w)^3.
What differs by more than ``jump`` is a jump, as above; a smaller step passes the filter, and goes
past its end by a quarter of itself.

A joint that nobody identified is not where it was planned to be. Half way along a move longer than
``renewal`` the rest is planned anew from where the joint is and how fast, with the acceleration of
the plan, for a duration that grows with the time that the joint has to go,

    T' = T / 2 clip(1 + (delta_y - delta) / delta + (v - v_y) / v, 1, 1.6),

v the plan's speed and delta_y, v_y what the joint has left to go and its speed. It happens once, or
again where what is left is long too: no feedback loop closes over it.

Units: SI.

Source: alpha-beta-gamma filter, critically damped: Brookner, Tracking and Kalman Filtering Made
Easy, 1998, section 2.5; Flash and Hogan, J. Neuroscience 5, 1985 (quintic as minimum-jerk move);
Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 2.1.
"""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from typing import Any, NamedTuple

from controllers.arithmetic import Arithmetic, Number
from controllers.specification import Checked, number
from workbench.errors import check_range


class Plan(NamedTuple):
    """Where the joint shall be now."""

    angle: Number
    speed: Number
    acceleration: Number
    jerk: Number


class PlannerState(NamedTuple):
    """What a `Planner` remembers.

    Args:
        reference: Reference of the sample before, in rad.
        slope: Its speed, in rad/s.
        curve: Its acceleration, in rad/s2.
        offset: Offset at the last jump, in rad.
        offset_speed: Its speed there, in rad/s.
        elapsed: Time since then, in s.
        duration: Time that the offset takes to vanish, in s.
    """

    reference: Number
    slope: Number
    curve: Number
    offset: Number
    offset_speed: Number
    offset_acceleration: Number
    elapsed: Number
    duration: Number


@dataclass(frozen=True)
class Planner(Checked):
    """Planner of one reference.

    Args:
        jerk: Largest jerk of a move, in rad/s3.
        acceleration: Largest acceleration of a move, in rad/s2.
        speed: Largest speed of a move, in rad/s.
        shortest: Shortest duration of a move, in s.
        jump_speed: Speed from which the reference has jumped, in rad/s.
        jump_acceleration: Acceleration from which the reference's speed has jumped, in rad/s2.
        reach: Time for which the derivatives of the trajectory tell how it goes on, in s; then it
            is taken to go straight on.
        bandwidth: Bandwidth w of the filter of a rough reference, in rad/s; 0 for a smooth one.
        jump: Smallest step of a rough reference that is planned as a move, in rad.
        renewal: Duration from which a move is planned anew half way, in s; infinite for never.
    """

    jerk: float = number(MISSING, 1e-6, 1e9, "rad/s3", "jerk of the planned reference")
    acceleration: float = number(
        MISSING, 1e-6, 1e9, "rad/s2", "acceleration of the planned reference"
    )
    speed: float = number(MISSING, 1e-6, 1e9, "rad/s", "speed of the planned reference")
    shortest: float = 0.02
    jump_speed: float = 8.0
    jump_acceleration: float = 150.0
    sample_time: float = 0.002
    reach: float = 0.1
    bandwidth: float = 0.0
    jump: float = number(0.02, 1e-12, 1e9, "rad", "jump of a rough reference")
    renewal: float = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("shortest planned move", self.shortest, self.sample_time, 1e3, "s")
        top = 0.5 / self.sample_time
        check_range("bandwidth of the reference filter", self.bandwidth, 0.0, top, "rad/s")

    def start(self, angle: Number) -> PlannerState:
        """Return the state of a reference at rest at an angle, in rad."""
        return PlannerState(angle, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, self.shortest)

    def plan(
        self, state: PlannerState, reference: Number, arithmetic: Arithmetic
    ) -> tuple[Plan, PlannerState]:
        """Plan one sample: where the joint shall be now, in SI, for a reference in rad."""
        h, where = self.sample_time, arithmetic.where
        elapsed = arithmetic.clip(state.elapsed + h, 0.0, state.duration)
        offset, speed, acceleration, _ = _offset(state, elapsed)

        if self.bandwidth:
            return self._filtered(
                state, reference, elapsed, (offset, speed, acceleration), arithmetic
            )
        slope = (reference - state.reference) / h
        change = slope - state.slope
        size = arithmetic.largest(change, -change)
        jumped = size > self.jump_speed
        bent = size > self.jump_acceleration * h
        # Before a bend the trajectory went on straight; after a jump its speed is what it was.
        ahead = reference - state.reference - h * state.slope
        offset = where(bent, offset - ahead, offset)
        speed = where(bent, where(jumped, speed, speed - change), speed)
        slope = where(jumped, state.slope, slope)
        curve = where(bent, 0.0, change / h)
        jerk = where(bent, 0.0, (curve - state.curve) / h)
        # A bend leaves no acceleration behind; the sample after it starts from there.
        jerk = arithmetic.clip(jerk, -self.jerk, self.jerk)
        smooth = Plan(reference, slope, curve, jerk)
        return self._moved(state, smooth, bent, elapsed, (offset, speed, acceleration), arithmetic)

    def _filtered(
        self,
        state: PlannerState,
        reference: Number,
        elapsed: Number,
        offset: tuple[Number, Number, Number],
        arithmetic: Arithmetic,
    ) -> tuple[Plan, PlannerState]:
        """Plan one sample of a rough reference, whose trajectory is that of the filter."""
        h, where = self.sample_time, arithmetic.where
        p = math.exp(-self.bandwidth * h)
        predicted = state.reference + h * (state.slope + 0.5 * h * state.curve)
        residual = reference - predicted
        jumped = arithmetic.largest(residual, -residual) > self.jump
        fresh = where(jumped, 0.0, residual)
        smooth = Plan(
            where(jumped, reference, predicted + (1.0 - p * p * p) * fresh),
            state.slope + h * state.curve + 1.5 * (1.0 - p) ** 2 * (1.0 + p) / h * fresh,
            state.curve + (1.0 - p) ** 3 / (h * h) * fresh,
            arithmetic.clip((1.0 - p) ** 3 / (h * h * h) * fresh, -self.jerk, self.jerk),
        )
        offset = (offset[0] - where(jumped, residual, 0.0), *offset[1:])
        return self._moved(state, smooth, jumped, elapsed, offset, arithmetic)

    def _moved(
        self,
        state: PlannerState,
        smooth: Plan,
        bent: Any,
        elapsed: Number,
        begin: tuple[Number, Number, Number],
        arithmetic: Arithmetic,
    ) -> tuple[Plan, PlannerState]:
        """Add the move along which the last jump vanishes; one begins where it has bent."""
        where, (offset, speed, acceleration) = arithmetic.where, begin
        fresh = PlannerState(
            smooth.angle,
            smooth.speed,
            smooth.acceleration,
            where(bent, offset, state.offset),
            where(bent, speed, state.offset_speed),
            where(bent, acceleration, state.offset_acceleration),
            where(bent, 0.0, elapsed),
            where(bent, self._duration(offset, speed, arithmetic), state.duration),
        )
        delta = _offset(fresh, fresh.elapsed)
        moving = fresh.elapsed < fresh.duration
        # In the middle of the coming sample the jerk of the move is what the sample will see.
        return (
            Plan(
                smooth.angle + where(moving, delta[0], 0.0),
                smooth.speed + where(moving, delta[1], 0.0),
                smooth.acceleration + where(moving, delta[2], 0.0),
                smooth.jerk + where(moving, delta[3], 0.0),
            ),
            fresh,
        )

    def renewed(
        self, state: PlannerState, plan: Plan, angle: Number, speed: Number, arithmetic: Arithmetic
    ) -> tuple[Plan, PlannerState]:
        """Plan the second half of a long move anew, from where the joint is.

        Angle in rad and speed in rad/s are those of the joint.
        """
        where = arithmetic.where
        passed = state.elapsed - 0.5 * state.duration
        half = where(passed >= 0.0, where(passed < self.sample_time, 1.0, 0.0), 0.0)
        begins = where(state.duration > self.renewal, half, 0.0) > 0.0
        offset, pace, acceleration, _ = _offset(state, state.elapsed)
        left, own = angle - state.reference, speed - state.slope
        far = (left - offset) * offset / arithmetic.largest(offset * offset, 1e-9)
        slow = (pace - own) * pace / arithmetic.largest(pace * pace, 1e-9)
        slower = arithmetic.clip(1.0 + far + slow, 1.0, SLOWER)
        begin = PlannerState(
            state.reference,
            state.slope,
            state.curve,
            where(begins, left, state.offset),
            where(begins, own, state.offset_speed),
            where(begins, acceleration, state.offset_acceleration),
            where(begins, 0.0, state.elapsed),
            where(begins, 0.5 * slower * state.duration, state.duration),
        )
        delta = _offset(begin, begin.elapsed)
        renewed = Plan(
            where(begins, state.reference + delta[0], plan.angle),
            where(begins, state.slope + delta[1], plan.speed),
            plan.acceleration,
            where(begins, delta[3], plan.jerk),
        )
        return renewed, begin

    def ahead(self, state: PlannerState, plan: Plan, time: Number, arithmetic: Arithmetic) -> Plan:
        """Return where the joint shall be a time later, in s, if no jump comes."""
        now = _offset(state, state.elapsed)
        jerk = plan.jerk - arithmetic.where(state.elapsed < state.duration, now[3], 0.0)
        elapsed = arithmetic.clip(state.elapsed + time, 0.0, state.duration)
        moving = elapsed < state.duration
        then = [arithmetic.where(moving, part, 0.0) for part in _offset(state, elapsed)]
        near = arithmetic.clip(time, 0.0, self.reach)
        slope = state.slope + near * (state.curve + near * jerk / 2.0)
        bent = near * (state.slope + near * (state.curve / 2.0 + near * jerk / 6.0))
        return Plan(
            state.reference + bent + (time - near) * slope + then[0],
            slope + then[1],
            state.curve + near * jerk + then[2],
            jerk + then[3],
        )

    def _duration(self, offset: Number, speed: Number, arithmetic: Arithmetic) -> Number:
        size = arithmetic.largest(offset, -offset)
        fast = arithmetic.largest(speed, -speed)
        return arithmetic.largest(
            self.shortest,
            arithmetic.cube_root(60.0 * size / self.jerk),
            arithmetic.root(5.7735 * size / self.acceleration),
            1.875 * size / self.speed,
            arithmetic.root(36.0 * fast / self.jerk),
            3.0 * fast / self.acceleration,
        )


SLOWER = 1.6
"""Most by which the second half of a move is made slower, a ratio."""


def _offset(state: PlannerState, elapsed: Number) -> tuple[Number, Number, Number, Number]:
    """Return offset, speed, acceleration and jerk of the quintic."""
    T = state.duration
    s = elapsed / T
    p0, p1, p2 = state.offset, state.offset_speed * T, 0.5 * state.offset_acceleration * T * T
    c3 = -10.0 * p0 - 6.0 * p1 - 3.0 * p2
    c4 = 15.0 * p0 + 8.0 * p1 + 3.0 * p2
    c5 = -6.0 * p0 - 3.0 * p1 - p2
    return (
        p0 + s * (p1 + s * (p2 + s * (c3 + s * (c4 + s * c5)))),
        (p1 + s * (2.0 * p2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / T,
        (2.0 * p2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (T * T),
        (6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)) / (T * T * T),
    )
