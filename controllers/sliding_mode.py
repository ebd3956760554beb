"""Sliding mode on the third-order model of the joint: boundary layer, integral, super-twisting.

With where the joint shall be (theta_r and its derivatives) and the estimate of a front end
(`controllers.joint.tracking`), the error x = theta_r - theta and q its integral, the surface is

    boundary layer:             s = x'' + c x' + k x
    integral, super-twisting:   s = x'' + (c + lambda) x' + (k + c lambda) x + k lambda q

with c = 2 lambda, k = lambda^2, or with less damping zeta on the stiffness of the joint itself,
k = lambda^2 + a0, c = 2 zeta sqrt(k): a surface slower than the joint's own swing takes stiffness
away, which costs the margins that a tolerant design needs. The acceleration is what the pressure
difference dp beside that of the feedforward makes,

    x'' = b (dp_r - dp) - a1 x' - a0 x - share * unexplained

The equivalent control keeps ds/dt = 0 on the model of the joint at the measured angle. Along the
plan that is the opening o_r of the front end's feedforward, which leads by the lag of the valve and
knows the inertia and hysteresis that were learned; beside the plan

    J  = c2 x'' + c1 x' + c0 x + reaching                  jerk asked for beside that of the plan
    o  = o_r + [J - a1 x'' - a0 x'] / (b g) + [d (dp - dp0) - e x'] / g

with c2, c1 and c0 the coefficients of x', x and q in s. The integral surface leads to the reference
without the observer's unexplained part, and is then less sensitive to an inertia that is not the
known one. The reaching part is

    boundary layer, integral:   rho sat(s / layer)
    super-twisting:             k1 |s|^(1/2) sat(s / layer) + v,
                                v[k+1] = v[k] + h k2 sat(s / layer)

with k1 = 1.5 sqrt(L), k2 = 1.1 L for a disturbance whose rate is at most L. For |s| > layer the
surface is reached if rho exceeds the jerk that the model leaves out; inside, the law is linear with
the pole rho / layer instead of chattering; s is judged by its rms. While the valve is fully open
the integrals rest. With a lag tau of spool and sample, x'' is that of the pressures tau later,
x'' - tau b g l (`controllers.joint.tracking.arrived_opening`).

Around one point (`design_sliding_mode`) the reference is that of a third-order model; over the
whole range (`design_scheduled_sliding_mode`) moves are planned.

Source: Slotine and Li, Applied Nonlinear Control, 1991, sections 7.1 to 7.3; Edwards and Spurgeon,
Sliding Mode Control, 1998, chapter 3 (equivalent control); Utkin and Shi, Integral sliding mode in
systems operating under uncertainty, CDC 1996; Levant, Sliding order and sliding accuracy, Int. J.
Control 58, 1993 (super-twisting); Shtessel et al., Sliding Mode Control and Observation, 2014,
section 4.2 (its gains).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Told
from controllers.design import Design
from controllers.joint.at_one_point import ReferenceModel
from controllers.joint.model import joint_model
from controllers.joint.observer import design_joint_observer
from controllers.joint.schedule import JointSchedule
from controllers.joint.tracking import (
    Context,
    TrackedLaw,
    Tracking,
    TrackingSpecification,
    arrived_opening,
)
from controllers.specification import Checked, number
from controllers.valve_inverse import ACTUATORS, SENSORS
from workbench.errors import check_choice, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.state_space import linear_model

KINDS = ("boundary layer", "integral", "super-twisting")
"""Kinds of sliding mode."""


class SlidingModeState(NamedTuple):
    """What a `SlidingMode` remembers.

    Args:
        error_integral: Integral q of the error, in rad s.
        twist: Integral part v of the reaching jerk, in rad/s3.
        arrived: Opening that has arrived behind the lag, a fraction.
    """

    tracking: Any
    error_integral: Number
    twist: Number
    arrived: Number


@dataclass(frozen=True, repr=False)
class SlidingMode(TrackedLaw):
    """Sliding mode with observer.

    Args:
        tracking: Front end: reference model around one point, or planned moves over the range.
        kind: One of `KINDS`.
        slope: Slope lambda of the surface, in rad/s: errors decay like exp(-lambda t) on it.
        jerk_bound: Bound rho on the jerk that the model leaves out, in rad/s3.
        layer: Half width of the boundary layer, in rad/s2.
        rate_bound: Bound L on the rate of what the model leaves out, in rad/s4, for super-twisting.
        compensation: Share of the unexplained acceleration that counts as acceleration, a ratio.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
        damping: Damping zeta of the surface (dimensionless); below 1 on the joint's own stiffness.
    """

    tracking: Tracking
    kind: str
    slope: float
    jerk_bound: float
    layer: float
    rate_bound: float = 5e4
    compensation: float = 1.0
    lag: float = 0.0
    damping: float = 1.0
    name: str = "sliding mode"

    def __post_init__(self) -> None:
        check_choice("kind of sliding mode", self.kind, KINDS)
        h = check_range(f"sample time of {self.name}", self.sample_time, 1e-6, 1.0, "s")
        check_range(f"slope of {self.name}", self.slope, 0.01, 1.0 / h, "rad/s")
        check_range(f"bound on the jerk of {self.name}", self.jerk_bound, 1e-6, 1e9, "rad/s3")
        check_range(f"boundary layer of {self.name}", self.layer, 1e-9, 1e9, "rad/s2")
        check_range(f"bound on the rate of {self.name}", self.rate_bound, 1e-6, 1e12, "rad/s4")

    def initial_state(
        self, measurement: Numbers, arithmetic: Arithmetic = FLOATS
    ) -> SlidingModeState:
        return SlidingModeState(self.tracking.start(measurement, arithmetic).state, 0.0, 0.0, 0.0)

    def feedback(
        self, state: SlidingModeState, now: Context, arithmetic: Arithmetic
    ) -> tuple[Number, SlidingModeState, Told]:
        h, lam = self.sample_time, self.slope
        joint = now.joint
        x = now.plan.angle - now.angle
        dx = now.plan.speed - now.speed
        pushed = joint.b * (now.reference_difference - now.difference)
        beside = pushed - joint.a1 * dx - joint.a0 * x - self.compensation * now.unexplained
        ddx = beside - self.lag * joint.b * joint.g * state.arrived
        slow = 0.0 if self.kind == "boundary layer" else lam
        stiffness, damping = lam * lam, 2.0 * lam
        if self.damping < 1.0:
            stiffness = stiffness + arithmetic.largest(joint.a0, 0.0)
            damping = 2.0 * self.damping * arithmetic.root(stiffness)
        c2, c1, c0 = damping + slow, stiffness + slow * damping, slow * stiffness
        surface = ddx + c2 * dx + c1 * x + c0 * state.error_integral
        side = arithmetic.clip(surface / self.layer, -1.0, 1.0)
        if self.kind == "super-twisting":
            size = arithmetic.root(arithmetic.largest(surface, -surface))
            reaching = 1.5 * self.rate_bound**0.5 * size * side + state.twist
        else:
            reaching = self.jerk_bound * side
        own = joint.a1 * beside + joint.a0 * dx
        jerk = c2 * ddx + c1 * dx + c0 * x + reaching - own
        leak = joint.d * (now.difference - joint.difference) - joint.e * dx
        opening = now.opening + (jerk / joint.b + leak) / joint.g
        clipped = arithmetic.clip(opening, -1.0, 1.0)
        free = arithmetic.where(arithmetic.largest(opening, -opening) < 1.0, 1.0, 0.0)
        twisted = 1.1 * self.rate_bound * side if self.kind == "super-twisting" else 0.0
        summed = 0.0 if self.kind == "boundary layer" else x
        following = state._replace(
            error_integral=state.error_integral + free * h * summed,
            twist=state.twist + free * h * twisted,
            arrived=arrived_opening(state.arrived, clipped - now.opening, self.lag, h),
        )
        return clipped, following, {"surface": surface, "speed": now.speed}


@dataclass(frozen=True)
class SlidingModeSpecification(Checked):
    """What a sliding mode around one point is designed for.

    Args:
        slope: Decay of the error on the surface, in rad/s.
        jerk_bound: Bound on the jerk that the model leaves out (gain of the valve, hysteresis,
            load), in rad/s3.
        layer_bandwidth: Pole inside the boundary layer, in rad/s; below the spool's bandwidth.
        observer_bandwidth: Poles of the observer, in rad/s.
        reference_speed: Poles of the reference model, in rad/s.
        sample_time: Time between steps, in s.
    """

    slope: float = number(25.0, 0.01, 1e3, "rad/s", "slope of the surface")
    jerk_bound: float = number(2000.0, 1e-6, 1e9, "rad/s3", "bound on the jerk")
    layer_bandwidth: float = number(80.0, 0.1, 1e3, "rad/s", "bandwidth of the layer")
    observer_bandwidth: float = number(100.0, 0.1, 1e3, "rad/s", "bandwidth of the observer")
    reference_speed: float = number(25.0, 0.1, 1e3, "rad/s")
    sample_time: float = 0.002


def design_sliding_mode(
    linear: LinearModel, specification: SlidingModeSpecification | None = None
) -> SlidingMode:
    """Design a sliding mode with boundary layer from a linear model.

    ``layer = jerk_bound / layer_bandwidth``.

    Raises:
        WorkbenchError: If the bound on the jerk exceeds what the fully open valve can do.
    """
    linear = linear_model(linear)
    want = specification or SlidingModeSpecification()
    joint = joint_model(linear)
    check_range(
        "bound on the jerk",
        want.jerk_bound,
        1e-6,
        joint.opening_to_jerk,
        "rad/s3",
        fix="the upper limit is what the fully open valve does to this joint",
    )
    observer = design_joint_observer(
        joint, bandwidth=want.observer_bandwidth, sample_time=want.sample_time
    )
    front = ReferenceModel(joint, observer, want.reference_speed, sample_time=want.sample_time)
    return SlidingMode(
        front,
        "boundary layer",
        slope=want.slope,
        jerk_bound=want.jerk_bound,
        layer=want.jerk_bound / want.layer_bandwidth,
        sample_time=want.sample_time,
    )


@dataclass(frozen=True, kw_only=True)
class ScheduledSlidingModeSpecification(TrackingSpecification):
    """What a sliding mode over the whole range is designed for.

    Args:
        kind: One of `KINDS`.
        slope: Decay of the error on the surface, in rad/s.
        unexplained_share: Bound on the jerk that the model leaves out (errors of the valve's gain
            and of the load) as a share of the open valve's, a ratio.
        layer_bandwidth: Pole inside the layer, in rad/s; below the spool's bandwidth.
        compensation: Share of the unexplained acceleration taken as acceleration, a ratio; by
            default all without integral, 0 for ``"integral"`` and 0.3 for ``"super-twisting"``.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
        damping: Damping of errors on the surface (dimensionless). With 1 they decay without
            swinging; below it the surface leaves the joint its own stiffness, which a slope below
            the joint's own frequency would have to take away, at the cost of margins.
    """

    kind: str = "super-twisting"
    slope: float = 22.0
    unexplained_share: float = number(0.3, 1e-3, 1.0, words="share of the jerk left out")
    layer_bandwidth: float = number(60.0, 0.1, 1e3, "rad/s", "bandwidth of the layer")
    compensation: float | None = None
    lag: float = 0.0
    damping: float = number(1.0, 0.05, 1.0, words="damping of the surface")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("kind of sliding mode", self.kind, KINDS)
        if self.compensation is not None:
            check_range("compensated share", self.compensation, 0.0, 1.0)


def design_scheduled_sliding_mode(
    schedule: JointSchedule, specification: ScheduledSlidingModeSpecification | None = None
) -> SlidingMode:
    """Design a sliding mode over the whole range from a map of linear models, for its load.

    ``layer = rho / layer_bandwidth``.
    """
    want = specification or ScheduledSlidingModeSpecification()
    models = schedule.models(want.mean_pressure)
    bound = want.unexplained_share * min(m.opening_to_jerk for m in models)
    usual = {"boundary layer": 1.0, "integral": 0.0, "super-twisting": 0.3}[want.kind]
    return SlidingMode(
        want.tracking(schedule),
        want.kind,
        slope=want.slope,
        jerk_bound=bound,
        layer=bound / want.layer_bandwidth,
        rate_bound=20.0 * bound,
        compensation=usual if want.compensation is None else want.compensation,
        lag=want.lag,
        damping=want.damping,
        sample_time=want.sample_time,
    )


sliding_design = partial(Design, family="sliding mode", slides=True, colour=("#c24a00", "#ff9152"))
"""A design of this family."""

_for_joint = partial(sliding_design, sensors=SENSORS, actuators=ACTUATORS)

SLIDING_MODE = _for_joint(
    name="sliding-mode",
    summary="sliding mode with boundary layer, observer and reference model",
    function=design_sliding_mode,
    specification=SlidingModeSpecification,
)

SCHEDULED_SLIDING_MODE = _for_joint(
    name="scheduled-sliding-mode",
    summary="sliding mode over the whole range, with planned moves",
    function=design_scheduled_sliding_mode,
    needs="map",
    specification=ScheduledSlidingModeSpecification,
)
