"""What every scheduled controller does before its feedback: plan, estimate, look up the joint.

At sample k, from the angle y, the pressures p1 and p2 and the reference r:

    (theta_r, omega_r, alpha_r, j_r)   planned reference (`controllers.reference.planned`)
    dp, pm                             filtered pressure difference and mean pressure
    (theta, omega, w)                  observer of the joint as a double integrator driven by the
                                       acceleration  b (dp - dp0(theta, pm)) - a1 omega + w
    alpha = b (dp - dp0) - a1 omega + w

and the inverse model along the plan, the feedforward:

    dp_r = dp0(theta_r, pm) + (alpha_r + a1 omega_r) / b
    o_r  = [(j_r' + a1 alpha_r' + a0 omega_r') / b + e omega_r'] / g

where ' is the plan as it will be when the opening has arrived, a lead later.

w collects friction, muscle hysteresis and wrong loads. It is an acceleration, so the observer is
the same for every angle and load: what the map knows enters with the acceleration.

Source: disturbance observer: Ohnishi, Shibata and Murakami, IEEE/ASME Trans. Mechatronics 1, 1996;
feedforward by the inverse model: Åström and Wittenmark, Computer-Controlled Systems, 1997, 6.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Number
from controllers.joint.hysteresis_compensation import HysteresisCompensation
from controllers.joint.model import JointModel
from controllers.joint.observer import design_joint_observer, held
from controllers.joint.schedule import JointSchedule, ScheduledJoint
from controllers.reference.planned import Plan, Planner, PlannerState
from workbench.errors import check_range

STATE_NAMES: tuple[str, ...] = (
    *(f"plan_{name}" for name in PlannerState._fields),
    "angle",
    "speed",
    "unexplained",
    "difference",
    "mean",
    "turn",
)
"""Names of what a `JointTracking` remembers: the planner's state, then the estimate in SI."""


class Look(NamedTuple):
    """What a feedback law is told at one sample.

    Args:
        plan: Where the joint shall be.
        joint: Joint model at the measured angle.
        planned: Joint model at the planned angle.
        angle: Measured angle, in rad.
        speed: Estimated speed, in rad/s.
        acceleration: Estimated acceleration, in rad/s2.
        unexplained: Estimated acceleration that the model does not explain, in rad/s2.
        difference: Filtered pressure difference, in Pa.
        mean: Filtered mean pressure, in Pa.
        wanted_difference: Pressure difference of the feedforward, in Pa.
        opening: Opening of the feedforward, a fraction.
    """

    plan: Plan
    joint: ScheduledJoint
    planned: ScheduledJoint
    angle: Number
    speed: Number
    acceleration: Number
    unexplained: Number
    difference: Number
    mean: Number
    wanted_difference: Number
    opening: Number


@dataclass(frozen=True)
class JointTracking:
    """Planner, observer and schedule of a joint.

    Args:
        schedule: Joint model over angle and mean pressure.
        planner: Planner of the reference.
        correction: Gains of the observer for angle, speed and unexplained acceleration, in SI.
        pressure_filter: Time constant of the pressures' filter, in s.
        sample_time: Time between samples, in s.
        hysteresis: Fitted hysteresis that is compensated along the plan; None for none.
        lead: Time by which the opening of the feedforward leads the plan, in s.

    Example:
        >>> JointTracking.__dataclass_fields__["sample_time"].default
        0.002
    """

    schedule: JointSchedule
    planner: Planner
    correction: tuple[float, float, float]
    pressure_filter: float = 0.002
    sample_time: float = 0.002
    hysteresis: HysteresisCompensation | None = None
    lead: float = 0.0

    def start(
        self, measurement: tuple[Number, ...], arithmetic: Arithmetic = FLOATS
    ) -> tuple[Number, ...]:
        """Return the state of a joint at rest.

        Args:
            measurement: Angle in rad and the two gauge pressures in Pa.
            arithmetic: Floats or CasADi symbols.

        Returns:
            State in the order of `STATE_NAMES`, in SI.
        """
        angle, p1, p2 = measurement
        mean = 0.5 * (p1 + p2)
        joint = self.schedule.at(angle, mean, arithmetic)
        push = joint.b * (p1 - p2 - joint.difference)
        return (*self.planner.start(angle), angle, 0.0, -push, p1 - p2, mean, 0.0)

    def look(
        self,
        state: tuple[Number, ...],
        measurement: tuple[Number, ...],
        reference: Number,
        arithmetic: Arithmetic,
    ) -> tuple[Look, tuple[Number, ...]]:
        """Plan and estimate one sample.

        Args:
            state: State of the sample before.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Reference now, in rad.
            arithmetic: Floats or CasADi symbols.

        Returns:
            What the feedback needs, in SI, and the next state.
        """
        h = self.sample_time
        angle, p1, p2 = measurement
        plan, planner = self.planner.plan(PlannerState(*state[:8]), reference, arithmetic)
        theta, omega, w, difference, mean, turn = state[8:14]
        fresh = h / (self.pressure_filter + h)
        difference = difference + fresh * (p1 - p2 - difference)
        mean = mean + fresh * (0.5 * (p1 + p2) - mean)

        residual = angle - theta
        theta = theta + self.correction[0] * residual
        omega = omega + self.correction[1] * residual
        w = w + self.correction[2] * residual
        joint = self.schedule.at(angle, mean, arithmetic)
        planned = self.schedule.at(plan.angle, mean, arithmetic)
        alpha = joint.b * (difference - joint.difference) - joint.a1 * omega + w

        wanted = planned.difference + (plan.acceleration + planned.a1 * plan.speed) / planned.b
        if self.hysteresis is not None:
            turn = self.hysteresis.turned(turn, plan.speed, h, arithmetic)
            lost = self.hysteresis.difference(turn, mean)
            wanted = wanted + lost
            alpha = alpha - joint.b * lost
        then = self.planner.ahead(planner, plan, self.lead, arithmetic) if self.lead else plan
        rate = (
            then.jerk + planned.a1 * then.acceleration + planned.a0 * then.speed
        ) / planned.b + planned.e * then.speed
        following = (
            *planner,
            theta + h * omega + 0.5 * h * h * alpha,
            omega + h * alpha,
            w,
            difference,
            mean,
            turn,
        )
        opening = rate / planned.g
        return (
            Look(
                plan,
                joint,
                planned,
                angle,
                omega,
                alpha,
                w,
                difference,
                mean,
                wanted,
                opening,
            ),
            following,
        )


def arrived_opening(there: Number, asked: Number, lag: float, sample_time: float) -> Number:
    """Advance the opening that has arrived behind the lag of spool and sample.

    With dl/dt = (o - l) / tau and d(dp)/dt = g l, the pressure difference dp + tau g l, what is
    there and what is on its way, follows the opening o without the lag. A law that feeds it back in
    place of dp does not ask again for what is on its way (a predictor after Smith).

    Args:
        there: Opening l that has arrived, a fraction.
        asked: Opening o asked for now, a fraction.
        lag: Lag tau, in s; 0 for none.
        sample_time: Time between samples, in s.

    Returns:
        Opening that has arrived one sample later, a fraction; 0 without a lag.

    Source:
        Åström and Wittenmark, Computer-Controlled Systems, 1997, section 4.7 (predictors).

    Example:
        >>> round(arrived_opening(0.0, 1.0, 0.004, 0.002), 3)
        0.393
    """
    if lag <= 0.0:
        return 0.0 * asked
    fade = math.exp(-sample_time / lag)
    return fade * there + (1.0 - fade) * asked


def joint_tracking(
    schedule: JointSchedule,
    *,
    jerk_share: float = 0.7,
    jerk_limit: float = 1800.0,
    observer_bandwidth: float = 80.0,
    correction: tuple[float, float, float] | None = None,
    pressure_reserve: float = 2.8e5,
    mean_pressure: float = 3.8e5,
    shortest: float = 0.05,
    lead: float = 0.0,
    sample_time: float = 0.002,
) -> JointTracking:
    """Design planner and observer for a schedule.

    The planned jerk is a share of what the fully open valve does at the slowest angle, below a
    limit for light joints; the planned acceleration is what a reserve of pressure difference does.

    Args:
        schedule: The joint over angle.
        jerk_share: Share of the valve's opening that a planned move may use, 0..1,
            dimensionless.
        jerk_limit: Largest planned jerk, in rad/s3, whatever the joint could do: what feedforward
            for a light joint gets wrong if its load is heavier than known must stay within what
            feedback corrects.
        observer_bandwidth: Poles of the observer, in rad/s.
        correction: Gains of the observer in SI, in place of poles.
        pressure_reserve: Pressure difference for accelerating, in Pa.
        mean_pressure: Mean gauge pressure at which limits are taken, in Pa.
        shortest: Shortest planned move, in s.
        lead: Time by which the opening of the feedforward leads the plan, in s: the lag of spool
            and sample, so that the move goes where it is planned.
        sample_time: Time between samples, in s.

    Returns:
        The front end of a controller.

    Raises:
        WorkbenchError: If a number is outside its range.

    Example:
        >>> rows = tuple((v, v) for v in (1.6e-4, 1.0, 100.0, 3.6e7, 6e5, 0.8, 0.0))
        >>> front = joint_tracking(JointSchedule(0.0, 1.0, rows, rows, 3e5, 4e5))
        >>> round(front.planner.jerk)
        1800
    """
    check_range("share of the opening for a planned move", jerk_share, 0.01, 1.0)
    check_range("pressure reserve", pressure_reserve, 1e3, 1e7, "Pa")
    check_range("lead of the feedforward", lead, 0.0, 0.1, "s")
    models = schedule.models(mean_pressure)
    planner = Planner(
        jerk=min(jerk_limit, jerk_share * min(m.opening_to_jerk for m in models)),
        acceleration=pressure_reserve * min(m.b for m in models),
        speed=jerk_share * min(m.g / m.e for m in models),
        shortest=shortest,
        sample_time=sample_time,
    )
    if correction is None:
        free = JointModel(b=1.0, a1=0.0, a0=0.0, g=1.0, e=0.0, d=0.0)
        correction = design_joint_observer(
            free, bandwidth=observer_bandwidth, sample_time=sample_time
        ).correction
    return JointTracking(schedule, planner, correction, sample_time=sample_time, lead=lead)


def kalman_correction(
    *,
    angle_noise: float = 2e-5,
    acceleration_noise: float = 0.5,
    acceleration_walk: float = 100.0,
    sample_time: float = 0.002,
) -> tuple[float, float, float]:
    """Compute the observer's gains as a stationary Kalman filter.

    The joint is a double integrator driven by the acceleration from the pressures, whose noise and
    whose unexplained part, a random walk, are given.

    Args:
        angle_noise: Noise rms of the measured angle, in rad.
        acceleration_noise: Noise rms of the acceleration from the pressures, in rad/s2.
        acceleration_walk: Random walk of the unexplained acceleration, rms over 1 s, in rad/s2.
        sample_time: Time between samples, in s.

    Returns:
        Gains for angle, speed and unexplained acceleration, in SI.

    Raises:
        WorkbenchError: If a number is outside its range.

    Source:
        Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, section 6.5.

    Example:
        >>> m = kalman_correction()
        >>> 0.0 < m[0] < 1.0
        True
    """
    import control as ct

    h = check_range("sample time", sample_time, 1e-6, 1.0, "s")
    for name, value, unit in (
        ("noise of the angle", angle_noise, "rad"),
        ("noise of the acceleration", acceleration_noise, "rad/s2"),
        ("walk of the acceleration", acceleration_walk, "rad/s2"),
    ):
        check_range(name, value, 1e-12, 1e9, unit)
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    phi, gamma = held(a, np.array([[0.0], [1.0], [0.0]]), h)
    drive = np.hstack([gamma, np.array([[0.0], [0.0], [1.0]])])
    noise = np.diag([acceleration_noise**2, acceleration_walk**2 * h])
    c = np.array([[1.0, 0.0, 0.0]])
    # One solver whether slycot is installed or not: the same gains on every machine.
    reading = [[angle_noise**2]]
    predictor = np.asarray(ct.dlqe(phi, drive, c, noise, reading, method="scipy")[0])
    # The law corrects before it predicts: the predictor's gain is phi times this one.
    gain = np.linalg.solve(phi, predictor).ravel()
    return float(gain[0]), float(gain[1]), float(gain[2])
