"""Linear MPC over the whole range: one small quadratic program, its matrices on a schedule.

Along the plan, with the feedforward dp_r and o_r of `controllers.joint.tracking`, the errors of
angle x, speed v, acceleration-valued pressure difference y = b (dp_r - dp) and the integral q of x
obey the linear model of `controllers.state_feedback`. At each sample, over N prediction samples of
time T, the controller minimises over blocked moves u (deviations of the opening from o_r) and a
slack eps

    sum_j w^6 (x_j + z v_j / w + w_i q_j)^2 + (b g u_j)^2 + S (u_j - u_{j-1})^2 + |z_N|^2_P
        + softness eps^2
    subject to   -1 <= o_r + u_j <= 1,  |u_j - u_{j-1}| <= rate T                     (hard)
                 |dp_j| <= p_max - p_min + eps                                        (soft)

P is the cost to go of the unconstrained regulator. One valve commands the difference only, and the
mean drifts while the difference moves; the last condition holds for any mean. The integral in the
controlled output leads to the reference without offset, whatever the plant does at rest. The
matrices are condensed at every angle of the schedule and interpolated between them. If the solver
fails, the unconstrained regulator u = -K z, clipped, takes its place (fallback "regulator").

With a lag tau of spool and sample, y is that of the pressures tau later, y - tau b g l
(`controllers.joint.tracking.arrived_opening`). The planned reference is known over the horizon by
its own derivatives; no preview is needed.

Units: SI.

Source: Maciejowski, Predictive Control with Constraints, 2002, chapters 2 and 3; Rugh and Shamma,
Automatica 36, 2000 (scheduling).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controllers.arithmetic import FLOATS, SYMBOLS, Arithmetic, Number
from controllers.c_source import CSource, generated
from controllers.joint.schedule import JointSchedule
from controllers.joint.tracking import (
    JointTracking,
    TrackingSpecification,
    TrackingState,
    arrived_opening,
)
from controllers.mpc.c_text import mpc_source
from controllers.mpc.prediction import Prediction, condense
from controllers.mpc.whole_model import linear_mpc_design, told
from controllers.named_state import flat, names, restored
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.quadratic_program.solver import quadratic_program
from controllers.specification import number
from controllers.state_feedback import error_dynamics
from controllers.valve_inverse import ACTUATORS, SENSORS, ValveController
from workbench.arrays import Matrix, product
from workbench.errors import check_range


class ScheduledMPCState(NamedTuple):
    """What a `ScheduledMPC` remembers.

    Args:
        error_integral: Integral q of the error, in rad s.
        deviation: Opening beside the feedforward's applied last, a fraction.
        arrived: Opening that has arrived behind the lag, a fraction.
    """

    tracking: TrackingState
    error_integral: Number
    deviation: Number
    arrived: Number


class Errors(NamedTuple):
    """Errors of angle and speed, of the pressure difference as acceleration, and the integral q."""

    angle: Number
    speed: Number
    acceleration: Number
    integral: Number


class Problem(NamedTuple):
    """What the quadratic program of a `ScheduledMPC` is asked.

    Args:
        bias: Pressure difference at which the third error is zero, in Pa.
    """

    errors: Errors
    bias: Number
    opening: Number
    plan: Number


@dataclass(frozen=True, eq=False, repr=False)
class ScheduledMPC(ValveController):
    """Gain-scheduled linear MPC with planned reference.

    Args:
        predictions: Condensed problem at every angle of the schedule.
        compensation: Share of the unexplained acceleration that is compensated, a ratio.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
    """

    tracking: JointTracking
    predictions: tuple[Prediction, ...]
    pressure_limits: tuple[float, float]
    compensation: float = 0.3
    lag: float = 0.0
    name: str = "linear MPC"

    def initial_state(
        self, measurement: tuple[Number, ...], arithmetic: Arithmetic = FLOATS
    ) -> ScheduledMPCState:
        """Return the state of a joint at rest."""
        return ScheduledMPCState(self.tracking.start(measurement, arithmetic).state, 0.0, 0.0, 0.0)

    def step(
        self, state: ScheduledMPCState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, ScheduledMPCState, Info]:
        """Compute the valve voltage of one sample.

        Its information holds ``opening`` (fraction), ``plan`` (rad), ``status``, ``iterations``,
        ``solve_time`` (s), ``slack`` (Pa) and ``fallback`` (1 where the regulator acted).
        """
        problem, front = self.problem(state, measurement, reference[0], FLOATS)
        low, high, share = self._neighbours(measurement[0])

        def between(a: Matrix, b: Matrix) -> Matrix:
            return np.asarray(a + share * (b - a))

        before, z = state.deviation, np.array(problem.errors)
        gradient = product(between(low.g_estimate, high.g_estimate), z)
        gradient += low.g_before[:, 0] * before
        pressures = product(between(low.rows_estimate, high.rows_estimate), z)
        room = self.pressure_limits[1] - self.pressure_limits[0]
        (n, m), limits = low.size, np.array([low.lower, low.upper])
        limited = (m - n + 1) // 2
        limits[0, n - 1 : n - 1 + limited] = (problem.bias - room) / low.slack_scale
        limits[1, m - limited : m] = (problem.bias + room) / low.slack_scale
        limits[:, :m] -= pressures
        limits[:, 0] += before
        # The feedforward stays within the valve, so that the limits never cross the rate's.
        forward = min(max(problem.opening, -1.0), 1.0)
        limits[:, m:-1] -= forward
        lower, upper = limits
        reach = low.upper[0]
        lower[m] = min(lower[m], before + reach)
        upper[m] = max(upper[m], before - reach)
        solution = quadratic_program(n, m).solve(
            between(low.H, high.H), gradient, between(low.A, high.A), lower, upper
        )
        if solution.solved:
            move, slack = float(solution.x[0]), float(solution.x[-1]) * low.slack_scale
        else:
            gain = between(low.gain, high.gain)
            move, slack = -float(product(gain, z)[0]), float("nan")
        opening = min(max(forward + move, -1.0), 1.0)
        info = {**told((opening,), solution, slack), "plan": problem.plan}
        after = self.after(state, problem, front, opening, FLOATS)
        return (self.tracking.command(self.valve, after.tracking, opening),), after, info

    def _neighbours(self, angle: float) -> tuple[Prediction, Prediction, float]:
        """Return the predictions around an angle, and the share of the second."""
        schedule, count = self.tracking.schedule, len(self.predictions)
        i, share = FLOATS.place(angle, schedule.first_angle, schedule.spacing, count)
        return self.predictions[i], self.predictions[i + 1], min(max(share, 0.0), 1.0)

    def problem(
        self,
        state: ScheduledMPCState,
        measurement: tuple[Number, ...],
        reference: Number,
        arithmetic: Arithmetic,
    ) -> tuple[Problem, TrackingState]:
        """Return what the quadratic program is asked, and the next state of the front end."""
        now, front = self.tracking.context(state.tracking, measurement, reference, arithmetic)
        b = now.joint.b
        x = now.plan.angle - now.angle
        y = b * (now.reference_difference - now.difference) - self.compensation * now.unexplained
        y -= self.lag * b * now.joint.g * state.arrived
        bias = now.reference_difference - self.compensation * now.unexplained / b
        errors = Errors(x, now.plan.speed - now.speed, y, state.error_integral)
        return Problem(errors, bias, now.opening, now.plan.angle), front

    def after(
        self,
        state: ScheduledMPCState,
        problem: Problem,
        front: TrackingState,
        opening: Number,
        arithmetic: Arithmetic,
    ) -> ScheduledMPCState:
        """Return the state after a step that applied an opening, a fraction."""
        # At a stop of the valve, whatever the rounding, the integral waits.
        free = arithmetic.largest(opening, -opening) < 1.0 - 1e-9
        summed = arithmetic.where(free, self.sample_time * problem.errors.angle, 0.0)
        move = opening - arithmetic.clip(problem.opening, -1.0, 1.0)
        arrived = arrived_opening(state.arrived, move, self.lag, self.sample_time)
        front = self.tracking.sent(front, opening, arithmetic)
        return ScheduledMPCState(front, state.error_integral + summed, move, arrived)

    def linear_law(
        self,
        state: ScheduledMPCState,
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
        rest: Measurement,
    ) -> tuple[tuple[Number, ...], ScheduledMPCState]:
        """Return command and next state on symbols where no constraint is active, near rest.

        There the move is -(H^-1 (G z + g before))_0; its derivative by the angle through the
        interpolated H and G is taken at rest.
        """
        low, high, share = self._neighbours(rest[0])
        schedule = self.tracking.schedule
        H, G = (
            low.H + share * (high.H - low.H),
            low.g_estimate + share * (high.g_estimate - low.g_estimate),
        )
        at_rest, _ = self.problem(self.initial_state(rest), rest, reference[0], FLOATS)
        z_rest = np.array(at_rest.errors)
        x_rest = -np.linalg.solve(H, G @ z_rest)
        turned = (high.g_estimate - low.g_estimate) @ z_rest + (high.H - low.H) @ x_rest
        first = np.linalg.solve(H, np.eye(len(H)))[0]
        problem, front = self.problem(state, measurement, reference[0], arithmetic)
        share_now = (measurement[0] - rest[0]) / schedule.spacing
        if not schedule.angles[0] <= rest[0] <= schedule.angles[-1]:
            share_now = 0.0
        move = -(first @ low.g_before[:, 0]) * state.deviation - float(first @ turned) * share_now
        for gain, error in zip((first @ G).tolist(), problem.errors, strict=True):
            move = move - gain * error
        opening = arithmetic.clip(problem.opening, -1.0, 1.0) + move
        return (self.valve.tangent(opening),), self.after(
            state, problem, front, opening, arithmetic
        )

    def c_source(self, name: str) -> CSource:
        """Write the controller as C: tables over the angle, factored at every step."""
        first, schedule = self.predictions[0], self.tracking.schedule
        n, m = first.size
        tables: dict[str, Matrix] = {
            key: np.array([getattr(p, field) for p in self.predictions])
            for key, field in (
                ("HESSIAN", "H"),
                ("CONSTRAINT", "A"),
                ("G_ESTIMATE", "g_estimate"),
                ("ROWS_ESTIMATE", "rows_estimate"),
                ("GAIN", "gain"),
            )
        }
        tables |= {"G_BEFORE": first.g_before, "LOWER": first.lower, "UPPER": first.upper}
        kernels = self._kernels(name)
        args, results, integers, reals = (
            max(1, *(getattr(kernel, f"sz_{what}")() for kernel in kernels))
            for what in ("arg", "res", "iw", "w")
        )
        states = names(self.initial_state((0.0, 0.0, 0.0)))
        front = int(kernels[1].numel_out(2))
        return mpc_source(
            name,
            "along_plan.c",
            curves=(self.valve,),
            actuators=self.actuators,
            size=(n, m),
            factor=True,
            defined={
                "SENSORS": len(self.sensors),
                "STATES": len(states),
                "FRONT_STATES": front,
                "DEVIATION": states.index("deviation"),
                **self._learned(states),
                "MOVES": n - 1,
                "LIMITED": (m - n + 1) // 2,
                "ANGLES": len(self.predictions),
                "FIRST_ANGLE": schedule.first_angle,
                "SPACING": schedule.spacing,
                "ROOM": self.pressure_limits[1] - self.pressure_limits[0],
                "SLACK_SCALE": first.slack_scale,
                "KERNEL_ARG": args,
                "KERNEL_RES": results,
                "KERNEL_IW": integers,
                "KERNEL_W": reals,
                "START_KERNEL": f"{name}_start_kernel",
                "FRONT_KERNEL": f"{name}_front_kernel",
                "AFTER_KERNEL": f"{name}_after_kernel",
            },
            tables=tables,
            states=states,
            generated=generated(name, *kernels),
            work=(2 * n * n + m * n + (n + m) * (n + 3) + 5 * m + 6 * n + 4)
            + (7 + len(states) + front + args + results + integers + reals),
            prepared=sum(kernel.n_instructions() for kernel in kernels[1:])
            + n**3
            + 2 * m * n * n
            + 2 * (n + m) * n
            + (m + n) * (n + 8),
        )

    def _learned(self, states: tuple[str, ...]) -> dict[str, int]:
        """Return where the opening at rest stands, if the valve's centre is learned."""
        if not self.tracking.centring:
            return {}
        found = {"LEARNED": "opening", "KNOWN": "known"}
        return {name: states.index(f"tracking.rest.{entry}") for name, entry in found.items()}

    def _kernels(self, name: str) -> tuple[ca.Function, ca.Function, ca.Function]:
        """Trace the start, the front end (errors; bias, opening, plan; its state) and the end."""
        m, r = ca.SX.sym("measurement", len(self.sensors)), ca.SX.sym("reference", 1)
        measured = tuple(ca.vertsplit(m))
        begin = self.initial_state(measured, SYMBOLS)
        z, opening = ca.SX.sym("state", len(flat(begin))), ca.SX.sym("opening")
        state = restored(begin, ca.vertsplit(z))
        problem, front = self.problem(state, measured, r, SYMBOLS)
        parts = (problem.errors, tuple(problem[1:]), front)
        asked = [ca.SX.sym("given", len(flat(part))) for part in parts]
        errors = restored(problem.errors, ca.vertsplit(asked[0]))
        others, following = ca.vertsplit(asked[1]), restored(front, ca.vertsplit(asked[2]))
        after = self.after(state, Problem(errors, *others), following, opening, SYMBOLS)

        def kernel(what: str, inputs: list[ca.SX], *outputs: Any) -> ca.Function:
            columns = [ca.densify(ca.vcat(flat(output))) for output in outputs]
            return ca.Function(f"{name}_{what}_kernel", inputs, columns)

        return (
            kernel("start", [m], begin),
            kernel("front", [z, m, r], *parts),
            kernel("after", [z, *asked, opening], after),
        )


@dataclass(frozen=True, kw_only=True)
class ScheduledMPCSpecification(TrackingSpecification):
    """What a linear MPC over the whole range is designed for.

    Args:
        radius: Radius w of the unconstrained closed-loop poles, in rad/s.
        integral: Speed w_i of the integral action as a fraction of the radius.
        damping: Weight z of the speed beside the angle, dimensionless: what swings is damped more.
        move_weight: Weight of a change of the opening against one of the opening, a ratio.
        compensation: Share of the unexplained acceleration that is compensated, 0..1,
            dimensionless.
        lag: Lag of spool and sample that is predicted over, in s; 0 leaves it to the margin.
        prediction_time: Time T between prediction samples, in s; rounded to whole ones of the loop.
        blocks: Lengths of the blocked moves, in prediction samples; their sum is N.
        rate_limit: Fastest change of the opening, per s.
        pressure_limits: Lowest and highest gauge pressure, in Pa.
        softness: Cost of a pressure difference 0.1 bar out of its limits, dimensionless.
    """

    radius: float = 45.0
    integral: float = number(0.27, 1e-3, 1.0, words="speed of the integral action")
    damping: float = number(0.0, 0.0, 100.0, words="weight of the speed")
    move_weight: float = 0.02
    compensation: float = 0.3
    lag: float = 0.0
    prediction_time: float = 0.004
    blocks: tuple[int, ...] = (1, 1, 1, 2, 3, 4, 8)
    rate_limit: float = 200.0
    pressure_limits: tuple[float, float] = (0.1e5, 5.95e5)
    softness: float = 1e2

    def __post_init__(self) -> None:
        super().__post_init__()
        h = self.sample_time
        check_range("radius of the poles", self.radius, 0.1, 0.5 / h, "rad/s")
        check_range("prediction time", self.prediction_time, h, 10.0, "s")
        self.in_samples("prediction_time", h)
        low, high = self.pressure_limits
        check_range("highest pressure", high, low, 1e8, "Pa", fix="it lies above the lowest")


def design_scheduled_mpc(
    schedule: JointSchedule, specification: ScheduledMPCSpecification | None = None
) -> ScheduledMPC:
    """Design a scheduled MPC from a map of linear models, for its load.

    Raises:
        WorkbenchError: If a Riccati equation has no solution.
    """
    want = specification or ScheduledMPCSpecification()
    w, speed = want.radius, want.radius * want.integral
    predictions = []
    for joint in schedule.models(want.mean_pressure):
        A, B = error_dynamics(joint)
        # The limited output is the pressure difference's error, in Pa.
        C = np.array([[1.0, want.damping / w, 0.0, speed], [0.0, 0.0, 1.0 / joint.b, 0.0]])
        predictions.append(
            condense(
                A,
                B,
                np.zeros((4, 0)),
                C,
                weights=(w**6 / joint.opening_to_jerk**2, 1.0, want.move_weight),
                prediction_time=want.prediction_time,
                sample_time=want.sample_time,
                blocks=want.blocks,
                opening_limits=(-1.0, 1.0),
                move_limit=want.rate_limit * want.prediction_time,
                output_limits=((0.0, 0.0),),
                softness=want.softness,
            )
        )
    return ScheduledMPC(
        want.tracking(schedule),
        tuple(predictions),
        want.pressure_limits,
        compensation=want.compensation,
        lag=want.lag,
        sample_time=want.sample_time,
    )


SCHEDULED_MPC = linear_mpc_design(
    name="scheduled-mpc",
    summary="linear MPC over the whole range, along planned moves",
    function=design_scheduled_mpc,
    needs="map",
    specification=ScheduledMPCSpecification,
    sensors=SENSORS,
    actuators=ACTUATORS,
)
