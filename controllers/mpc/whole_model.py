"""Linear model-predictive control without offset, on the valve opening.

Without preview, the reference passes two lags of speed omega_r, and the same lags continue it over
the horizon (the reference trajectory r_j); with preview, r_j is the reference itself.

At each sample a `DisturbanceObserver` estimates states x and disturbances w. The target at rest
(xs, us) solves A xs + B us + E w = 0 with the controlled output at its reference. Then, over N
prediction samples of time T, the controller minimises over blocked moves u and a slack eps

    sum_j q (y_j - r_j)^2 + R (u_j - us)^2 + S (u_j - u_{j-1})^2 + |x_N - xs|^2_P
        + softness eps^2
    subject to   x_{j+1} = Phi x_j + Gamma u_j + Omega w          (held inputs, exact)
                 -1 <= opening <= 1,  |u_j - u_{j-1}| <= rate T   (hard)
                 p_min - eps <= pressures <= p_max + eps          (soft: a measurement may be out)

P is the cost to go of the unconstrained regulator. `controllers.mpc.formulation` states all of it
in CasADi symbols, and a design takes a function that changes them. The first move is applied; the
sample after, all is solved anew. The moves are openings: the inverse valve curve follows, because a
solver that optimises the voltage sees almost no gradient at the valve's flat centre. If the solver
fails, the unconstrained regulator u = us - K (x - xs), clipped, takes its place (fallback
"regulator").

Source: Maciejowski, Predictive Control with Constraints, 2002, chapters 2 and 3 (condensing, move
blocking, soft constraints); Rawlings, Mayne and Diehl, Model Predictive Control, 2017, sections 1.3
(cost to go) and 1.5 (target, offset-free).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from controllers.arithmetic import Arithmetic, Number
from controllers.c_source import CSource
from controllers.design import Design
from controllers.joint.model import OpeningInput, opening_input
from controllers.linear_law import LinearLaw
from controllers.mpc.c_text import mpc_source
from controllers.mpc.disturbance_observer import (
    DisturbanceObserver,
    continuous_matrices,
    design_disturbance_observer,
)
from controllers.mpc.fixed_order import product
from controllers.mpc.formulation import Change
from controllers.mpc.prediction import Prediction, condense
from controllers.named_state import names
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.quadratic_program.plugins import OPTIONS, OWN, program
from controllers.quadratic_program.solver import Solution
from controllers.reference.horizon import lagged
from controllers.valve_inverse import ACTUATORS, SENSORS, ValveController, ValveInverse
from workbench.arrays import Matrix
from workbench.errors import TIMES_S, check_choice, check_range
from workbench.linearisation.state_space import linear_model

if TYPE_CHECKING:
    from workbench.linearisation import LinearModel


class MPCState(NamedTuple):
    """What a `LinearMPC` remembers.

    Args:
        predicted: Predicted states and disturbances, deviations, shape (n,), in SI.
        opening: Opening applied last, a fraction of the full one.
        filtered: Reference after the first lag, in rad.
        target: Reference after the second lag, in rad.
    """

    predicted: Any
    opening: float
    filtered: float
    target: float


@dataclass(frozen=True, eq=False, repr=False)
class LinearMPC(ValveController):
    """Linear MPC with constraints on opening, its rate and the pressures.

    Args:
        start: Estimate of (x, w) per deviation of the measurements at rest, shape (n, n_sensors),
            in SI.
        path: Reference trajectory per (reference, filtered, target), shape (N, 3), dimensionless.
        rest_opening: Opening at the operating point, a fraction.
        reference_speed: Speed omega_r of the reference's lags, in rad/s; not used with preview.
        solver: Solver of the program, ``"own"`` or one of CasADi's; in C it is the own one.
    """

    observer: DisturbanceObserver
    prediction: Prediction
    start: Matrix
    path: Matrix
    rest_opening: float
    reference_speed: float
    solver: str = OWN
    name: str = "linear MPC"

    def initial_state(self, measurement: Measurement) -> MPCState:
        """Return the estimate that explains a measurement as rest."""
        deviation = np.array(measurement) - self.observer.rest
        angle = measurement[0]
        return MPCState(product(self.start, deviation), self.rest_opening, angle, angle)

    def step(
        self, state: MPCState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, MPCState, Info]:
        """Compute the valve voltage of one sample.

        Returns:
            Voltage in V, next state, and ``opening`` (fraction), ``status``, ``iterations``,
            ``solve_time`` (s), ``slack`` (Pa) and ``fallback`` (1 where the regulator acted).
        """
        p = self.prediction
        estimate = self.observer.correct(state.predicted, measurement)
        if self.preview:
            filtered = target = reference[0]
            path = np.array([reference[i] for i in p.preview_index]) - self.observer.rest[0]
        else:
            filtered, target = lagged(
                state.filtered, state.target, reference[0], self.reference_speed * self.sample_time
            )
            path = product(self.path, (reference[0], filtered, target)) - self.observer.rest[0]
        before = state.opening - self.rest_opening
        gradient = product(p.g_estimate, estimate) + product(p.g_reference, path)
        gradient += p.g_before * before
        pressures = product(p.rows_estimate, estimate)
        lower = np.concatenate([p.lower_a - pressures, p.lower_x])
        upper = np.concatenate([p.upper_a - pressures, p.upper_x])
        lower[0] += before
        upper[0] += before
        solver = program(*p.size, self.solver)
        solution = solver.solve_factored(p.factors, gradient, lower, upper)
        if solution.solved:
            move, slack = float(solution.x[0]), float(solution.x[-1]) * p.slack_scale
        else:
            move, slack = p.regulator(estimate, float(path[-1])), float("nan")
        move = min(max(move, float(p.lower_x[0])), float(p.upper_x[0]))
        opening = min(max(move + self.rest_opening, -1.0), 1.0)
        predicted = self.observer.predict(estimate, np.array([opening - self.rest_opening]))
        following = MPCState(predicted, opening, filtered, target)
        return (self.valve.command(opening),), following, told(opening, solution, slack)

    def linear_law(
        self,
        state: MPCState,
        measurement: tuple[Number, ...],
        reference: tuple[Number, ...],
        arithmetic: Arithmetic,
        rest: Measurement,
    ) -> tuple[tuple[Number, ...], MPCState]:
        """Return command and next state on symbols where no constraint is active."""
        p, o = self.prediction, self.observer
        residual = ca.vcat(measurement) - o.rest - o.C @ state.predicted
        estimate = state.predicted + o.M @ residual
        if self.preview:
            filtered = target = reference[0]
            path = ca.DM([reference[i] for i in p.preview_index])
        else:
            fresh = self.reference_speed * self.sample_time
            filtered, target = lagged(state.filtered, state.target, reference[0], fresh)
            path = self.path @ ca.vertcat(reference[0], filtered, target)
        before = state.opening - self.rest_opening
        gradient = p.g_estimate @ estimate + p.g_reference @ (path - o.rest[0])
        move = -np.linalg.inv(p.H)[:1] @ (gradient + p.g_before * before)
        predicted = o.F @ estimate + o.G @ move
        opening = move + self.rest_opening
        following = MPCState(tuple(ca.vertsplit(predicted)), opening, filtered, target)
        return (self.valve.tangent(opening),), following

    def around_rest(self) -> LinearLaw:
        """Return the law without preview within its limits, from measurements and reference."""
        p, o = self.prediction, self.observer
        n, sensors = len(o.F), len(self.sensors)
        # Rows of what is linear in prediction, opening and lags before, measurements, reference.
        units = np.eye(n + 3 + sensors + 1)
        estimate, measured = units[:n], units[n + 3 : -1]
        estimate = estimate + o.M @ (measured - o.C @ estimate)
        fresh = self.reference_speed * self.sample_time
        lags = lagged(units[n + 1], units[n + 2], units[-1], fresh)
        path = self.path @ np.vstack([units[-1], *lags])
        gradient = p.g_estimate @ estimate + p.g_reference @ path
        move = -np.linalg.inv(p.H)[:1] @ (gradient + np.outer(p.g_before, units[n]))
        table = np.vstack([o.F @ estimate + o.G @ move, move, *lags])
        command = move / self.valve.gain_at_rest
        return LinearLaw(
            table[:, : n + 3], table[:, n + 3 :], command[:, : n + 3], command[:, n + 3 :]
        )

    def c_source(self, name: str) -> CSource:
        """Write the controller as C: tables of its problem, factored in advance, and one step."""
        p, o = self.prediction, self.observer
        n, m = p.size
        n_z, sensors, N = len(o.F), len(self.sensors), p.samples
        tables = {
            "F": o.F,
            "G": o.G[:, 0],
            "C": o.C,
            "M": o.M,
            "REST": o.rest,
            "START": self.start,
            "G_ESTIMATE": p.g_estimate,
            "G_REFERENCE": p.g_reference,
            "G_BEFORE": p.g_before,
            "ROWS_ESTIMATE": p.rows_estimate,
            "LOWER": np.concatenate([p.lower_a, p.lower_x]),
            "UPPER": np.concatenate([p.upper_a, p.upper_x]),
            "TARGET": p.target,
            "GAIN": p.gain,
            "INVERSE": p.factors.inverse,
            "ROWS": p.factors.rows,
            "SIZES": p.factors.sizes,
        }
        defined: dict[str, float | int | str] = {
            "N_Z": n_z,
            "N_W": o.disturbances,
            "N_X": n_z - o.disturbances,
            "SENSORS": sensors,
            "HORIZON": N,
            "REFERENCES": 1 + self.preview,
            "REST_OPENING": self.rest_opening,
            "SLACK_SCALE": p.slack_scale,
        }
        if self.preview:
            defined["PREVIEW_STRIDE"] = p.preview_index[0]
        else:
            tables["PATH"] = self.path
            defined["FRESH"] = self.reference_speed * self.sample_time
        return mpc_source(
            name,
            "whole_model.c",
            valve=self.valve,
            size=(n, m),
            factor=False,
            defined=defined,
            tables=tables,
            states=names(self.initial_state(tuple(o.rest.tolist()))),
            work=2 * n_z + sensors + N + 3 + 3 * n + m + 2 * (n + m),
            prepared=n_z * (3 * sensors + n_z) + N * 3 + n * (n_z + N) + m * n_z + (n + m) * n,
        )


def told(opening: float, solution: Solution, slack: float) -> dict[str, float | str]:
    """Return what a step tells: the opening, a fraction, the solution and its slack, in Pa."""
    return {
        "opening": opening,
        "status": solution.status,
        "iterations": solution.iterations,
        "solve_time": solution.seconds,
        "slack": slack,
        "fallback": 0.0 if solution.solved else 1.0,
    }


def reference_path(fresh: float, index: tuple[int, ...]) -> Matrix:
    """Return the trajectory of the second lag per (reference, filtered, target)."""
    k = np.array(index)
    kept = (1.0 - fresh) ** k
    passed = k * fresh * kept
    return np.column_stack([1.0 - kept - passed, passed, kept])


@dataclass(frozen=True)
class MPCSpecification:
    """What a `LinearMPC` is designed for.

    Args:
        angle_scale: Angle error that weighs as much as an opening of ``opening_scale``, in rad.
        opening_scale: Deviation of the opening from its target that weighs 1, a fraction.
        move_scale: Change of the opening from move to move that weighs 1, a fraction.
        prediction_time: Time T between prediction samples, in s; a multiple of ``sample_time``.
        blocks: Lengths of the blocked moves, in prediction samples; their sum is N.
        opening_limit: Largest opening, a fraction.
        rate_limit: Fastest change of the opening, per s.
        pressure_limits: Lowest and highest gauge pressure, in Pa.
        softness: Cost of a pressure 0.1 bar out of its limits, in the units of the cost
            (dimensionless).
        disturbances: States whose rates are disturbed, each with its random walk over one second,
            in the state's SI unit per second. As many as sensors: no offset.
        sensor_noise: Noise rms of angle (rad) and pressures (Pa).
        state_noise: Random walk of every state over one second, as a fraction of its scale.
        reference_speed: Speed omega_r of the reference's lags, in rad/s; not used with preview.
        preview: Whether the future reference over the horizon is used.
        solver: ``"own"``, or ``"daqp"``, ``"osqp"`` or ``"qpoases"`` of CasADi's.
        sample_time: Time between steps, in s.
    """

    angle_scale: float = 0.01
    opening_scale: float = 0.3
    move_scale: float = 0.1
    prediction_time: float = 0.01
    blocks: tuple[int, ...] = (1, 1, 1, 1, 2, 2, 3, 4, 5, 8, 12)
    opening_limit: float = 1.0
    rate_limit: float = 100.0
    pressure_limits: tuple[float, float] = (0.1e5, 5.95e5)
    softness: float = 1e3
    disturbances: Mapping[str, float] = field(
        default_factory=lambda: {"speed": 30.0, "pressure_1": 1e7, "pressure_2": 1e7}
    )
    sensor_noise: tuple[float, ...] = (2e-5, 600.0, 600.0)
    state_noise: float = 0.1
    reference_speed: float = 28.0
    preview: bool = False
    solver: str = OWN
    sample_time: float = 0.002

    def __post_init__(self) -> None:
        h = check_range("sample time", self.sample_time, *TIMES_S, "s")
        check_range("prediction time", self.prediction_time, h, TIMES_S[1], "s")
        check_range("opening limit", self.opening_limit, 1e-3, 1.0)
        check_choice("solver", self.solver, (OWN, *OPTIONS))
        for name in ("angle_scale", "opening_scale", "move_scale", "rate_limit", "softness"):
            check_range(name.replace("_", " "), getattr(self, name), 1e-30, 1e30)
        check_range("number of moves", len(self.blocks), 1, 100)
        check_range("shortest block", min(self.blocks), 1, 1000, "samples")
        low, high = self.pressure_limits
        check_range("highest pressure", high, low, 1e8, "Pa", fix="it lies above the lowest")


def design_mpc(
    linear: LinearModel,
    specification: MPCSpecification | None = None,
    *,
    valve: ValveInverse | None = None,
    sensors: tuple[str, ...] = ("angle", "pressure_1", "pressure_2"),
    actuator: str = "valve",
    opening_range: tuple[float, float] = (-1.0, 1.0),
    change: Change | None = None,
) -> LinearMPC:
    """Design a linear MPC from a linear model.

    Args:
        sensors: Names of the followed output and of the limited ones.
        opening_range: Lowest and highest opening that there is, fractions.
        change: Takes the `controllers.mpc.formulation.Formulation`, expressions of CasADi, and
            returns the one that is solved.
    """
    linear = linear_model(linear)
    want = specification or MPCSpecification()
    valve = valve or ValveInverse()
    entry = opening_input(linear, valve, actuator)
    disturbed = tuple(want.disturbances)
    observer = observer_of(linear, want, sensors, entry)
    A, B, E = continuous_matrices(linear, (entry.name,), disturbed)
    prediction = condense(
        A,
        B * entry.per_opening,
        E,
        observer.C[:, : len(A)],
        weights=(1.0 / want.angle_scale**2, 1.0 / want.opening_scale**2, 1.0 / want.move_scale**2),
        prediction_time=want.prediction_time,
        stride=max(1, round(want.prediction_time / want.sample_time)),
        blocks=want.blocks,
        opening_limits=(
            max(-want.opening_limit, opening_range[0]) - entry.at_rest,
            min(want.opening_limit, opening_range[1]) - entry.at_rest,
        ),
        move_limit=want.rate_limit * want.prediction_time,
        output_limits=tuple(
            (want.pressure_limits[0] - rest, want.pressure_limits[1] - rest)
            for rest in observer.rest[1:].tolist()
        ),
        softness=want.softness,
        change=change,
    )
    unit = np.eye(len(sensors))
    start = np.column_stack(
        [observer.at_rest(tuple(observer.rest + column), A, E) for column in unit]
    )
    return LinearMPC(
        observer=observer,
        prediction=prediction,
        start=start,
        path=reference_path(want.reference_speed * want.sample_time, prediction.preview_index),
        rest_opening=entry.at_rest,
        reference_speed=want.reference_speed,
        solver=want.solver,
        sample_time=want.sample_time,
        valve=valve,
        sensors=sensors,
        controlled=(sensors[0],),
        actuators=(actuator,),
        preview=prediction.preview_index[-1] if want.preview else 0,
    )


def observer_of(
    linear: LinearModel, want: MPCSpecification, sensors: tuple[str, ...], entry: OpeningInput
) -> DisturbanceObserver:
    """Design the observer of an MPC, whose input is the opening, a fraction."""
    observer = design_disturbance_observer(
        linear,
        sensors=sensors,
        actuators=(entry.name,),
        disturbances=want.disturbances,
        sensor_noise=want.sensor_noise,
        state_noise=want.state_noise,
        sample_time=want.sample_time,
    )
    return replace(observer, G=observer.G * entry.per_opening)


linear_mpc_design = partial(Design, family="linear MPC", solves=True, colour=("#00805c", "#36d6a4"))
"""A design of this family."""

LINEAR_MPC = linear_mpc_design(
    name="mpc",
    summary="linear MPC without offset, on the whole linear model",
    function=design_mpc,
    specification=MPCSpecification,
    sensors=SENSORS,
    actuators=ACTUATORS,
)
