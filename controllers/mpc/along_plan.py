"""Linear MPC over the whole range: one small quadratic program, its matrices on a schedule.

Along the plan, with the feedforward dp_r and o_r of `joint_tracking`, the errors of angle x, speed
v, acceleration-valued pressure difference y = b (dp_r - dp) and the integral q of x obey the linear
model of `scheduled_state_feedback`. At each sample, over N prediction samples of time T, the
controller minimises over blocked moves u (deviations of the opening from o_r) and a slack eps

    sum_j w^6 (x_j + w_i q_j)^2 + (b g u_j)^2 + S (u_j - u_{j-1})^2 + |z_N|^2_P
        + softness (eps + eps^2)
    subject to   -1 <= o_r + u_j <= 1,  |u_j - u_{j-1}| <= rate T                     (hard)
                 |dp_j| <= p_max - p_min + eps                                        (soft)

P is the cost to go of the unconstrained regulator. One valve commands the difference only, and the
mean drifts while the difference moves; the last condition holds for any mean. The integral in the
followed output leads to the reference without offset, whatever the plant does at rest. The matrices
are condensed at every angle of the schedule and interpolated between them. If the solver fails, the
unconstrained regulator u = -K z, clipped, takes its place (fallback "regulator"). A reading or
reference that is no number leaves the state as it was and shuts the valve for the sample (fallback
"shut").

With a lag tau of spool and sample, y is that of the pressures tau later, y - tau b g l
(`controllers.joint.tracking.arrived_opening`). The planned reference is known over the horizon by
its own derivatives; no preview is needed.

Source: Maciejowski, Predictive Control with Constraints, 2002, chapters 2 and 3; Rugh and Shamma,
Automatica 36, 2000 (scheduling).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

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
from controllers.mpc.fixed_order import product
from controllers.mpc.prediction import Prediction, condense
from controllers.mpc.whole_model import not_finite
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.quadratic_program.solver import quadratic_program
from controllers.through_valve import ThroughValve
from controllers.valve_inverse import ValveInverse
from workbench.errors import check_range

Matrix = npt.NDArray[np.float64]


class Front(NamedTuple):
    """What the quadratic program of a `ScheduledMPC` is asked.

    Args:
        errors: Errors of angle (rad), speed (rad/s) and acceleration-valued pressure difference
            (rad/s2), and the integral of the first (rad s).
        bias: Pressure difference at which the third error is zero, in Pa.
        opening: Opening of the feedforward, a fraction.
        plan: Planned angle, in rad.
    """

    errors: tuple[Number, Number, Number, Number]
    bias: Number
    opening: Number
    plan: Number


@dataclass(frozen=True, eq=False)
class ScheduledMPC(ThroughValve):
    """Gain-scheduled linear MPC with planned reference.

    Args:
        tracking: Planner, observer and schedule.
        predictions: Condensed problem at every angle of the schedule.
        pressure_limits: Lowest and highest gauge pressure, in Pa.
        compensation: Share of the unexplained acceleration that is compensated, 0..1,
            dimensionless.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
        sample_time: Time between steps, in s.
        valve: Valve curve that is inverted.
        name: Name under which results are reported.
        sensors: Names of the angle and the two pressures.
        follows: Name of the followed output.
        actuators: Name of the command.
        preview: No future references are used.

    Example:
        >>> ScheduledMPC.__dataclass_fields__["name"].default
        'linear MPC'
    """

    tracking: JointTracking
    predictions: tuple[Prediction, ...]
    pressure_limits: tuple[float, float]
    compensation: float = 0.3
    lag: float = 0.0
    sample_time: float = 0.002
    valve: ValveInverse = field(default_factory=ValveInverse)
    name: str = "linear MPC"
    sensors: tuple[str, ...] = ("angle", "pressure_1", "pressure_2")
    follows: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the entries of the state."""
        return (*STATE_NAMES, "error_integral", "deviation", "arrived")

    def initial_state(self, measurement: Measurement) -> tuple[float, ...]:
        """Return the state of a joint at rest.

        Args:
            measurement: Angle in rad and the two gauge pressures in Pa.

        Returns:
            State in the order of its names, in SI.
        """
        return (*self.tracking.start(measurement), 0.0, 0.0, 0.0)

    def step(
        self, state: tuple[float, ...], measurement: Measurement, reference: Reference
    ) -> tuple[Command, tuple[float, ...], Info]:
        """Compute the valve voltage of one sample.

        Args:
            state: State of the step before, a tuple of numbers in SI.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.

        Returns:
            Voltage in V, next state, and ``opening`` (fraction), ``plan`` (rad), ``status``,
            ``iterations``, ``solve_time`` (s), ``slack`` (Pa) and ``fallback`` (1 where the
            regulator acted or the valve was shut).
        """
        if not all(map(math.isfinite, (*measurement, reference[0]))):
            return (self.valve.command(0.0),), state, {**not_finite(0.0), "plan": math.nan}
        front, following = self.front(state, measurement, reference[0], FLOATS)
        schedule = self.tracking.schedule
        i, share = FLOATS.place(
            measurement[0], schedule.first_angle, schedule.spacing, len(self.predictions)
        )
        share = min(max(share, 0.0), 1.0)
        low, high = self.predictions[i], self.predictions[i + 1]

        def between(a: Matrix, b: Matrix) -> Matrix:
            return np.asarray(a + share * (b - a))

        _, before, _ = state[len(following) :]
        z = np.array(front.errors)
        gradient = product(between(low.g_estimate, high.g_estimate), z) + low.g_before * before
        pressures = product(between(low.rows_estimate, high.rows_estimate), z)
        n_u = low.size[0] - 1
        room = self.pressure_limits[1] - self.pressure_limits[0]
        lower_a, upper_a = low.lower_a.copy(), low.upper_a.copy()
        limited = (len(lower_a) - n_u) // 2
        lower_a[n_u : n_u + limited] = (front.bias - room) / low.slack_scale
        upper_a[n_u + limited :] = (front.bias + room) / low.slack_scale
        lower_a -= pressures
        upper_a -= pressures
        lower_a[0] += before
        upper_a[0] += before
        lower_x, upper_x = low.lower_x.copy(), low.upper_x.copy()
        # The feedforward stays within the valve, so that the limits never cross the rate's.
        forward = min(max(front.opening, -1.0), 1.0)
        lower_x[:n_u] -= forward
        upper_x[:n_u] -= forward
        reach = low.upper_a[0]
        lower_x[0] = min(lower_x[0], before + reach)
        upper_x[0] = max(upper_x[0], before - reach)
        solution = quadratic_program(*low.size).solve(
            between(low.H, high.H),
            gradient,
            between(low.A, high.A),
            lower_a,
            upper_a,
            lower_x,
            upper_x,
        )
        if solution.solved:
            move, slack = float(solution.x[0]), float(solution.x[-1]) * low.slack_scale
        else:
            gain = between(low.gain, high.gain)[None, :]
            move, slack = -float(product(gain, z)[0]), float("nan")
        opening = min(max(forward + move, -1.0), 1.0)
        info: dict[str, float | str] = {
            "opening": opening,
            "plan": front.plan,
            "status": solution.status,
            "iterations": solution.iterations,
            "solve_time": solution.seconds,
            "slack": slack,
            "fallback": 0.0 if solution.solved else 1.0,
        }
        after = self.after(state, front, following, opening, FLOATS)
        return (self.valve.command(opening),), after, info

    def front(
        self,
        state: tuple[Number, ...],
        measurement: tuple[Number, ...],
        reference: Number,
        arithmetic: Arithmetic,
    ) -> tuple[Front, tuple[Number, ...]]:
        """Plan, estimate, and compute what the quadratic program is asked.

        Args:
            state: State of the step before, in SI.
            measurement: Angle in rad and the two gauge pressures in Pa.
            reference: Wanted angle, in rad.
            arithmetic: Floats or CasADi symbols.

        Returns:
            What the quadratic program needs, and the next state of the front end, in SI.
        """
        look, following = self.tracking.look(state, measurement, reference, arithmetic)
        q, _, arrived = state[len(following) :]
        b = look.joint.b
        x = look.plan.angle - look.angle
        y = b * (look.wanted_difference - look.difference) - self.compensation * look.unexplained
        y -= self.lag * b * look.joint.g * arrived
        bias = look.wanted_difference - self.compensation * look.unexplained / b
        errors = (x, look.plan.speed - look.speed, y, q)
        return Front(errors, bias, look.opening, look.plan.angle), following

    def after(
        self,
        state: tuple[Number, ...],
        front: Front,
        following: tuple[Number, ...],
        opening: Number,
        arithmetic: Arithmetic,
    ) -> tuple[Number, ...]:
        """Return the state after a step.

        Args:
            state: State of the step before, in SI.
            front: What `front` returned.
            following: The next state of the front end, in SI.
            opening: Opening applied, a fraction.
            arithmetic: Floats or CasADi symbols.

        Returns:
            State in the order of its names, in SI.
        """
        q, _, arrived = state[len(following) :]
        # At a stop of the valve, whatever the rounding, the integral waits.
        free = arithmetic.largest(opening, -opening) < 1.0 - 1e-9
        q = q + arithmetic.where(free, self.sample_time * front.errors[0], 0.0)
        move = opening - arithmetic.clip(front.opening, -1.0, 1.0)
        arrived = arrived_opening(arrived, move, self.lag, self.sample_time)
        return (*following, q, move, arrived)


def design_scheduled_mpc(
    schedule: JointSchedule,
    *,
    radius: float = 45.0,
    integral: float = 0.27,
    move_weight: float = 0.02,
    jerk_share: float = 0.7,
    jerk_limit: float = 1800.0,
    lead: float = 0.0,
    compensation: float = 0.3,
    lag: float = 0.0,
    prediction_time: float = 0.004,
    blocks: tuple[int, ...] = (1, 1, 1, 2, 3, 4, 8),
    rate_limit: float = 200.0,
    pressure_limits: tuple[float, float] = (0.1e5, 5.95e5),
    softness: float = 1e2,
    mean_pressure: float = 3.8e5,
    sample_time: float = 0.002,
    valve: ValveInverse | None = None,
) -> ScheduledMPC:
    """Design a scheduled MPC from a map of linear models.

    Args:
        schedule: The joint over angle and mean pressure, for the known load.
        radius: Radius w of the unconstrained closed-loop poles, in rad/s.
        integral: Speed w_i of the integral action as a fraction of the radius.
        move_weight: Weight of a change of the opening against one of the opening, a ratio.
        jerk_share: Share of the valve's opening that a planned move may use, 0..1,
            dimensionless.
        jerk_limit: Largest planned jerk, in rad/s3.
        lead: Time by which the opening of the feedforward leads the plan, in s.
        compensation: Share of the unexplained acceleration that is compensated, 0..1,
            dimensionless.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
        prediction_time: Time T between prediction samples, in s; a multiple of ``sample_time``.
        blocks: Lengths of the blocked moves, in prediction samples; their sum is N.
        rate_limit: Fastest change of the opening, per s.
        pressure_limits: Lowest and highest gauge pressure, in Pa.
        softness: Cost of a pressure difference 0.1 bar out of its limits, dimensionless.
        mean_pressure: Mean gauge pressure of the design, in Pa.
        sample_time: Time between steps, in s.
        valve: Valve curve that is inverted.

    Returns:
        The controller.

    Raises:
        WorkbenchError: If a number is outside its range or a Riccati equation has no solution.

    Example:
        >>> rows = tuple((v, v) for v in (1.6e-4, 1.0, 100.0, 3.6e7, 6e5, 0.8, 0.0))
        >>> mpc = design_scheduled_mpc(JointSchedule(0.0, 1.0, rows, rows, 3e5, 4e5))
        >>> at_rest = (0.5, 3e5, 3e5)
        >>> round(mpc.step(mpc.initial_state(at_rest), at_rest, (0.5,))[0][0], 6)
        5.0
    """
    h = check_range("sample time", sample_time, 1e-6, 1.0, "s")
    w = check_range("radius of the poles", radius, 0.1, 0.5 / h, "rad/s")
    speed = w * check_range("speed of the integral action", integral, 1e-3, 1.0)
    check_range("prediction time", prediction_time, h, 10.0, "s")
    low, high = pressure_limits
    check_range("highest pressure", high, low, 1e8, "Pa", fix="it lies above the lowest")
    predictions = []
    for joint in schedule.models(mean_pressure):
        jerk = joint.opening_to_jerk
        A = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [-joint.a0, -joint.a1, 1.0, 0.0],
                [0.0, -joint.e * joint.b, -joint.d, 0.0],
                [1.0, 0.0, 0.0, 0.0],
            ]
        )
        # The limited output is the pressure difference's error, in Pa.
        C = np.array([[1.0, 0.0, 0.0, speed], [0.0, 0.0, 1.0 / joint.b, 0.0]])
        predictions.append(
            condense(
                A,
                np.array([[0.0], [0.0], [-jerk], [0.0]]),
                np.zeros((4, 0)),
                C,
                weights=(w**6 / jerk**2, 1.0, move_weight),
                prediction_time=prediction_time,
                stride=max(1, round(prediction_time / h)),
                blocks=blocks,
                opening_limits=(-1.0, 1.0),
                move_limit=rate_limit * prediction_time,
                output_limits=((0.0, 0.0),),
                softness=softness,
            )
        )
    return ScheduledMPC(
        joint_tracking(
            schedule,
            jerk_share=jerk_share,
            jerk_limit=jerk_limit,
            lead=lead,
            correction=kalman_correction(sample_time=h),
            mean_pressure=mean_pressure,
            sample_time=h,
        ),
        tuple(predictions),
        (low, high),
        compensation=compensation,
        lag=lag,
        sample_time=h,
        valve=valve or ValveInverse(),
    )


SCHEDULED_MPC = Design(
    name="scheduled-mpc",
    family="linear MPC",
    summary="linear MPC over the whole range, along planned moves",
    function=design_scheduled_mpc,
    needs="map",
    solves=True,
    colour=("#00805c", "#36d6a4"),
)
