"""Front ends around one point: the reference through lags, the joint as one linear model.

`LaggedReference` is all that a cascaded PID needs: two lags of speed omega_r and the filtered
pressure difference; accelerations are counted in the pressure difference that makes them.

`ReferenceModel` knows speed and unexplained acceleration from a `JointObserver`, and where the
joint shall be from a third-order model of the reference with its poles at omega_r:

    r''' = omega_r^3 (ref - r) - 3 omega_r^2 r' - 3 omega_r r''

Units: SI.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers
from controllers.joint.model import JointModel
from controllers.joint.observer import JointEstimate, JointObserver
from controllers.joint.tracking import Context, Start, Tracking
from controllers.reference.horizon import lagged
from controllers.reference.planned import Plan
from workbench.errors import check_range

UNIT = JointModel(b=1.0, a1=0.0, a0=0.0, g=1.0, e=0.0, d=0.0)
"""A joint of which nothing is known: accelerations are pressure differences, in Pa."""


class LaggedState(NamedTuple):
    """Reference after each of two lags, in rad, and filtered pressure difference, in Pa."""

    filtered: Number
    target: Number
    difference: Number


@dataclass(frozen=True)
class LaggedReference(Tracking):
    """Two lags of the reference and a filter of the pressure difference.

    Args:
        speed: Speed omega_r of the lags, in rad/s; 0 for none.
    """

    speed: float = 25.0
    pressure_filter: float = 0.002
    sample_time: float = 0.002

    def __post_init__(self) -> None:
        h = check_range("sample time", self.sample_time, 1e-6, 1.0, "s")
        check_range("pressure filter", self.pressure_filter, 0.0, 10.0, "s")
        check_range("reference speed", self.speed, 0.0, 1.0 / h, "rad/s")

    def start(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> Start:
        angle, p1, p2 = measurement
        return Start(LaggedState(angle, angle, p1 - p2), UNIT, p1 - p2)

    def context(
        self, state: LaggedState, measurement: Numbers, reference: Number, arithmetic: Arithmetic
    ) -> tuple[Context, LaggedState]:
        angle, p1, p2 = measurement
        h = self.sample_time
        filtered = target = reference
        if self.speed > 0.0:
            filtered, target = lagged(state.filtered, state.target, reference, h * self.speed)
        fresh = h / (self.pressure_filter + h)
        difference = state.difference + fresh * (p1 - p2 - state.difference)
        plan = Plan(target, 0.0, 0.0, 0.0)
        context = Context(plan, UNIT, angle, 0.0, 0.0, 0.0, difference, 0.0, 0.0)
        return context, LaggedState(filtered, target, difference)


class ReferenceModelState(NamedTuple):
    """What a `ReferenceModel` remembers."""

    estimate: JointEstimate
    difference: Number
    plan: Plan


@dataclass(frozen=True)
class ReferenceModel(Tracking):
    """Third-order model of the reference, and observer of the joint at one point.

    Args:
        speed: Poles omega_r of the reference model, in rad/s.
    """

    joint: JointModel
    observer: JointObserver
    speed: float = 25.0
    pressure_filter: float = 0.002
    sample_time: float = 0.002

    def __post_init__(self) -> None:
        h = check_range("sample time", self.sample_time, 1e-6, 1.0, "s")
        check_range("pressure filter", self.pressure_filter, 0.0, 10.0, "s")
        check_range("reference speed", self.speed, 0.1, 0.5 / h, "rad/s")

    def start(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> Start:
        angle, p1, p2 = measurement
        estimate = self.observer.start(self.joint, angle, p1 - p2)
        state = ReferenceModelState(estimate, p1 - p2, Plan(angle, 0.0, 0.0, 0.0))
        return Start(state, self.joint, -estimate.unexplained)

    def context(
        self,
        state: ReferenceModelState,
        measurement: Numbers,
        reference: Number,
        arithmetic: Arithmetic,
    ) -> tuple[Context, ReferenceModelState]:
        joint, h, w = self.joint, self.sample_time, self.speed
        angle, p1, p2 = measurement
        now = self.observer.correct(state.estimate, angle)
        fresh = h / (self.pressure_filter + h)
        difference = state.difference + fresh * (p1 - p2 - state.difference)
        acceleration = (
            joint.b * (difference - joint.difference)
            - joint.a1 * now.speed
            - joint.a0 * (now.angle - joint.angle)
            + now.unexplained
        )
        r = state.plan
        jerk = w**3 * (reference - r.angle) - 3.0 * w * w * r.speed - 3.0 * w * r.acceleration
        plan = Plan(r.angle, r.speed, r.acceleration, jerk)
        push = r.acceleration + joint.a1 * r.speed + joint.a0 * (r.angle - joint.angle)
        rate = (jerk + joint.a1 * r.acceleration + joint.a0 * r.speed) / joint.b
        context = Context(
            plan,
            self.joint,
            angle,
            now.speed,
            acceleration,
            now.unexplained,
            difference,
            joint.difference + push / joint.b,
            joint.opening + (rate + joint.e * r.speed) / joint.g,
        )
        following = ReferenceModelState(
            self.observer.predict(now, difference),
            difference,
            Plan(
                r.angle + h * r.speed, r.speed + h * r.acceleration, r.acceleration + h * jerk, 0.0
            ),
        )
        return context, following
