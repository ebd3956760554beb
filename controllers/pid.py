"""Cascaded PID: the angle outside, the pressure difference inside.

A PD law on the angle alone limit-cycles once the muscles have hysteresis; the inner loop makes the
valve and the gas a fast source of torque, on which the outer PID can be firm.

With where the joint shall be, r, the feedforward dp_r and o_r, the model (b, g) and the unexplained
acceleration w of a front end (`controllers.joint.tracking`), y the angle, gains in units of
acceleration, sample k, sample time h:

    D[k] = f D[k-1] + (1 - f) ((c r - y)[k] - (c r - y)[k-1]) / h        f = Tf / (Tf + h)
    a[k] = Kp (beta r - y)[k] + I[k] + Kd D[k]
    dp_w = dp_r + (a - kappa w) / b, within +- limit
    o[k] = o_r + K_inner (dp_w - dp - tau g l), clipped to -1..1, then the inverse valve curve
    I[k+1] = I[k] + h Ki (r - y) + (h / Tt) b ((o_clipped - o) / K_inner + dp_w - dp_w before limit)

Around one point (`design_pid`) the reference passes two lags, nothing is fed forward, and the gains
are constant, in Pa per rad (b = 1). Over the whole range (`design_scheduled_pid`) moves are planned
and fed forward, a share kappa of what the observer finds unexplained is compensated at once,
tau g l is what the lag tau of spool and sample still holds
(`controllers.joint.tracking.arrived_opening`), and the gains place the joint's poles at a pair of
frequency w and damping z and at a w, whatever the angle:

    Kp = (1 + 2 a z) w^2 - a0,  Kd = (a + 2 z) w - a1,  Ki = a w^3,  K_inner = omega_inner / g

which takes the inner loop for fast. Where delays keep it slow, v = omega_inner a multiple of w, its
pole counts, and with the fourth pole at p = v + a1 - (2 z + a) w

    Kp = (w^2 (a w + p) + 2 z a w^2 p) / v - a0,  Ki = a w^3 p / v
    Kd = (w^2 + 2 z w (a w + p) + a w p - a0 - e b) / v - a1

I is an acceleration: when b moves with the angle, what it holds keeps its meaning.

Source: Åström and Hägglund, Advanced PID Control, 2006, sections 3.3 to 3.5 (two degrees of
freedom, filter, back-calculation), 6.4 (pole placement), 9.3 (gain scheduling), 12.3 (cascade),
13.3 (discretisation).
"""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Told
from controllers.joint.at_one_point import LaggedReference
from controllers.joint.model import JointModel, joint_model
from controllers.joint.schedule import JointSchedule
from controllers.joint.tracking import (
    Context,
    TrackedLaw,
    Tracking,
    TrackingSpecification,
    arrived_opening,
)
from controllers.sensitivity import peak_sensitivities
from controllers.specification import Checked, number
from controllers.valve_inverse import ValveInverse, joint_design
from workbench.errors import WorkbenchError, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.state_space import linear_model


class Gains(NamedTuple):
    """Gains at one place: Kp, Ki, Kd per acceleration (or Pa), and the inner gain per Pa."""

    proportional: Number
    integral: Number
    derivative: Number
    inner: Number


@dataclass(frozen=True)
class FixedGains(Checked):
    """Gains given by hand, the same everywhere.

    Args:
        proportional: Kp, in Pa/rad.
        integral: Ki, in Pa/(rad s).
        derivative: Kd, in Pa s/rad.
        inner: Inner gain K_inner, opening fraction per Pa.
    """

    proportional: float = number(MISSING, 0.0, 1e12, words="proportional gain")
    integral: float = number(MISSING, 0.0, 1e12, words="integral gain")
    derivative: float = number(MISSING, 0.0, 1e12, words="derivative gain")
    inner: float = number(MISSING, 1e-12, 1.0, "per Pa", "inner gain")

    def at(self, joint: JointModel, arithmetic: Arithmetic) -> Gains:
        """Return the gains."""
        return Gains(self.proportional, self.integral, self.derivative, self.inner)


@dataclass(frozen=True)
class PlacedGains:
    """Gains that place the joint's poles wherever it is.

    Args:
        frequency: Frequency w of the pair, in rad/s.
        damping: Its damping ratio z.
        real_pole: Real pole as a fraction a of w.
        inner_bandwidth: Bandwidth omega_inner of the pressure-difference loop, in rad/s.
        inner_counts: Whether that loop is no faster than the joint, and its pole counts.
    """

    frequency: float = 28.0
    damping: float = 0.8
    real_pole: float = 0.6
    inner_bandwidth: float = 120.0
    inner_counts: bool = False

    def at(self, joint: JointModel, arithmetic: Arithmetic) -> Gains:
        """Return the gains for a joint model."""
        w, a, z = self.frequency, self.real_pole, self.damping
        if self.inner_counts:
            v = self.inner_bandwidth
            p = arithmetic.largest(v + joint.a1 - (2.0 * z + a) * w, 0.1 * w)
            kd = w * w + 2.0 * z * w * (a * w + p) + a * w * p - joint.a0 - joint.e * joint.b
            return Gains(
                arithmetic.largest(w * w * (a * w + (1.0 + 2.0 * z * a) * p) / v - joint.a0, 0.0),
                a * w * w * w * p / v,
                arithmetic.largest(kd / v - joint.a1, 0.0),
                v / joint.g,
            )
        return Gains(
            arithmetic.largest((1.0 + 2.0 * a * z) * w * w - joint.a0, 0.0),
            a * w * w * w,
            arithmetic.largest((a + 2.0 * z) * w - joint.a1, 0.0),
            self.inner_bandwidth / joint.g,
        )


class PIDState(NamedTuple):
    """What a `CascadePID` remembers.

    Args:
        integral: Integral part I, in rad/s2 (around one point in Pa).
        derivative: Filtered derivative D of the weighted error, in rad/s.
        error: Weighted error c r - y of the sample before, in rad.
        arrived: Opening that has arrived behind the lag, a fraction.
    """

    tracking: Any
    integral: Number
    derivative: Number
    error: Number
    arrived: Number


@dataclass(frozen=True, repr=False)
class CascadePID(TrackedLaw):
    """Cascaded PID on angle and pressure difference.

    Args:
        tracking: Front end: lags around one point, or planned moves over the range.
        derivative_filter: Time constant Tf of the derivative's filter, in s.
        tracking_time: Time constant Tt of the anti-windup, in s.
        setpoint_weight: Weight beta of the reference in the proportional part, dimensionless.
        derivative_weight: Weight c of the reference in the derivative part, dimensionless.
        difference_limit: Largest pressure difference asked for, in Pa; infinite for none.
        compensation: Share kappa of the unexplained acceleration compensated at once, a ratio.
        lag: Lag tau of spool and sample that is predicted over, in s; 0 leaves it to the margin.
    """

    tracking: Tracking
    gains: FixedGains | PlacedGains
    derivative_filter: float = 0.005
    tracking_time: float = 0.1
    setpoint_weight: float = 1.0
    derivative_weight: float = 1.0
    difference_limit: float = math.inf
    compensation: float = 0.0
    lag: float = 0.0
    name: str = "cascade PID"

    def __post_init__(self) -> None:
        h = check_range(f"sample time of {self.name}", self.sample_time, 1e-6, 1.0, "s")
        check_range(f"derivative filter of {self.name}", self.derivative_filter, 0.0, 10.0, "s")
        check_range(f"tracking time of {self.name}", self.tracking_time, h, 1e3, "s")
        check_range(f"compensated share of {self.name}", self.compensation, 0.0, 1.0)
        if isinstance(self.gains, PlacedGains):
            w, inner = self.gains.frequency, self.gains.inner_bandwidth
            check_range(f"frequency of {self.name}", w, 0.1, 0.5 / h, "rad/s")
            check_range(f"inner bandwidth of {self.name}", inner, 1.0, 1 / h, "rad/s")

    def initial_state(self, measurement: Numbers, arithmetic: Arithmetic = FLOATS) -> PIDState:
        """Return the state that holds the measured pressure difference at the measured angle."""
        angle = measurement[0]
        front, joint, holding = self.tracking.start(measurement, arithmetic)
        # What the model does not explain is held by the integral part from the start.
        held = (1.0 - self.compensation) * holding
        if self.setpoint_weight != 1.0:
            kp = self.gains.at(joint, arithmetic).proportional
            held = held + kp * (1.0 - self.setpoint_weight) * angle
        error = (self.derivative_weight - 1.0) * angle if self.derivative_weight != 1.0 else 0.0
        return PIDState(front, held, 0.0, error, 0.0)

    def feedback(
        self, state: PIDState, now: Context, arithmetic: Arithmetic
    ) -> tuple[Number, PIDState, Told]:
        h = self.sample_time
        kp, ki, kd, inner = self.gains.at(now.joint, arithmetic)
        target, b = now.plan.angle, now.joint.b
        fade = self.derivative_filter / (self.derivative_filter + h)
        weighted = self.derivative_weight * target - now.angle
        derivative = fade * state.derivative + (1.0 - fade) * (weighted - state.error) / h
        error = self.setpoint_weight * target - now.angle
        acceleration = (
            kp * error + state.integral + kd * derivative - self.compensation * now.unexplained
        )
        asked = now.reference_difference + acceleration / b
        within = asked
        if self.difference_limit < math.inf:
            within = arithmetic.clip(asked, -self.difference_limit, self.difference_limit)
        arrived = self.lag * now.joint.g * state.arrived
        opening = now.opening + inner * (within - now.difference - arrived)
        clipped = arithmetic.clip(opening, -1.0, 1.0)
        back = b * (clipped - opening) / (inner * self.tracking_time)
        if within is not asked:
            back = back + b * (within - asked) / self.tracking_time
        following = state._replace(
            integral=state.integral + h * (ki * (target - now.angle) + back),
            derivative=derivative,
            error=weighted,
            arrived=arrived_opening(state.arrived, clipped - now.opening, self.lag, h),
        )
        told = {"asked_difference": within + (clipped - opening) / inner}
        return clipped, following, told


def cascade_pid(
    proportional: float,
    integral: float,
    derivative: float,
    inner: float,
    *,
    derivative_filter: float = 0.005,
    setpoint_weight: float = 1.0,
    derivative_weight: float = 1.0,
    reference_speed: float = 25.0,
    tracking_time: float = 0.1,
    difference_limit: float = 6e5,
    pressure_filter: float = 0.002,
    sample_time: float = 0.002,
    valve: ValveInverse | None = None,
) -> CascadePID:
    """Return a cascaded PID around one point, with gains given by hand, in SI.

    They are those of `FixedGains`; the reference passes a `LaggedReference` of this speed; the rest
    is as `CascadePID` has it.
    """
    return CascadePID(
        LaggedReference(reference_speed, pressure_filter, sample_time),
        FixedGains(proportional, integral, derivative, inner),
        derivative_filter=derivative_filter,
        tracking_time=tracking_time,
        setpoint_weight=setpoint_weight,
        derivative_weight=derivative_weight,
        difference_limit=difference_limit,
        sample_time=sample_time,
        valve=valve or ValveInverse(),
    )


@dataclass(frozen=True)
class PIDSpecification(Checked):
    """What a cascaded PID around one point is designed for.

    Args:
        inner_bandwidth: Bandwidth of the pressure-difference loop, in rad/s.
        bandwidth: Largest frequency of the outer closed-loop poles, in rad/s; lowered until the
            sensitivity limits hold.
        damping: Damping ratio of the dominant pair.
        real_pole: Real pole (the integral action) as a fraction of the pair's frequency.
        maximum_sensitivity: Limit on Ms, the peak of the sensitivity (ratio).
        maximum_complementary: Limit on Mt, the peak of the complementary sensitivity (ratio).
        reference_speed: Bandwidth of the reference filter, in rad/s.
        sample_time: Time between steps, in s.
    """

    inner_bandwidth: float = 100.0
    bandwidth: float = 30.0
    damping: float = number(0.8, 0.1, 2.0, words="damping ratio")
    real_pole: float = number(0.6, 0.01, 10.0)
    maximum_sensitivity: float = number(2.0, 1.05, 10.0, words="limit on Ms")
    maximum_complementary: float = number(1.6, 1.0, 10.0, words="limit on Mt")
    reference_speed: float = 40.0
    sample_time: float = number(0.002, 1e-6, 1.0, "s")

    def __post_init__(self) -> None:
        super().__post_init__()
        top = 1.0 / self.sample_time
        check_range("inner bandwidth", self.inner_bandwidth, 1.0, top, "rad/s")
        check_range("bandwidth", self.bandwidth, 0.1, self.inner_bandwidth, "rad/s")


def design_pid(
    linear: LinearModel,
    specification: PIDSpecification | None = None,
    *,
    valve: ValveInverse | None = None,
) -> CascadePID:
    """Design a cascaded PID from a linear model.

    The gains place the poles of the joint at w, which is lowered from ``bandwidth`` until Ms and Mt
    of the sampled outer loop, computed on the whole linear model, are within their limits.

    Args:
        valve: Inverse of the valve's curve that the controller believes in; the valve's own by
            default.

    Raises:
        WorkbenchError: If no bandwidth meets the limits.

    Source:
        Limits on Ms and Mt: Åström and Hägglund, Advanced PID Control, 2006, section 4.6.
    """
    linear = linear_model(linear)
    want = specification or PIDSpecification()
    valve = valve or ValveInverse()
    joint = joint_model(linear, valve=valve)
    lowest = math.sqrt(joint.a0 / (1.0 + 2.0 * want.real_pole * want.damping))
    for w in np.geomspace(want.bandwidth, min(lowest, want.bandwidth / 2), 40):
        pid = _place(joint, want, float(w), valve)
        ms, mt = peak_sensitivities(pid, linear)
        if ms <= want.maximum_sensitivity and mt <= want.maximum_complementary:
            return pid
    raise WorkbenchError(
        f"no bandwidth from {lowest:.3g} to {want.bandwidth:.3g} rad/s meets Ms <="
        f" {want.maximum_sensitivity:g} and Mt <= {want.maximum_complementary:g} (at the lowest, Ms"
        f" is {ms:.3g} and Mt {mt:.3g}); allow larger peaks, or raise the inner bandwidth"
    )


def _place(joint: JointModel, want: PIDSpecification, w: float, valve: ValveInverse) -> CascadePID:
    placed = PlacedGains(w, want.damping, want.real_pole, want.inner_bandwidth)
    kp, ki, kd, inner = map(float, placed.at(joint, FLOATS))
    return cascade_pid(
        kp / joint.b,
        ki / joint.b,
        kd / joint.b,
        inner,
        derivative_filter=1.0 / (10.0 * w),
        # The integral follows the clipped command at the speed of the integral action.
        tracking_time=max(1.0 / (want.real_pole * w), 2.0 * want.sample_time),
        reference_speed=want.reference_speed,
        sample_time=want.sample_time,
        valve=valve,
    )


@dataclass(frozen=True, kw_only=True)
class ScheduledPIDSpecification(TrackingSpecification):
    """What a cascaded PID over the whole range is designed for.

    Args:
        frequency: Frequency of the placed pair, in rad/s.
        damping: Its damping ratio, dimensionless.
        real_pole: Real pole as a fraction of the frequency.
        inner_bandwidth: Bandwidth of the pressure-difference loop, in rad/s.
        inner_speed: The same over the frequency, dimensionless, where delays keep the loop slow
            and its pole counts; 0 for a fast one with the bandwidth above.
        compensation: Share of the unexplained acceleration that is compensated at once, a ratio.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
    """

    frequency: float = 28.0
    damping: float = 0.8
    real_pole: float = 0.6
    inner_bandwidth: float = 120.0
    inner_speed: float = 0.0
    compensation: float = 0.3
    lag: float = 0.0


def design_scheduled_pid(
    schedule: JointSchedule, specification: ScheduledPIDSpecification | None = None
) -> CascadePID:
    """Design a cascaded PID over the whole range from a map of linear models, for its load."""
    want = specification or ScheduledPIDSpecification()
    inner = want.inner_speed * want.frequency or want.inner_bandwidth
    return CascadePID(
        want.tracking(schedule),
        PlacedGains(want.frequency, want.damping, want.real_pole, inner, want.inner_speed > 0.0),
        derivative_filter=0.004,
        tracking_time=0.06,
        compensation=want.compensation,
        lag=want.lag,
        sample_time=want.sample_time,
    )


_cascade = partial(joint_design, family="cascade PID", colour=("#0062a8", "#5db5f5"))

PID = _cascade(
    name="pid",
    summary="cascaded PID: angle outside, pressure difference inside",
    function=design_pid,
    specification=PIDSpecification,
)

SCHEDULED_PID = _cascade(
    name="scheduled-pid",
    summary="cascaded PID over the whole range, with planned moves and feedforward",
    function=design_scheduled_pid,
    needs="map",
    specification=ScheduledPIDSpecification,
)
