"""Nonlinear model-predictive control by real-time iteration, on the valve opening.

The prediction is the regularised form of a plant's model, not its linearisation: the flow that
depends on the pressures, the volumes that change, the moment arms. At each sample an extended
Kalman filter corrects states x and disturbances w on the rates of some states; with as many of them
as sensors the estimate at rest agrees with every measurement, so that nothing is left over (no
offset). It estimates parameters too that nobody measures, such as the supply. Then

    sum_j q (y_j - r_j)^2 + v (dy/dt_j - dr/dt_j)^2 + S (u_j - u_{j-1})^2 + softness (eps + eps^2)
    subject to   x_{j+1} = F(x_j, u_j, w_j),   j = 0 .. N - 1,   x_0 = the estimate
                 |u_j| <= limit                                   (opening, hard)
                 p_min - eps <= pressures_j <= p_max + eps        (soft: a measurement may be out)

with the disturbances w_j that last (torque and parameters) or fade (rates of the other states),
is improved by one Gauss-Newton step per sample from the plan of the sample before (multiple
shooting; the states of all stages are eliminated and a dense quadratic program in the N moves and
eps is left). The plan converges over the samples while the plant moves on. The first move is
applied through the inverse valve curve: an optimiser of the voltage would see almost no gradient at
the valve's flat centre. If the solver fails, the plan of the sample before is followed; if the
estimate runs away, the filter starts anew from what is measured. Both count as fallbacks.

Without preview the reference is continued over the horizon by two lags or by a planner
(`controllers.reference.horizon`); with preview r_j is the reference itself.

It costs many times what the scheduled linear MPC costs per sample, is not exported as C, and is not
better on moves within the range: take it where the model changes much over a move or limits on the
pressures decide, with ``compile_function``, and inside a guard with a ``deadline``
(`workbench.verification.guarded`), which holds the command of a step that took longer. Elsewhere
take the scheduled MPC. Do not take it where commands come late: one sample makes it oscillate by
several degrees on the empty arm, for its prediction knows of no latency.

Source: Diehl, Bock, Schloeder, A real-time iteration scheme for nonlinear optimization in optimal
feedback control, SIAM J. Control Optim. 43, 2005; Rawlings, Mayne and Diehl, Model Predictive
Control, 2017, chapters 1.5 (offset-free), 4.2 (extended Kalman filter) and 8.7 (condensing).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from controllers.nonlinear_mpc.observer import ExtendedKalmanFilter
from controllers.nonlinear_mpc.prediction import (
    Compile,
    Dynamics,
    discrete,
    dynamics,
    measurements,
    shooting,
)
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.quadratic_program.solver import Solution, quadratic_program
from controllers.reference.horizon import ReferenceAhead
from controllers.reference.planned import Planner
from controllers.specification import Checked, number
from controllers.valve_inverse import SENSORS, ValveController, joint_design
from workbench.arrays import Matrix
from workbench.computing.buffered import Buffered
from workbench.errors import WorkbenchError, check_choice, check_range
from workbench.linearisation.actuator_inverse import straightened
from workbench.model import Model

_UNIT_PRESSURE = 1e5

FORGETTING = 10.0
"""Time over which an unknown parameter may change as far as it is off at the start, in s."""

RESTING = ("spool", "spool_speed")
"""States that are too fast for the prediction."""

START_RATE = 0.3
"""How far a disturbed rate is off at the start, relative to its random walk over one second."""


@dataclass(frozen=True)
class NonlinearMPCSpecification(Checked):
    """What a `NonlinearMPC` is designed for.

    Args:
        angle_scale: Angle error that weighs 1, in rad.
        speed_scale: Error of the speed that weighs 1, in rad/s. A larger one settles faster, and
            overshoots more where the load is not the one that the model has.
        move_scale: Change of the opening from stage to stage that weighs 1, a fraction.
        stages: Number N of stages of the horizon.
        stage_time: Length of a stage, in s; rounded to whole samples.
        steps: Runge-Kutta steps per stage; next to the supply a full opening answers within 1 ms.
        opening_limit: Largest opening, a fraction.
        pressure_limits: Lowest and highest gauge pressure, in Pa. An upper limit next to the supply
            costs accuracy where a move or holding needs more; by default it is above.
        softness: Cost of a pressure 1 bar out of its limits (dimensionless).
        torque_walk: Random walk of the disturbing torque on the joint over one second, in N m.
        disturbances: Other states whose rates are disturbed, each with its random walk over one
            second, in the state's SI unit per second. With the torque as many as sensors: no
            offset.
        fading_time: Time constant with which these other disturbances fade over the horizon, in s.
            They are estimated within some samples: held over the horizon, their noise would
            integrate to pressures at the limits.
        unknown: Parameters of the model that are estimated, each with how far it is off, rms in its
            SI unit.
        sensor_noise: Noise rms of angle (rad) and pressures (Pa).
        state_noise: Random walk of every state over one second, as a fraction of its scale.
        reference_speed: Speed omega_r of the reference's lags, in rad/s; not used with preview or
            a planner.
        planner: Planner of the reference in place of the lags; not used with preview.
        preview: Whether the future reference over the horizon is used.
        sample_time: Time between steps, in s.
    """

    angle_scale: float = number(0.01, 1e-9, 1e9)
    speed_scale: float = number(0.16, 1e-9, 1e9)
    move_scale: float = number(0.15, 1e-9, 1e9)
    stages: int = number(20, 2, 200, words="number of stages")
    stage_time: float = 0.02
    steps: int = number(8, 1, 1000, words="Runge-Kutta steps per stage")
    opening_limit: float = number(1.0, 1e-3, 1.0)
    pressure_limits: tuple[float, float] = (0.1e5, 8e5)
    softness: float = number(1e4, 1e-9, 1e9)
    torque_walk: float = number(40.0, 1e-9, 1e9)
    disturbances: Mapping[str, float] = field(
        default_factory=lambda: {"pressure_1": 1e7, "pressure_2": 1e7}
    )
    fading_time: float = number(0.1, 1e-9, 1e9)
    unknown: Mapping[str, float] = field(default_factory=lambda: {"supply_pressure": 1e5})
    sensor_noise: tuple[float, ...] = (2e-5, 600.0, 600.0)
    state_noise: float = 0.1
    reference_speed: float = number(40.0, 1e-9, 1e9)
    planner: Planner | None = None
    preview: bool = False
    sample_time: float = 0.002

    def __post_init__(self) -> None:
        super().__post_init__()
        h = check_range("sample time", self.sample_time, 1e-6, 1.0, "s")
        check_range("stage time", self.stage_time, h, 10.0, "s")
        self.in_samples("stage_time", h)
        low, high = self.pressure_limits
        check_range("highest pressure", high, low, 1e8, "Pa", fix="it lies above the lowest")

    @property
    def stride(self) -> int:
        """Samples per stage."""
        return round(self.stage_time / self.sample_time)


class NonlinearMPCState(NamedTuple):
    """What a `NonlinearMPC` remembers.

    Args:
        estimate: Predicted scaled states and disturbances of the observer, shape (n + n_w,).
        covariance: Their covariance, shape (n + n_w, n + n_w), scaled.
        plan: Openings over the horizon, shape (N,), fractions.
        trajectory: Scaled states at the starts of the stages and at the end, shape (n_p, N + 1).
        voltage: Voltage applied last, in V.
        ahead: State of the reference's continuation (`controllers.reference.horizon`), in SI.
    """

    estimate: Matrix
    covariance: Matrix
    plan: Matrix
    trajectory: Matrix
    voltage: float
    ahead: tuple[float, ...]


class Step(NamedTuple):
    """One Gauss-Newton step.

    Args:
        plan: New openings, shape (N,), fractions.
        trajectory: New scaled states, shape (n_p, N + 1).
        slack: Pressure out of the limits, in Pa; NaN where the program was not solved.
    """

    plan: Matrix
    trajectory: Matrix
    slack: float
    solution: Solution


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearMPC(ValveController):
    """Real-time iteration MPC with disturbance estimate.

    Args:
        shots: Mapped stages: (Z, U, w) -> ends of the stages, derivatives by z and by the input.
        observer: Estimates states and disturbances from the measurements.
        fading: What is left of each disturbance at each stage, shape (n_w, N), fractions.
        pressure_limits: Lowest and highest absolute pressure, in Pa.
    """

    specification: NonlinearMPCSpecification
    prediction: Dynamics
    shots: Buffered
    stage: ca.Function
    observer: ExtendedKalmanFilter
    fading: Matrix
    pressure_limits: tuple[float, float]
    name: str = "nonlinear MPC"

    not_in_c = (
        "its prediction is a nonlinear model whose stages and derivatives are integrated by CasADi"
        " at each step"
    )
    """Why it is not exported."""

    @property
    def ahead(self) -> ReferenceAhead:
        """How the reference goes on over the horizon where it is not previewed."""
        want = self.specification
        times = tuple(want.stage_time * j for j in range(want.stages + 1))
        return ReferenceAhead(times, want.reference_speed, want.planner, want.sample_time)

    def initial_state(self, measurement: Measurement) -> NonlinearMPCState:
        """Return the state of a plant at rest with this measurement."""
        estimate, covariance = self.observer.initial(measurement, self.valve.centre)
        start = self.predicted(estimate)
        N = self.specification.stages
        return NonlinearMPCState(
            estimate,
            covariance,
            np.zeros(N),
            np.tile(start[:, None], (1, N + 1)),
            self.valve.centre,
            self.ahead.start(measurement[0]),
        )

    def step(
        self, state: NonlinearMPCState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, NonlinearMPCState, Info]:
        """Compute the valve voltage of one sample.

        Returns:
            Voltage in V, next state, and ``opening`` (fraction), ``status``, ``iterations``,
            ``solve_time`` (s), ``slack`` (Pa), ``fallback`` (1 where the plan of the sample before
            was followed, or the filter started anew) and each unknown parameter as it is estimated
            (SI).
        """
        began = time.perf_counter()
        want = self.specification
        n = len(self.observer.rates.names)
        estimate, covariance = self.observer.correct(
            state.estimate, state.covariance, measurement, state.voltage
        )
        path, ahead = self.ahead.follow(state.ahead, reference[0])
        if want.preview:
            path = np.array([reference[j * want.stride] for j in range(want.stages + 1)])
        plan, trajectory = self._shifted(state.plan, state.trajectory)
        step = self.improve(
            plan, trajectory, self.predicted(estimate), estimate[n:], path, state.plan[0]
        )
        moves, trajectory = step.plan, step.trajectory
        if not step.solution.solved:
            # The plan goes on; its trajectory is started anew, in case that it was what failed.
            moves = np.where(np.isfinite(plan), plan, 0.0)
            trajectory = np.tile(self.predicted(estimate)[:, None], (1, want.stages + 1))
        opening = float(min(max(moves[0], -want.opening_limit), want.opening_limit))
        voltage = float(self.valve.command(opening))
        following, covariance = self.observer.predict(estimate, covariance, voltage)
        # Measurements that fit no state of the model: its temperatures, which nobody measures, run
        # away.
        lost = not np.isfinite(following).all()
        if lost:
            following, covariance = self.observer.initial(measurement, voltage)
        info: Mapping[str, float | str] = {
            "opening": opening,
            "status": step.solution.status,
            "iterations": step.solution.iterations,
            "solve_time": time.perf_counter() - began,
            "slack": step.slack,
            "fallback": 0.0 if step.solution.solved and not lost else 1.0,
            **self.observer.parameters(estimate),
        }
        memory = NonlinearMPCState(following, covariance, moves, trajectory, voltage, ahead)
        return (voltage,), memory, info

    # A plan that no longer fits the plant overflows: the solver's status then says so.
    @np.errstate(over="ignore", invalid="ignore")
    def improve(
        self,
        plan: Matrix,
        trajectory: Matrix,
        start: Matrix,
        disturbances: Matrix,
        path: Matrix,
        before: float,
    ) -> Step:
        """Improve a plan by one Gauss-Newton step.

        Args:
            plan: Openings, shape (N,), fractions.
            trajectory: Scaled states, shape (n_p, N + 1); they need not fit the plan.
            start: Scaled states now, shape (n_p,).
            disturbances: Scaled disturbances per second, shape (n_w,).
            path: Wanted angles now and at the end of every stage, shape (N + 1,), in rad.
            before: Opening applied before, a fraction.
        """
        want = self.specification
        N, size = want.stages, self.prediction.scale
        angle, speed, *chambers = self._rows()
        ends, by_z, by_u = self.shots(
            trajectory[:, :-1],
            self.valve.centre + self.valve.full_stroke * plan[None, :],
            disturbances[:, None] * self.fading,
        )
        n = len(size)
        # States at the ends of the stages: free + moves @ d_plan, in scaled units.
        free, moves = np.empty((N, n)), np.zeros((N, n, N))
        shift, gain = start - trajectory[:, 0], np.zeros((n, N))
        for k in range(N):
            A = by_z[:, k * n : (k + 1) * n]
            shift = A @ shift + ends[:, k] - trajectory[:, k + 1]
            gain = A @ gain
            gain[:, k] += self.valve.full_stroke * by_u[:, k]
            free[k], moves[k] = trajectory[:, k + 1] + shift, gain
        # Residuals, each divided by what weighs 1.
        rows = np.vstack(
            [
                moves[:, angle] * (size[angle] / want.angle_scale),
                moves[:, speed] * (size[speed] / want.speed_scale),
                (np.eye(N) - np.eye(N, k=-1)) / want.move_scale,
            ]
        )
        pace = np.diff(path) / want.stage_time
        change = np.diff(plan, prepend=before)
        values = np.concatenate(
            [
                (free[:, angle] * size[angle] - path[1:]) / want.angle_scale,
                (free[:, speed] * size[speed] - pace) / want.speed_scale,
                change / want.move_scale,
            ]
        )
        H, g = np.zeros((N + 1, N + 1)), np.empty(N + 1)
        H[:N, :N], H[N, N] = 2.0 * rows.T @ rows, 2.0 * want.softness
        g[:N], g[N] = 2.0 * rows.T @ values, want.softness
        # Pressures in bar, softened by the last variable.
        unit = size[chambers] / _UNIT_PRESSURE
        A = np.hstack(
            [
                np.tile((moves[:, chambers] * unit[:, None]).reshape(-1, N), (2, 1)),
                np.repeat([[1.0], [-1.0]], N * len(chambers), axis=0),
            ]
        )
        pressures = (free[:, chambers] * unit).ravel()
        low, high = (limit / _UNIT_PRESSURE for limit in self.pressure_limits)
        endless = np.full(len(pressures), np.inf)
        solution = quadratic_program(N + 1, len(A)).solve(
            H,
            g,
            A,
            np.concatenate([low - pressures, -endless, -want.opening_limit - plan, [0.0]]),
            np.concatenate([endless, high - pressures, want.opening_limit - plan, [np.inf]]),
        )
        if not solution.solved:
            return Step(plan, trajectory, math.nan, solution)
        d = solution.x[:N]
        trajectory = np.column_stack([start, (free + moves @ d).T])
        return Step(plan + d, trajectory, float(solution.x[N]) * _UNIT_PRESSURE, solution)

    def _rows(self) -> list[int]:
        names = self.prediction.names
        wanted = (self.sensors[0], "speed", *self.sensors[1:])
        return [names.index(name) for name in wanted]

    def _shifted(self, plan: Matrix, trajectory: Matrix) -> tuple[Matrix, Matrix]:
        """Move a plan on by one sample, a fraction of a stage."""
        part = 1.0 / self.specification.stride
        later_plan = np.append(plan[1:], plan[-1])
        later = np.hstack([trajectory[:, 1:], trajectory[:, -1:]])
        return plan + part * (later_plan - plan), trajectory + part * (later - trajectory)

    def predicted(self, z: Matrix) -> Matrix:
        """Return the states of the prediction among those of the observer, all scaled."""
        names = self.observer.rates.names
        return np.asarray(z[[names.index(name) for name in self.prediction.names]])


def design_nonlinear_mpc(
    model: Model,
    specification: NonlinearMPCSpecification | None = None,
    *,
    rest: npt.ArrayLike | None = None,
    compile_function: Compile | None = None,
) -> NonlinearMPC:
    """Design a nonlinear MPC on a prediction model.

    Args:
        model: The prediction model, with a 5/3 valve and the states ``angle``, ``speed``,
            ``pressure_1`` and ``pressure_2``; leave out what the controller shall not know.
        rest: States about which it starts, shape (n_states,), in SI; the model's initial state by
            default.
        compile_function: Makes machine code of a CasADi function; interpreted by default.
    """
    want = specification or NonlinearMPCSpecification()
    build = compile_function or (lambda function: function)
    names = [q.name for q in model.states]
    for name in ("angle", "speed", "pressure_1", "pressure_2", *RESTING):
        check_choice("state of the prediction model", name, names)
    check_choice("port of the prediction model", "joint.inertia", [q.name for q in model.ports])
    walk = {"speed": 0.0, **want.disturbances}
    if len(walk) != len(want.sensor_noise):
        raise WorkbenchError(
            f"{len(walk)} disturbances are estimated from {len(want.sensor_noise)}"
            " sensors; give as many disturbances as sensors, so that no offset is left"
        )
    disturbed, unknown = tuple(walk), tuple(want.unknown)
    softened = straightened(_with_soft_stops(model), "opening")
    ahead = dynamics(softened, disturbed, unknown=unknown, resting=RESTING)
    behind = dynamics(model, disturbed, unknown=unknown)
    stage = discrete(ahead, want.stage_time, want.steps, "nmpc_stage")
    ambient = {q.name: q.value for q in model.parameters}.get("ambient_pressure", 0.0)
    low, high = want.pressure_limits
    start = model.initial_state() if rest is None else np.asarray(rest, dtype=float)
    walk["speed"] = want.torque_walk / model.signals(start, model.nominal_input)["joint.inertia"]
    walks = np.array([*walk.values(), *want.unknown.values()]) / behind.unit
    rates, unsure = walks[: len(walk)], walks[len(walk) :]
    parameters = tuple(model.parameter(name) for name in unknown)
    observer = ExtendedKalmanFilter(
        rates=behind,
        sample=Buffered(build(discrete(behind, want.sample_time, 2, "nmpc_observer"))),
        read=Buffered(build(measurements(model, SENSORS))),
        rest=start / behind.scale,
        walk=np.concatenate(
            [np.full(len(names), want.state_noise), rates, unsure / math.sqrt(FORGETTING)]
        ),
        spread=np.concatenate([START_RATE * rates, unsure]),
        unknown=parameters,
        noise=np.array(want.sensor_noise),
        sample_time=want.sample_time,
    )
    fading = np.ones((len(walks), want.stages))
    fading[1 : len(walk)] = np.exp(-np.arange(want.stages) * want.stage_time / want.fading_time)
    return NonlinearMPC(
        specification=want,
        prediction=ahead,
        shots=Buffered(build(shooting(stage, want.stages))),
        stage=stage,
        observer=observer,
        fading=fading,
        pressure_limits=(low + ambient, high + ambient),
        sample_time=want.sample_time,
        preview=want.stages * want.stride if want.preview else 0,
    )


def _with_soft_stops(model: Model) -> Model:
    """Soften the stops, whose contact is too fast for the steps of the prediction."""
    soft = {"stop_stiffness": 1e3, "stop_damping": 1.0}
    known = {q.name for q in model.parameters}
    return model.with_parameters({k: v for k, v in soft.items() if k in known})


NONLINEAR_MPC = joint_design(
    name="nonlinear-mpc",
    family="nonlinear MPC",
    summary="nonlinear MPC by real-time iteration on the plant's regularised equations",
    function=design_nonlinear_mpc,
    needs="model",
    specification=NonlinearMPCSpecification,
    solves=True,
    exports=False,
)
