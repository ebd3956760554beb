"""State feedback with integral action (LQI) over the whole range, with a Kalman filter.

Along the plan, with the feedforward dp_r and o_r of `controllers.joint.tracking`, the errors of
angle x, speed v, pressure difference y and the integral q obey, at every angle of the schedule,

    dx/dt = v,   dv/dt = -a0 x - a1 v + b y,   dy/dt = -g (o - o_r) - e v - d y,   dq/dt = x

The gain K(theta) minimises, for the sampled system, the sum of

    (w^3 x)^2 + (w_i w^3 q)^2 + (w_p b y)^2 + (b g (o - o_r))^2

in which the opening counts as the jerk it makes: without stiffness, and with w_p = 0, the poles are
a Butterworth pattern of radius w. Where a margin keeps w low, pressures that follow at w_p are
worth having all the same: what the valve does wrong does not reach the joint. Sample k:

    y    = dp_r - w_hat / b - dp            what the observer finds unexplained is compensated
    o[k] = o_r - K(theta) (x, v, y, q), clipped to -1..1, then the inverse curve
    q[k+1] = q[k] + h x[k] unless the valve is fully open

Where the loop is fast beside the spool, as with the empty arm, the lag tau of spool and sample is a
state of the design: dl/dt = (o - o_r - l) / tau, with l in the place of o - o_r in the equation of
y, and a fifth gain. The controller computes l from its own openings, so that it does not ask again
for what is on its way.

Gains are straight lines between the angles. Speed and w_hat come from a stationary Kalman filter of
the joint as a double integrator with a random-walk acceleration.

Source: Kwakernaak and Sivan, Linear Optimal Control Systems, 1972, sections 3.4, 3.7, 4.4;
Rugh and Shamma, Automatica 36, 2000 (scheduling).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controllers.arithmetic import FLOATS, Arithmetic, Number, Numbers, Told
from controllers.joint.model import JointModel
from controllers.joint.schedule import JointSchedule
from controllers.joint.tracking import (
    Context,
    JointTracking,
    TrackedLaw,
    TrackingSpecification,
    TrackingState,
    arrived_opening,
)
from controllers.riccati import regulator
from controllers.specification import number
from controllers.valve_inverse import joint_design
from workbench.arrays import Matrix
from workbench.errors import check_range
from workbench.linearisation.zero_order_hold import zero_order_hold


class StateFeedbackState(NamedTuple):
    """What a `StateFeedback` remembers.

    Args:
        error_integral: Integral q of the error, in rad s.
        arrived: Opening that has arrived behind the lag, a fraction.
    """

    tracking: TrackingState
    error_integral: Number
    arrived: Number


@dataclass(frozen=True, repr=False)
class StateFeedback(TrackedLaw):
    """Gain-scheduled LQI with planned reference and Kalman filter.

    Args:
        gains: Gains over the schedule's angles for angle (per rad), speed (s/rad), pressure
            difference (per Pa), integral (per rad s) and, if there is a lag, the opening that has
            arrived: 4 or 5 rows.
        compensation: Share of the unexplained acceleration that is compensated, a ratio.
        lag: Lag tau of spool and sample in the design, in s; 0 leaves it to the margin.
    """

    tracking: JointTracking
    gains: tuple[tuple[float, ...], ...]
    compensation: float = 1.0
    lag: float = 0.0
    name: str = "state feedback"

    def initial_state(
        self, measurement: Numbers, arithmetic: Arithmetic = FLOATS
    ) -> StateFeedbackState:
        return StateFeedbackState(self.tracking.start(measurement, arithmetic).state, 0.0, 0.0)

    def feedback(
        self, state: StateFeedbackState, now: Context, arithmetic: Arithmetic
    ) -> tuple[Number, StateFeedbackState, Told]:
        schedule = self.tracking.schedule
        place = arithmetic.place(
            now.angle, schedule.first_angle, schedule.spacing, len(self.gains[0])
        )
        inside = (place[0], arithmetic.clip(place[1], 0.0, 1.0))
        k = [arithmetic.between(inside, row) for row in self.gains]
        x = now.plan.angle - now.angle
        v = now.plan.speed - now.speed
        unexplained = self.compensation * now.unexplained / now.joint.b
        y = now.reference_difference - unexplained - now.difference
        asked = k[0] * x + k[1] * v + k[2] * y + k[3] * state.error_integral
        if self.lag > 0.0:
            asked = asked + k[4] * state.arrived
        opening = now.opening - asked
        clipped = arithmetic.clip(opening, -1.0, 1.0)
        free = arithmetic.where(arithmetic.largest(opening, -opening) < 1.0, 1.0, 0.0)
        sent = clipped - now.opening
        following = state._replace(
            error_integral=state.error_integral + free * self.sample_time * x,
            arrived=arrived_opening(state.arrived, sent, self.lag, self.sample_time),
        )
        return clipped, following, {}


def error_dynamics(joint: JointModel) -> tuple[Matrix, Matrix]:
    """Return A, shape (4, 4), and B of the errors (x, v, b y, q) along the plan, in SI.

    The input is the opening. The pressure difference counts in units of the acceleration it makes,
    so that every state is of similar size.
    """
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-joint.a0, -joint.a1, 1.0, 0.0],
            [0.0, -joint.e * joint.b, -joint.d, 0.0],
            [1.0, 0.0, 0.0, 0.0],
        ]
    )
    return A, np.array([[0.0], [0.0], [-joint.opening_to_jerk], [0.0]])


@dataclass(frozen=True, kw_only=True)
class StateFeedbackSpecification(TrackingSpecification):
    """What a state feedback over the whole range is designed for.

    Args:
        radius: Radius w of the closed-loop poles, in rad/s.
        integral: Speed w_i of the integral action as a fraction of the radius.
        compensation: Share of the unexplained acceleration that is compensated, 0..1,
            dimensionless.
        pressure_speed: Speed w_p at which the pressure difference follows at least, in rad/s; 0
            leaves it to the radius.
        lag: Lag of spool and sample that is a state of the design, in s; 0 for none.
    """

    radius: float = 45.0
    integral: float = number(0.33, 1e-3, 1.0, words="speed of the integral action")
    compensation: float = 0.3
    pressure_speed: float = number(0.0, 0.0, 1e3, "rad/s", "speed of the pressures")
    lag: float = number(0.0, 0.0, 0.1, "s", "lag of spool and sample")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("radius of the poles", self.radius, 0.1, 0.5 / self.sample_time, "rad/s")


def design_state_feedback(
    schedule: JointSchedule, specification: StateFeedbackSpecification | None = None
) -> StateFeedback:
    """Design LQI gains over the schedule and the Kalman filter, for the load of the schedule."""
    want = specification or StateFeedbackSpecification()
    w, lag = want.radius, want.lag
    speed = w * want.integral
    columns = []
    for joint in schedule.models(want.mean_pressure):
        a, b = error_dynamics(joint)
        weight = np.diag([w**6, 0.0, want.pressure_speed**2, (speed * w**3) ** 2])
        if lag > 0.0:
            a = np.block([[a, b], [np.zeros((1, 4)), np.array([[-1.0 / lag]])]])
            b = np.vstack([np.zeros((4, 1)), [[1.0 / lag]]])
            weight = np.pad(weight, (0, 1))
        phi, gamma = zero_order_hold(a, b, want.sample_time)
        cost = [[joint.opening_to_jerk**2]]
        gain = regulator(phi, gamma, weight, cost)[0].ravel()
        gain[2] *= joint.b
        columns.append(gain)
    return StateFeedback(
        want.tracking(schedule),
        tuple(tuple(row) for row in np.array(columns).T.tolist()),
        compensation=want.compensation,
        lag=lag,
        sample_time=want.sample_time,
    )


STATE_FEEDBACK = joint_design(
    name="scheduled-state-feedback",
    family="state feedback",
    summary="state feedback with integral action and a Kalman filter, over the whole range",
    function=design_state_feedback,
    needs="map",
    specification=StateFeedbackSpecification,
)
