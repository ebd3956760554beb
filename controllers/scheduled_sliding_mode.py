"""Sliding mode over the whole range: boundary layer, integral surface, super-twisting.

With the plan and the estimate of `joint_tracking`, the error x = theta_r - theta and q its
integral, the surface is

    boundary layer:             s = x'' + 2 lambda x' + lambda^2 x
    integral, super-twisting:   s = x'' + 3 lambda x' + 3 lambda^2 x + lambda^3 q

The equivalent control keeps ds/dt = 0 on the model of the joint at the measured angle:

    J  = j_r + c2 x'' + c1 x' + c0 x + reaching            wanted jerk
    o  = [J + a1 alpha + a0 omega] / (b g) + [e omega + d (dp - dp0)] / g

with (c2, c1, c0) = (2 lambda, lambda^2, 0) or (3 lambda, 3 lambda^2, lambda^3). The acceleration
alpha holds the observer's unexplained part, or a share of it: the integral surface leads to the
reference without it, and is less sensitive to an inertia that is not the known one. The reaching
part is

    boundary layer, integral:   rho sat(s / layer)
    super-twisting:             k1 |s|^(1/2) sat(s / layer) + v,
                                v[k+1] = v[k] + h k2 sat(s / layer)

with k1 = 1.5 sqrt(L), k2 = 1.1 L for a disturbance whose rate is at most L. A boundary layer turns
the last sample's chatter into a linear law with the pole rho / layer; s is judged by its rms.
While the valve is fully open the integrals rest. With a lag tau of spool and sample, alpha in x''
is that of the pressures tau later, alpha + tau b g l (see `controllers.joint.tracking`).

Source: Slotine and Li, Applied Nonlinear Control, 1991, sections 7.1 to 7.3; Utkin and Shi,
Integral sliding mode in systems operating under uncertainty, CDC 1996; Levant, Sliding order and
sliding accuracy, Int. J. Control 58, 1993 (super-twisting); Shtessel et al., Sliding Mode Control
and Observation, 2014, section 4.2 (its gains).
"""

from __future__ import annotations

from dataclasses import dataclass

from controllers.arithmetic import FLOATS, Arithmetic, Number
from controllers.design import Design
from controllers.joint.schedule import JointSchedule
from controllers.joint.tracking import (
    STATE_NAMES,
    JointTracking,
    arrived_opening,
    joint_tracking,
    kalman_correction,
)
from controllers.through_valve import ScheduledLaw
from controllers.valve_inverse import ValveInverse
from workbench.errors import check_choice, check_range

KINDS = ("boundary layer", "integral", "super-twisting")
"""Kinds of sliding mode."""


@dataclass(frozen=True)
class ScheduledSlidingMode(ScheduledLaw):
    """Gain-scheduled sliding mode with planned reference.

    Args:
        tracking: Planner, observer and schedule.
        kind: One of `KINDS`.
        slope: Slope lambda of the surface, in rad/s.
        jerk_bound: Bound rho on the jerk that the model leaves out, in rad/s3.
        layer: Half width of the boundary layer, in rad/s2.
        rate_bound: Bound L on the rate of what the model leaves out, in rad/s4, for super-twisting.
        compensation: Share of the unexplained acceleration that counts as acceleration, 0..1,
            dimensionless.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
        sample_time: Time between steps, in s.
        valve: Valve curve that is inverted.
        name: Name under which results are reported.
        sensors: Names of the angle and the two pressures.
        follows: Name of the followed output.
        actuators: Name of the command.
        preview: No future references are used.

    Raises:
        WorkbenchError: If the kind is unknown or a number outside its range.

    Example:
        >>> rows = tuple((v, v) for v in (1.6e-4, 1.0, 100.0, 3.6e7, 6e5, 0.8, 0.0))
        >>> front = joint_tracking(JointSchedule(0.0, 1.0, rows, rows, 3e5, 4e5))
        >>> law = ScheduledSlidingMode(front, "integral", 25.0, 1500.0, 25.0)
        >>> law.step(law.initial_state((0.5, 3e5, 3e5)), (0.5, 3e5, 3e5), (0.5,))[0]
        (5.0,)
    """

    tracking: JointTracking
    kind: str
    slope: float
    jerk_bound: float
    layer: float
    rate_bound: float = 5e4
    compensation: float = 1.0
    lag: float = 0.0
    sample_time: float = 0.002
    valve: ValveInverse = ValveInverse()
    name: str = "sliding mode"
    sensors: tuple[str, ...] = ("angle", "pressure_1", "pressure_2")
    follows: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0

    def __post_init__(self) -> None:
        """Check the gains."""
        check_choice("kind of sliding mode", self.kind, KINDS)
        h = check_range(f"sample time of {self.name}", self.sample_time, 1e-6, 1.0, "s")
        check_range(f"slope of {self.name}", self.slope, 0.01, 1.0 / h, "rad/s")
        check_range(f"bound on the jerk of {self.name}", self.jerk_bound, 1e-6, 1e9, "rad/s3")
        check_range(f"boundary layer of {self.name}", self.layer, 1e-9, 1e9, "rad/s2")
        check_range(f"bound on the rate of {self.name}", self.rate_bound, 1e-6, 1e12, "rad/s4")

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the entries of the state."""
        return (*STATE_NAMES, "error_integral", "twist", "arrived")

    def initial_state(
        self, measurement: tuple[Number, ...], arithmetic: Arithmetic = FLOATS
    ) -> tuple[Number, ...]:
        """Return the state of a joint at rest.

        Args:
            measurement: Angle in rad and the two gauge pressures in Pa.
            arithmetic: Floats or CasADi symbols.
        """
        return (*self.tracking.start(measurement, arithmetic), 0.0, 0.0, 0.0)

    def law(
        self,
        state: tuple[Number, ...],
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
    ) -> tuple[tuple[Number, ...], tuple[Number, ...], dict[str, Number]]:
        """Compute one sample on floats or on symbols.

        Args:
            state: State of the step before, a tuple of numbers in SI.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.
            arithmetic: Floats or CasADi symbols.

        Returns:
            Voltage in V, next state, and the opening (fraction), the surface s (rad/s2) and the
            planned angle (rad).
        """
        h, lam = self.sample_time, self.slope
        look, front = self.tracking.look(state, measurement, reference[0], arithmetic)
        q, twist, arrived = state[len(front) :]
        x = look.plan.angle - look.angle
        dx = look.plan.speed - look.speed
        acceleration = look.acceleration - (1.0 - self.compensation) * look.unexplained
        ahead = acceleration + self.lag * look.joint.b * look.joint.g * arrived
        ddx = look.plan.acceleration - ahead
        if self.kind != "boundary layer":
            c2, c1, c0 = 3.0 * lam, 3.0 * lam * lam, lam * lam * lam
            surface = ddx + c2 * dx + c1 * x + c0 * q
        else:
            c2, c1, c0 = 2.0 * lam, lam * lam, 0.0
            surface = ddx + c2 * dx + c1 * x
        side = arithmetic.clip(surface / self.layer, -1.0, 1.0)
        if self.kind == "super-twisting":
            size = arithmetic.root(arithmetic.largest(surface, -surface))
            reaching = 1.5 * self.rate_bound**0.5 * size * side + twist
        else:
            reaching = self.jerk_bound * side
        jerk = look.plan.jerk + c2 * ddx + c1 * dx + c0 * x + reaching
        joint = look.joint
        opening = (jerk + joint.a1 * acceleration + joint.a0 * look.speed) / (joint.b * joint.g) + (
            joint.e * look.speed + joint.d * (look.difference - joint.difference)
        ) / joint.g
        clipped = arithmetic.clip(opening, -1.0, 1.0)
        free = arithmetic.where(arithmetic.largest(opening, -opening) < 1.0, 1.0, 0.0)
        twisted = 1.1 * self.rate_bound * side if self.kind == "super-twisting" else 0.0
        summed = 0.0 if self.kind == "boundary layer" else x
        arrived = arrived_opening(arrived, clipped - look.opening, self.lag, h)
        following = (*front, q + free * h * summed, twist + free * h * twisted, arrived)
        info = {"opening": clipped, "surface": surface, "plan": look.plan.angle}
        return (self.valve.command(clipped, arithmetic),), following, info


def design_scheduled_sliding_mode(
    schedule: JointSchedule,
    *,
    kind: str = "super-twisting",
    slope: float = 22.0,
    unexplained_share: float = 0.3,
    layer_bandwidth: float = 60.0,
    compensation: float | None = None,
    lag: float = 0.0,
    jerk_share: float = 0.7,
    jerk_limit: float = 1800.0,
    lead: float = 0.0,
    sample_time: float = 0.002,
    valve: ValveInverse | None = None,
) -> ScheduledSlidingMode:
    """Design a scheduled sliding mode from a map of linear models.

    The jerk that the model leaves out is bounded by a share of what the open valve does to the
    joint (errors of the valve's gain and of the load); ``layer = rho / layer_bandwidth``.

    Args:
        schedule: The joint over angle and mean pressure, for the known load.
        kind: One of `KINDS`.
        slope: Decay of the error on the surface, in rad/s.
        unexplained_share: Bound on the jerk as a share of the open valve's, 0..1,
            dimensionless.
        layer_bandwidth: Pole inside the layer, in rad/s; below the spool's bandwidth.
        compensation: Share of the unexplained acceleration taken as acceleration, dimensionless; by
            default all without integral, 0 for ``"integral"`` and 0.3 for ``"super-twisting"``.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
        jerk_share: Share of the valve's opening that a planned move may use, 0..1,
            dimensionless.
        jerk_limit: Largest planned jerk, in rad/s3.
        lead: Time by which the opening of the feedforward leads the plan, in s.
        sample_time: Time between steps, in s.
        valve: Valve curve that is inverted.

    Returns:
        The controller.

    Raises:
        WorkbenchError: If a number is outside its range.

    Example:
        >>> rows = tuple((v, v) for v in (1.6e-4, 1.0, 100.0, 3.6e7, 6e5, 0.8, 0.0))
        >>> law = design_scheduled_sliding_mode(JointSchedule(0.0, 1.0, rows, rows, 3e5, 4e5))
        >>> round(law.jerk_bound / law.layer)
        60
    """
    check_choice("kind of sliding mode", kind, KINDS)
    check_range("share of the jerk left out", unexplained_share, 1e-3, 1.0)
    check_range("bandwidth of the layer", layer_bandwidth, 0.1, 1e3, "rad/s")
    tracking = joint_tracking(
        schedule,
        jerk_share=jerk_share,
        jerk_limit=jerk_limit,
        lead=lead,
        correction=kalman_correction(sample_time=sample_time),
        sample_time=sample_time,
    )
    bound = unexplained_share * min(m.opening_to_jerk for m in schedule.models(3.8e5))
    return ScheduledSlidingMode(
        tracking,
        kind,
        slope=slope,
        jerk_bound=bound,
        layer=bound / layer_bandwidth,
        rate_bound=20.0 * bound,
        compensation=(
            {"boundary layer": 1.0, "integral": 0.0, "super-twisting": 0.3}[kind]
            if compensation is None
            else check_range("compensated share", compensation, 0.0, 1.0)
        ),
        lag=lag,
        sample_time=sample_time,
        valve=valve or ValveInverse(),
    )


SCHEDULED_SLIDING_MODE = Design(
    name="scheduled-sliding-mode",
    family="sliding mode",
    summary="sliding mode over the whole range, with planned moves",
    function=design_scheduled_sliding_mode,
    needs="map",
    slides=True,
    colour=("#c24a00", "#ff9152"),
)
