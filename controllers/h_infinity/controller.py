"""H-infinity control over the whole range: one synthesis at 30°, what varies with the angle on top.

Along the plan, with the feedforward dp_r and o_r of `controllers.joint.tracking`, the error
x = theta_r - theta and the sampled controller (A, B, C, D) of `controllers.h_infinity.synthesis`,
sample k:

    a[k]  = C z[k] + D x[k]
    dp_w  = dp_r + (a - (a0(theta) - a0(30°)) x) / b(theta)
    o     = o_r + (v / g(theta)) (dp_w - dp), clipped to -1..1, then the inverse curve
    z[k+1] = A z[k] + B x[k] + L (a_applied - a)          a_applied = a + b g (o_clipped - o) / v

Gain and stiffness of the joint are scheduled around the controller, which so sees nearly the joint
of its synthesis at every angle; the synthesis is robust against the rest. While the valve is fully
open, the state follows what is applied instead of winding up: L moves the slowest pole of A, which
nearly integrates, to the speed w of the weights in A - L C, and leaves the others.

Source: Skogestad and Postlethwaite, Multivariable Feedback Control, 2005, section 9.3; anti-windup
in observer form: Åström and Wittenmark, Computer-Controlled Systems, 1997, section 9.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from controllers.anti_windup import anti_windup
from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Rows, Told, rows, total
from controllers.h_infinity.synthesis import Weights, joint_behind_pressure_loop, synthesise
from controllers.joint.schedule import JointSchedule
from controllers.joint.tracking import (
    Context,
    JointTracking,
    TrackedLaw,
    TrackingSpecification,
    TrackingState,
)
from controllers.specification import number
from controllers.valve_inverse import joint_design
from workbench.errors import check_range


class HInfinityState(NamedTuple):
    """States of the front end and of the sampled controller."""

    tracking: TrackingState
    controller: Numbers


@dataclass(frozen=True, repr=False)
class HInfinity(TrackedLaw):
    """H-infinity controller with planned reference, scheduled around.

    Args:
        A: State matrix of the sampled controller, shape (n, n).
        B: From the error, shape (n,), per rad.
        C: To the acceleration, shape (n,), in rad/s2.
        D: Direct gain, in rad/s2 per rad.
        L: Gain of the anti-windup, shape (n,), per rad/s2.
        stiffness: Stiffness over inertia a0 of the synthesis, in rad/s2 per rad.
        gamma: Norm that the synthesis found, a ratio.
        norm: Norm with the controller of reduced order, a ratio.
        inner_bandwidth: Bandwidth v of the pressure loop, in rad/s.
        compensation: Share of the unexplained acceleration that is compensated at once, 0..1,
            dimensionless.
    """

    tracking: JointTracking
    A: Rows
    B: tuple[float, ...]
    C: tuple[float, ...]
    D: float
    L: tuple[float, ...]
    stiffness: float
    gamma: float
    norm: float
    inner_bandwidth: float = 120.0
    compensation: float = 0.0
    name: str = "H-infinity"

    def initial_state(
        self, measurement: Numbers, arithmetic: Arithmetic = FLOATS
    ) -> HInfinityState:
        front = self.tracking.start(measurement, arithmetic).state
        return HInfinityState(front, tuple(0.0 for _ in self.B))

    def feedback(
        self, state: HInfinityState, now: Context, arithmetic: Arithmetic
    ) -> tuple[Number, HInfinityState, Told]:
        z, joint = state.controller, now.joint
        x = now.plan.angle - now.angle
        a = total(self.D * x, self.C, z)
        inner = self.inner_bandwidth / joint.g
        stiffer = (joint.a0 - self.stiffness) * x + self.compensation * now.unexplained
        asked = now.reference_difference + (a - stiffer) / joint.b
        opening = now.opening + inner * (asked - now.difference)
        clipped = arithmetic.clip(opening, -1.0, 1.0)
        missing = joint.b * (clipped - opening) / inner
        following = tuple(
            total(b * x + gain * missing, row, z)
            for row, b, gain in zip(self.A, self.B, self.L, strict=True)
        )
        return clipped, state._replace(controller=following), {}


@dataclass(frozen=True, kw_only=True)
class HInfinitySpecification(TrackingSpecification):
    """What an H-infinity controller over the whole range is designed for.

    Args:
        speed: Speed of the default weights, in rad/s.
        weights: The weights, in place of the default ones at that speed.
        angle: Angle of the synthesis, in rad.
        inner_bandwidth: Bandwidth of the pressure-difference loop, in rad/s.
        delay: Delay of sample, converter and spool, in s.
        compensation: Share of the unexplained acceleration that is compensated at once, 0..1,
            dimensionless.
    """

    speed: float = 20.0
    weights: Weights | None = None
    angle: float = 0.5236
    inner_bandwidth: float = 120.0
    delay: float = number(0.004, 1e-6, 1.0, "s")
    compensation: float = number(0.0, 0.0, 1.0, words="compensated share")

    def __post_init__(self) -> None:
        super().__post_init__()
        top = 1.0 / self.sample_time
        check_range("bandwidth of the pressure loop", self.inner_bandwidth, 1.0, top, "rad/s")


def design_h_infinity(
    schedule: JointSchedule, specification: HInfinitySpecification | None = None
) -> HInfinity:
    """Design an H-infinity controller at one angle of a schedule, for its load.

    Raises:
        NumericalError: If there is no such controller.
    """
    want = specification or HInfinitySpecification()
    joint = schedule.at(want.angle, want.mean_pressure)
    weights = want.weights or Weights(want.speed)
    plant = joint_behind_pressure_loop(joint, want.inner_bandwidth, want.delay)
    found = synthesise(plant, weights, sample_time=want.sample_time)
    return HInfinity(
        want.tracking(schedule),
        rows(found.A),
        tuple(found.B.ravel().tolist()),
        tuple(found.C.ravel().tolist()),
        float(found.D[0, 0]),
        tuple(
            anti_windup(found.A, found.C, math.exp(-weights.speed * want.sample_time))
            .ravel()
            .tolist()
        ),
        joint.a0,
        found.gamma,
        found.norm,
        inner_bandwidth=want.inner_bandwidth,
        compensation=want.compensation,
        sample_time=want.sample_time,
    )


H_INFINITY = joint_design(
    name="scheduled-h-infinity",
    family="H-infinity",
    summary="H-infinity mixed sensitivity, scheduled around one synthesis; needs slycot",
    function=design_h_infinity,
    needs="map",
    specification=HInfinitySpecification,
)
