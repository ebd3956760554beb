"""H-infinity control over the whole range: one synthesis at 30°, what varies with the angle on top.

Along the plan, with the feedforward dp_r and o_r of `joint_tracking`, the error x = theta_r - theta
and the sampled controller (A, B, C, D) of `controllers.h_infinity.synthesis`, sample k:

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

import numpy as np
import numpy.typing as npt

from controllers.arithmetic import FLOATS, Arithmetic, Number
from controllers.design import Design
from controllers.h_infinity.synthesis import Synthesis, Weights, synthesise
from controllers.joint.model import JointModel
from controllers.joint.schedule import JointSchedule
from controllers.joint.tracking import JointTracking, TrackingState, kalman_tracking
from controllers.valve_inverse import ClosedForm, ValveInverse
from workbench.errors import check_range

Matrix = npt.NDArray[np.float64]
Rows = tuple[tuple[float, ...], ...]


class HInfinityState(NamedTuple):
    """States of the front end and of the sampled controller."""

    tracking: TrackingState
    controller: tuple[Number, ...]


@dataclass(frozen=True, repr=False)
class HInfinity(ClosedForm):
    """H-infinity controller with planned reference, scheduled around.

    Args:
        tracking: Planner, observer and schedule.
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
        name: Name under which results are reported.
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
        self, measurement: tuple[Number, ...], arithmetic: Arithmetic = FLOATS
    ) -> HInfinityState:
        """Return the state of a joint at rest."""
        front = self.tracking.start(measurement, arithmetic).state
        return HInfinityState(front, tuple(0.0 for _ in self.B))

    def law(
        self,
        state: HInfinityState,
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
    ) -> tuple[tuple[Number, ...], HInfinityState, dict[str, Number]]:
        """Compute one sample on floats or on symbols, in SI."""
        now, front = self.tracking.context(state.tracking, measurement, reference[0], arithmetic)
        z, joint = state.controller, now.joint
        x = now.plan.angle - now.angle
        a = self.D * x
        for c, entry in zip(self.C, z, strict=True):
            a = a + c * entry
        inner = self.inner_bandwidth / joint.g
        stiffer = (joint.a0 - self.stiffness) * x + self.compensation * now.unexplained
        asked = now.reference_difference + (a - stiffer) / joint.b
        opening = now.opening + inner * (asked - now.difference)
        clipped = arithmetic.clip(opening, -1.0, 1.0)
        missing = joint.b * (clipped - opening) / inner
        following = []
        for row, b, gain in zip(self.A, self.B, self.L, strict=True):
            moved = b * x + gain * missing
            for factor, entry in zip(row, z, strict=True):
                moved = moved + factor * entry
            following.append(moved)
        info = {"opening": clipped, "plan": now.plan.angle}
        command = self.valve.command(clipped, arithmetic)
        return (command,), HInfinityState(front, tuple(following)), info


def design_h_infinity(
    schedule: JointSchedule,
    *,
    speed: float = 20.0,
    weights: Weights | None = None,
    angle: float = 0.5236,
    inner_bandwidth: float = 120.0,
    delay: float = 0.004,
    jerk_share: float = 0.7,
    jerk_limit: float = 1800.0,
    lead: float = 0.0,
    compensation: float = 0.0,
    mean_pressure: float = 3.8e5,
    reference_bandwidth: float = 0.0,
    reference_jump: float = 0.02,
    sample_time: float = 0.002,
    valve: ValveInverse | None = None,
) -> HInfinity:
    """Design an H-infinity controller at one angle of a schedule.

    Args:
        schedule: The joint over angle and mean pressure, for the known load.
        speed: Speed of the default weights, in rad/s.
        weights: The weights, in place of the default ones at that speed.
        angle: Angle of the synthesis, in rad.
        inner_bandwidth: Bandwidth of the pressure-difference loop, in rad/s.
        delay: Delay of sample, converter and spool, in s.
        jerk_share: Share of the valve's opening that a planned move may use, 0..1,
            dimensionless.
        jerk_limit: Largest planned jerk, in rad/s3.
        lead: Time by which the opening of the feedforward leads the plan, in s.
        compensation: Share of the unexplained acceleration that is compensated at once, 0..1,
            dimensionless.
        mean_pressure: Mean gauge pressure of the synthesis, in Pa.
        reference_bandwidth: Bandwidth of the filter of a rough reference (quantised, held,
            noisy), in rad/s; 0 for a smooth one.
        reference_jump: Smallest step of a rough reference that is planned as a move, in rad.
        sample_time: Time between steps, in s.

    Raises:
        WorkbenchError: If slycot is not installed or a number is outside its range.
        NumericalError: If there is no such controller.
    """
    check_range("compensated share", compensation, 0.0, 1.0)
    at = schedule.at(angle, mean_pressure)
    joint = JointModel(*at[:6], angle=angle, difference=at.difference)
    weights = weights or Weights(speed)
    found = synthesise(
        joint,
        weights,
        inner_bandwidth=inner_bandwidth,
        delay=delay,
        sample_time=sample_time,
    )
    gain = _anti_windup(found, math.exp(-weights.speed * sample_time))
    return HInfinity(
        kalman_tracking(
            schedule,
            jerk_share=jerk_share,
            jerk_limit=jerk_limit,
            lead=lead,
            reference_bandwidth=reference_bandwidth,
            reference_jump=reference_jump,
            mean_pressure=mean_pressure,
            sample_time=sample_time,
        ),
        tuple(tuple(row) for row in found.A.tolist()),
        tuple(found.B.ravel().tolist()),
        tuple(found.C.ravel().tolist()),
        float(found.D[0, 0]),
        tuple(gain.tolist()),
        joint.a0,
        found.gamma,
        found.norm,
        inner_bandwidth=inner_bandwidth,
        compensation=compensation,
        sample_time=sample_time,
        valve=valve or ValveInverse(),
    )


def _anti_windup(found: Synthesis, pole: float) -> Matrix:
    """Return L for which A - L C has this pole in the place of the slowest of A."""
    values, vectors = np.linalg.eig(found.A)
    slow = int(np.argmax(np.abs(values)))
    v = vectors[:, slow].real
    return np.asarray((values[slow].real - pole) * v / float((found.C @ v)[0]))


H_INFINITY = Design(
    name="scheduled-h-infinity",
    family="H-infinity",
    summary="H-infinity mixed sensitivity, scheduled around one synthesis; needs slycot",
    function=design_h_infinity,
    needs="map",
)
