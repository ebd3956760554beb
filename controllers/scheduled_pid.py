"""Cascaded PID over the whole range: gains from the schedule, feedforward along a planned move.

With the plan (theta_r, omega_r, alpha_r), the feedforward dp_r and o_r of `joint_tracking`, the
error x = theta_r - theta and gains in units of acceleration, sample k:

    D[k] = f D[k-1] + (1 - f) kd (x[k] - x[k-1]) / h                    f = Tf / (Tf + h)
    a[k] = kp(theta) x[k] + I[k] + D[k]
    dp_w = dp_r + (a - c w_hat) / b(theta)
    o[k] = o_r + (omega_inner / g(theta)) (dp_w - dp - tau g l), clipped to -1..1; inverse curve
    I[k+1] = I[k] + h ki x[k] + (h / Tt) b (g / omega_inner) (o_clipped - o)

    kp = (1 + 2 a z) w^2 - a0(theta),  kd = (a + 2 z) w - a1(theta),  ki = a w^3

which places the joint's poles at frequency w and damping z and at a w, whatever the angle. A
share c of what the observer finds unexplained is compensated at once; the integral part does the
rest; tau g l is what the lag tau of spool and sample still holds
(`controllers.joint.tracking.arrived_opening`). I is an acceleration: when b moves with the angle
or another controller hands over, what it holds keeps its meaning (bumpless).

Source: Åström and Hägglund, Advanced PID Control, 2006, sections 3.3 to 3.5, 6.4, 9.3 (gain
scheduling), 12.3 (cascade).
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
from workbench.errors import check_range


@dataclass(frozen=True)
class ScheduledPID(ScheduledLaw):
    """Gain-scheduled cascade with planned reference and feedforward.

    Args:
        tracking: Planner, observer and schedule.
        frequency: Frequency w of the placed pair, in rad/s.
        damping: Its damping ratio z.
        real_pole: Real pole as a fraction a of w.
        inner_bandwidth: Bandwidth of the pressure-difference loop, in rad/s.
        derivative_filter: Time constant Tf, in s.
        tracking_time: Time constant Tt of the anti-windup, in s.
        compensation: Share c of the unexplained acceleration that is compensated at once, 0..1,
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
        WorkbenchError: If a number is outside its range.

    Example:
        >>> rows = tuple((v, v) for v in (1.6e-4, 1.0, 100.0, 3.6e7, 6e5, 0.8, 0.0))
        >>> front = joint_tracking(JointSchedule(0.0, 1.0, rows, rows, 3e5, 4e5))
        >>> pid = ScheduledPID(front)
        >>> pid.step(pid.initial_state((0.5, 3e5, 3e5)), (0.5, 3e5, 3e5), (0.5,))[0]
        (5.0,)
    """

    tracking: JointTracking
    frequency: float = 28.0
    damping: float = 0.8
    real_pole: float = 0.6
    inner_bandwidth: float = 120.0
    derivative_filter: float = 0.004
    tracking_time: float = 0.06
    compensation: float = 0.3
    lag: float = 0.0
    sample_time: float = 0.002
    valve: ValveInverse = ValveInverse()
    name: str = "cascade PID"
    sensors: tuple[str, ...] = ("angle", "pressure_1", "pressure_2")
    follows: tuple[str, ...] = ("angle",)
    actuators: tuple[str, ...] = ("valve",)
    preview: int = 0

    def __post_init__(self) -> None:
        """Check the gains."""
        h = check_range(f"sample time of {self.name}", self.sample_time, 1e-6, 1.0, "s")
        check_range(f"frequency of {self.name}", self.frequency, 0.1, 0.5 / h, "rad/s")
        check_range(f"inner bandwidth of {self.name}", self.inner_bandwidth, 1.0, 1 / h, "rad/s")
        check_range(f"tracking time of {self.name}", self.tracking_time, h, 1e3, "s")
        check_range(f"derivative filter of {self.name}", self.derivative_filter, 0.0, 1.0, "s")

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the entries of the state."""
        return (*STATE_NAMES, "integral", "derivative", "error", "arrived")

    def initial_state(
        self, measurement: tuple[Number, ...], arithmetic: Arithmetic = FLOATS
    ) -> tuple[Number, ...]:
        """Return the state that holds the measured pressure difference at the measured angle.

        Args:
            measurement: Angle in rad and the two gauge pressures in Pa.
            arithmetic: Floats or CasADi symbols.
        """
        front = self.tracking.start(measurement, arithmetic)
        # What the model does not explain is held by the integral part from the start.
        return (*front, -(1.0 - self.compensation) * front[10], 0.0, 0.0, 0.0)

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
            Voltage in V, next state, and the opening (fraction) and planned angle (rad).
        """
        h, w, a, z = self.sample_time, self.frequency, self.real_pole, self.damping
        look, front = self.tracking.look(state, measurement, reference[0], arithmetic)
        integral, derivative, last, arrived = state[len(front) :]
        joint = look.joint
        x = look.plan.angle - look.angle
        fade = self.derivative_filter / (self.derivative_filter + h)
        kd = arithmetic.largest((a + 2.0 * z) * w - joint.a1, 0.0)
        kp = arithmetic.largest((1.0 + 2.0 * a * z) * w * w - joint.a0, 0.0)
        derivative = fade * derivative + (1.0 - fade) * (x - last) / h
        acceleration = kp * x + integral + kd * derivative - self.compensation * look.unexplained
        inner = self.inner_bandwidth / joint.g
        wanted = look.wanted_difference + acceleration / joint.b
        opening = look.opening + inner * (wanted - look.difference - self.lag * joint.g * arrived)
        clipped = arithmetic.clip(opening, -1.0, 1.0)
        integral = integral + h * (
            a * w * w * w * x + joint.b * (clipped - opening) / (inner * self.tracking_time)
        )
        arrived = arrived_opening(arrived, clipped - look.opening, self.lag, h)
        command = self.valve.command(clipped, arithmetic)
        info = {"opening": clipped, "plan": look.plan.angle}
        return (command,), (*front, integral, derivative, x, arrived), info


def design_scheduled_pid(
    schedule: JointSchedule,
    *,
    jerk_share: float = 0.7,
    jerk_limit: float = 1800.0,
    lead: float = 0.0,
    frequency: float = 28.0,
    inner_bandwidth: float = 120.0,
    compensation: float = 0.3,
    lag: float = 0.0,
    sample_time: float = 0.002,
    valve: ValveInverse | None = None,
) -> ScheduledPID:
    """Design a scheduled cascade from a map of linear models.

    Args:
        schedule: The joint over angle and mean pressure, for the known load.
        jerk_share: Share of the valve's opening that a planned move may use, 0..1,
            dimensionless.
        jerk_limit: Largest planned jerk, in rad/s3.
        lead: Time by which the opening of the feedforward leads the plan, in s.
        frequency: Frequency of the placed pair, in rad/s.
        inner_bandwidth: Bandwidth of the pressure-difference loop, in rad/s.
        compensation: Share of the unexplained acceleration that is compensated at once, 0..1,
            dimensionless.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
        sample_time: Time between steps, in s.
        valve: Valve curve that is inverted.

    Returns:
        The controller.

    Raises:
        WorkbenchError: If a number is outside its range.

    Example:
        >>> rows = tuple((v, v) for v in (1.6e-4, 1.0, 100.0, 3.6e7, 6e5, 0.8, 0.0))
        >>> pid = design_scheduled_pid(JointSchedule(0.0, 1.0, rows, rows, 3e5, 4e5))
        >>> pid.frequency
        28.0
    """
    tracking = joint_tracking(
        schedule,
        jerk_share=jerk_share,
        jerk_limit=jerk_limit,
        lead=lead,
        correction=kalman_correction(sample_time=sample_time),
        sample_time=sample_time,
    )
    return ScheduledPID(
        tracking,
        frequency=frequency,
        inner_bandwidth=inner_bandwidth,
        compensation=compensation,
        lag=lag,
        sample_time=sample_time,
        valve=valve or ValveInverse(),
    )


SCHEDULED_PID = Design(
    name="scheduled-pid",
    family="cascade PID",
    summary="cascaded PID over the whole range, with planned moves and feedforward",
    function=design_scheduled_pid,
    needs="map",
    colour=("#0062a8", "#5db5f5"),
)
