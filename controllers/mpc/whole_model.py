"""Linear model-predictive control without offset, on openings: commands behind straight curves.

Without preview, each reference passes two lags of speed omega_r, and the same lags continue it over
the horizon (the reference trajectory r_j); with preview, r_j is the reference itself.

At each sample a `DisturbanceObserver` estimates states x and disturbances w. The target at rest
(xs, us) solves A xs + B us + E w = 0 with the followed outputs at their references. Then, over N
prediction samples of time T, the controller minimises over blocked moves u and a slack eps, for all
outputs and openings,

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

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from controllers.arithmetic import ARRAYS
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
from controllers.mpc.formulation import Change
from controllers.mpc.prediction import SLACK_SCALE, Prediction, condense
from controllers.named_state import names
from controllers.protocol import Command, Info, Measurement, Reference
from controllers.quadratic_program.solver import OPTIONS, OWN, Solution, quadratic_program
from controllers.reference.horizon import lagged
from controllers.reference.paced import paced
from controllers.specification import Checked, number
from controllers.valve_inverse import ACTUATORS, SENSORS, ValveController, ValveInverse
from workbench.arrays import Matrix, product
from workbench.errors import TIMES_S, check_choice, check_range
from workbench.linearisation import LinearModel
from workbench.linearisation.exact_delays import foretold
from workbench.linearisation.state_space import linear_model


class MPCState(NamedTuple):
    """What a `LinearMPC` remembers.

    Args:
        predicted: Predicted states and disturbances, deviations, shape (n,), in SI.
        opening: Openings applied last, shape (m,), fractions of the full ones.
        filtered: References after the first lag, shape (p,), in SI.
        target: References after the second lag, shape (p,), in SI.
        paced: References before the lags at their pace, and by how much they moved in the last
            sample, shape (2 p,), in SI; None without a pace.
    """

    predicted: Any
    opening: Any
    filtered: Any
    target: Any
    paced: Any = None


@dataclass(frozen=True, eq=False, repr=False)
class LinearMPC(ValveController):
    """Linear MPC with constraints on openings, their rates and limited outputs.

    With m openings, p followed outputs, the first sensors, and a horizon of N samples.

    Args:
        start: Estimate of (x, w) per deviation of the measurements at rest, shape (n, n_sensors),
            in SI.
        path: Reference trajectories per (reference, filtered, target), shape (p, N, 3),
            dimensionless.
        rest_opening: Openings at the operating point, shape (m,), fractions.
        reference_speed: Speeds omega_r of the references' lags, shape (p,), in rad/s; not used with
            preview.
        others: Curves of the actuators behind the first.
        pace: Largest changes of the references that are followed, in SI of the outputs per sample;
            not used with preview.
        brake: Largest changes of these changes from one sample to the next, in SI of the outputs.
        leap: Changes of the references that need no brake, in SI of the outputs per sample.
        solver: Solver of the program, ``"own"`` or one of CasADi's; in C it is the own one.
        stated: Condenses the problem of the prediction, which a ``change`` may have changed.
    """

    observer: DisturbanceObserver
    prediction: Prediction
    start: Matrix
    path: Matrix
    rest_opening: Matrix
    reference_speed: tuple[float, ...]
    others: tuple[ValveInverse, ...] = ()
    pace: tuple[float, ...] = ()
    brake: tuple[float, ...] = ()
    leap: tuple[float, ...] = ()
    solver: str = OWN
    name: str = "linear MPC"
    stated: Callable[..., Prediction] | None = None

    def changed(self, change: Change) -> LinearMPC:
        """Return the MPC of another problem: with other costs, rows or limits.

        Args:
            change: Takes the `controllers.mpc.formulation.Formulation`, expressions of CasADi, and
                returns the one that is solved.

        Raises:
            WorkbenchError: If it returns none, or one that is no quadratic program with a minimum.

        Example:
            >>> import casadi as ca
            >>> from controllers.plain.mpc import design_plain_mpc
            >>> law = design_plain_mpc("1 / (s (0.2 s + 1))")
            >>> def calmer(problem):
            ...     moves = ca.sumsqr(ca.diff(problem.openings))
            ...     return replace(problem, cost=problem.cost + 10.0 * moves)
            >>> calm = law.changed(calmer)
            >>> (calm.prediction.H[0, 0] > law.prediction.H[0, 0]).item()
            True
        """
        assert self.stated is not None
        return replace(self, prediction=self.stated(change=change))

    @property
    def curves(self) -> tuple[ValveInverse, ...]:
        """Curves of all actuators."""
        return (self.valve, *self.others)

    @property
    def rest_command(self) -> Command:
        """Commands that shut the curves, in SI."""
        return tuple(curve.centre for curve in self.curves)

    def linear_command(self, command: Command) -> Command:
        return tuple(curve.linear_command(u) for curve, u in zip(self.curves, command, strict=True))

    def initial_state(self, measurement: Measurement) -> MPCState:
        """Return the estimate that explains a measurement as rest."""
        deviation = np.array(measurement) - self.observer.rest
        followed = np.array(measurement[: len(self.controlled)])
        opening = np.array(self.rest_opening)
        paced = np.concatenate([followed, 0.0 * followed]) if self.pace else None
        return MPCState(product(self.start, deviation), opening, followed, followed, paced)

    def step(
        self, state: MPCState, measurement: Measurement, reference: Reference
    ) -> tuple[Command, MPCState, Info]:
        """Compute the commands of one sample.

        Returns:
            Commands in SI, next state, and ``opening`` (fraction; ``opening.NAME`` of several),
            ``status``, ``iterations``, ``solve_time`` (s), ``slack`` (how far a limited output is
            out of its limits, in the unit of these) and ``fallback`` (1 where the regulator acted).
        """
        seen, asked = np.array(measurement), np.array(reference)
        ((command, found, slack),), following = self.stepped(state, seen, asked)
        return command, following, told(following.opening.tolist(), found, slack, self.actuators)

    def stepped(
        self, state: MPCState, measurement: Matrix, reference: Matrix
    ) -> tuple[list[tuple[Command, Solution, float]], MPCState]:
        """Compute one sample of a loop, or of several, one in each column of all that enters.

        Returns:
            Of each loop its commands in SI, its solution and its slack in SI; and the next state.
        """
        p, o, count, m = self.prediction, self.observer, len(self.controlled), len(self.curves)
        estimate, rest = o.correct(state.predicted, measurement), o.rest[:count]
        paced = None
        if self.preview:
            filtered = target = reference[:count]
            coming = reference.reshape(-1, *target.shape)[list(p.preview_index)]
            path = np.concatenate([coming[:, i] - y for i, y in enumerate(rest)])
        else:
            now, fresh = reference, np.array(self.reference_speed) * self.sample_time
            if self.pace:
                moved = self._moved(reference, state.paced[:count], state.paced[count:])
                now = state.paced[:count] + moved
                paced = np.concatenate([now, moved])
            filtered, target = lagged(state.filtered.T, state.target.T, now.T, fresh)
            filtered, target = filtered.T, target.T
            lags = np.array([now, filtered, target])
            each = [product(own, lags[:, i]) - rest[i] for i, own in enumerate(self.path)]
            path = np.concatenate(each)
        before = (np.transpose(state.opening) - self.rest_opening).T
        gradient = product(p.g_estimate, estimate) + product(p.g_reference, path)
        gradient += product(p.g_before, before)
        limited = product(p.rows_estimate, estimate).T
        n, rows = p.size
        limits = np.empty((2, *limited.shape[:-1], rows + n))
        limits[0], limits[1] = p.lower, p.upper
        limits[..., :rows] -= limited
        limits[..., :m] += before.T
        lower, upper = limits.reshape(2, -1, rows + n)
        solver, moves, solved = quadratic_program(n, rows, self.solver), [], []
        for j, row in enumerate(gradient.T.reshape(-1, n)):
            found = solver.solve_factored(p.factors, row, lower[j], upper[j])
            move, slack = found.x[:m], float(found.x[-1]) * p.slack_scale
            if not found.solved:
                own, last = (part.reshape(len(part), -1)[:, j] for part in (estimate, path))
                move, slack = p.regulator(own, last[p.samples - 1 :: p.samples]), float("nan")
            moves.append(move)
            solved.append((found, slack))
        # NumPy's own clip takes longer than all of them for a few numbers.
        first = slice(rows, rows + m)
        within = np.minimum(np.maximum(moves, p.lower[first]), p.upper[first])
        openings = np.minimum(np.maximum(within + self.rest_opening, -1.0), 1.0)
        opening = openings.T.reshape(before.shape)
        predicted = o.predict(estimate, (opening.T - self.rest_opening).T)
        answers = [
            (tuple(c.command(o) for c, o in zip(self.curves, row, strict=True)), *own)
            for row, own in zip(openings.tolist(), solved, strict=True)
        ]
        return answers, MPCState(predicted, opening, filtered, target, paced)

    def _moved(self, reference: Matrix, before: Matrix, moved: Matrix) -> Matrix:
        """Return by how much references move."""
        # One that need not brake is sooner told than one that brakes without an end.
        brake = np.array(self.brake) if self.brake else math.inf
        leap = np.array(self.leap or (0.0,) * len(before))
        pace = np.array(self.pace)
        return np.asarray(paced(reference - before, moved, pace, brake, leap, ARRAYS))

    def around_rest(self) -> LinearLaw:
        """Return the law without preview within its limits, from measurements and references."""
        p, o = self.prediction, self.observer
        n, sensors, count, m = len(o.F), len(self.sensors), len(self.controlled), o.G.shape[1]
        # Rows of what is linear in prediction, openings and lags before, measurements, references.
        places = np.cumsum([0, n, m, count, count, sensors, count]).tolist()
        parts = np.split(np.eye(places[-1]), places[1:-1])
        estimate, before, filtered, target, measured, asked = parts
        estimate = estimate + o.M @ (measured - o.C @ estimate)
        fresh = np.array(self.reference_speed)[:, None] * self.sample_time
        lags = np.array([asked, *lagged(filtered, target, asked, fresh)])
        path = np.vstack([own @ lags[:, i] for i, own in enumerate(self.path)])
        gradient = p.g_estimate @ estimate + p.g_reference @ path + p.g_before @ before
        move = -np.linalg.inv(p.H)[:m] @ gradient
        table = np.vstack([o.F @ estimate + o.G @ move, move, *lags[1:]])
        command = move / np.array([[curve.gain_at_rest] for curve in self.curves])
        k = places[4]
        return LinearLaw(table[:, :k], table[:, k:], command[:, :k], command[:, k:])

    def c_source(self, name: str) -> CSource:
        """Write the controller as C: tables of its problem, factored in advance, and one step."""
        p, o = self.prediction, self.observer
        n, m = p.size
        n_z, sensors, N, followed = len(o.F), len(self.sensors), p.samples, len(self.controlled)
        openings = len(self.rest_opening)
        parts: tuple[tuple[Any, tuple[str, ...]], ...] = (
            (o, ("F", "G", "C", "M", "rest")),
            (self, ("start",)),
            (p, ("g_estimate", "g_reference", "g_before", "rows_estimate")),
            (p, ("lower", "upper", "target", "gain")),
            (p.factors, ("inverse", "rows", "sizes")),
            (self, ("rest_opening",)),
        )
        tables = {name.upper(): getattr(own, name) for own, every in parts for name in every}
        defined: dict[str, float | int | str] = {
            "N_Z": n_z,
            "N_W": o.disturbances,
            "N_X": n_z - o.disturbances,
            "SENSORS": sensors,
            "HORIZON": N,
            "FOLLOWED": followed,
            "SLACK_SCALE": p.slack_scale,
        }
        if self.preview:
            defined["PREVIEW_STRIDE"] = p.preview_index[0]
        else:
            tables["PATH"] = self.path
            tables["FRESH"] = np.array(self.reference_speed) * self.sample_time
            if self.pace:
                tables["PACE"] = np.array(self.pace)
                tables["BRAKE"] = np.array(self.brake or np.full(followed, math.inf))
                tables["LEAP"] = np.array(self.leap or np.zeros(followed))
                defined["PACED"] = 1
        return mpc_source(
            name,
            "whole_model.c",
            curves=self.curves,
            actuators=self.actuators,
            size=(n, m),
            factor=False,
            defined=defined,
            tables=tables,
            states=names(self.initial_state(tuple(o.rest.tolist()))),
            work=2 * n_z + sensors + N * followed + 3 + 3 * n + m + 2 * (n + m) + 3 * openings,
            prepared=n_z * (3 * sensors + n_z)
            + N * 3 * followed
            + n * (n_z + N * followed)
            + m * n_z
            + (n + m) * n,
        )


def told(
    opening: Sequence[float], solution: Solution, slack: float, names: Sequence[str] = ("",)
) -> dict[str, float | str]:
    """Return what a step tells: the openings, fractions, the solution and its slack, in Pa."""
    several = len(names) > 1
    return {
        **{
            f"opening.{n}" if several else "opening": o for n, o in zip(names, opening, strict=True)
        },
        "status": solution.status,
        "iterations": solution.iterations,
        "solve_time": solution.seconds,
        "slack": slack,
        "fallback": 0.0 if solution.solved else 1.0,
    }


@dataclass(frozen=True)
class MPCSpecification(Checked):
    """What a `LinearMPC` is designed for.

    Args:
        angle_scale: Angle error that weighs as much as an opening of ``opening_scale``, in rad.
        opening_scale: Deviation of the opening from its target that weighs 1, a fraction.
        move_scale: Change of the opening from move to move that weighs 1, a fraction.
        prediction_time: Time T between prediction samples, in s; rounded to whole ones of the loop.
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
        reference_speed: Speed omega_r of the references' lags, in rad/s; not used with preview.
        preview: Whether the future reference over the horizon is used.
        solver: ``"own"``, or ``"daqp"``, ``"osqp"`` or ``"qpoases"`` of CasADi's.
        sample_time: Time between steps, in s.
    """

    angle_scale: float = number(0.01, 1e-30, 1e30)
    opening_scale: float = number(0.3, 1e-30, 1e30)
    move_scale: float = number(0.1, 1e-30, 1e30)
    prediction_time: float = 0.01
    blocks: tuple[int, ...] = (1, 1, 1, 1, 2, 2, 3, 4, 5, 8, 12)
    opening_limit: float = number(1.0, 1e-3, 1.0)
    rate_limit: float = number(100.0, 1e-30, 1e30)
    pressure_limits: tuple[float, float] = (0.1e5, 5.95e5)
    softness: float = number(1e3, 1e-30, 1e30)
    disturbances: Mapping[str, float] = field(
        default_factory=lambda: {"speed": 30.0, "pressure_1": 1e7, "pressure_2": 1e7}
    )
    sensor_noise: tuple[float, ...] = (2e-5, 600.0, 600.0)
    state_noise: float | Matrix = 0.1
    reference_speed: float = 28.0
    preview: bool = False
    solver: str = OWN
    sample_time: float = 0.002

    def __post_init__(self) -> None:
        super().__post_init__()
        h = check_range("sample time", self.sample_time, *TIMES_S, "s")
        check_range("prediction time", self.prediction_time, h, TIMES_S[1], "s")
        self.in_samples("prediction_time", h)
        check_choice("solver", self.solver, (OWN, *OPTIONS))
        check_range("number of moves", len(self.blocks), 1, 100)
        check_range("shortest block", min(self.blocks), 1, 1000, "samples")
        low, high = self.pressure_limits
        check_range("highest pressure", high, low, 1e8, "Pa", fix="it lies above the lowest")


def design_mpc(
    linear: LinearModel,
    specification: MPCSpecification | None = None,
    *,
    change: Change | None = None,
) -> LinearMPC:
    """Design a linear MPC of the angle from a linear model.

    Args:
        change: Takes the `controllers.mpc.formulation.Formulation`, expressions of CasADi, and
            returns the one that is solved.
    """
    linear = linear_model(linear)
    want = specification or MPCSpecification()
    step, edge = want.prediction_time, want.opening_limit
    law = mpc_of(
        linear,
        Problem(
            curves=(ValveInverse(),),
            actuators=ACTUATORS,
            sensors=SENSORS,
            weights=(want.angle_scale**-2, want.opening_scale**-2, want.move_scale**-2),
            ends=((-edge,), (edge,)),
            move_limit=(want.rate_limit * step,),
            output_limits=(want.pressure_limits,) * (len(SENSORS) - 1),
            disturbances=want.disturbances,
            reference_speed=(want.reference_speed,),
        ),
        want,
    )
    return law.changed(change) if change else law


class Problem(NamedTuple):
    """What a linear MPC of any number of openings and followed outputs is told beside its numbers.

    Args:
        curves: Of each actuator, what gives the openings.
        sensors: Names of the followed outputs, as many as ``reference_speed`` has, then of the
            limited ones unless ``limited`` tells them, then of those that only the observer reads.
        weights: Of errors (per SI squared), of openings and of their changes (dimensionless), one
            or one for each.
        ends: Lowest and highest openings, fractions.
        move_limit: Largest change of each opening from block to block, a fraction.
        output_limits: Lowest and highest value of each limited output, in SI.
        disturbances: As `controllers.mpc.disturbance_observer.design_disturbance_observer` has
            them, in SI.
        reference_speed: Speed of each reference's lags, in rad/s.
        first_limit: What the change from the openings before is limited to if less, a fraction.
        offsets: Random walks of the offsets of the last sensors over one second, in SI.
        limited: Places of the limited outputs among the sensors, and the size, in SI, in which each
            is counted, the slack too.
    """

    curves: tuple[ValveInverse, ...]
    actuators: tuple[str, ...]
    sensors: tuple[str, ...]
    weights: tuple[Any, Any, Any]
    ends: tuple[Sequence[float], Sequence[float]]
    move_limit: Sequence[float]
    output_limits: tuple[tuple[float, float], ...]
    disturbances: Mapping[str, float] | tuple[Matrix, float]
    reference_speed: tuple[float, ...]
    first_limit: Sequence[float] = ()
    offsets: tuple[float, ...] = ()
    limited: tuple[tuple[int, float], ...] = ()


def mpc_of(
    linear: LinearModel,
    problem: Problem,
    want: MPCSpecification,
    *,
    observer: DisturbanceObserver | None = None,
) -> LinearMPC:
    """Design a linear MPC of any number of openings and followed outputs."""
    entries = _entries(linear, problem)
    observer = observer or observer_of(linear, problem, want)
    names = tuple(entry.name for entry in entries)
    A, B, E, *_ = continuous_matrices(linear, names, problem.disturbances)
    E = np.hstack([E, np.zeros((len(E), len(problem.offsets)))])
    at_rest = np.array([entry.at_rest for entry in entries])
    followed, sensors = len(problem.reference_speed), problem.sensors
    lower, upper = (np.clip(np.array(ends), -1.0, 1.0) - at_rest for ends in problem.ends)
    moves = np.tile(np.array(problem.move_limit), len(want.blocks))
    if problem.first_limit:
        moves[: len(at_rest)] = np.minimum(moves[: len(at_rest)], problem.first_limit)
    count = len(problem.output_limits)
    limited = problem.limited or tuple((followed + i, 1.0) for i in range(count))
    sizes = np.array([size for _, size in limited])
    C, at = observer.C[:, : len(A)], [place for place, _ in limited]
    ends = np.array(problem.output_limits).reshape(-1, 2) - observer.rest[at][:, None]
    ends /= sizes[:, None]
    stated = partial(
        condense,
        A,
        B * np.array([entry.per_opening for entry in entries]),
        E,
        np.vstack([C[:followed], C[at] / sizes[:, None]]),
        weights=problem.weights,
        prediction_time=want.prediction_time,
        sample_time=want.sample_time,
        blocks=want.blocks,
        opening_limits=(lower, upper),
        move_limit=moves,
        output_limits=tuple((low, high) for low, high in ends.tolist()),
        softness=want.softness,
        slack_scale=1.0 if problem.limited else SLACK_SCALE,
    )
    prediction = stated()
    unit = np.eye(len(sensors))
    start = np.column_stack(
        [observer.at_rest(tuple(observer.rest + column), A, E) for column in unit]
    )
    index = prediction.preview_index
    return LinearMPC(
        observer=observer,
        prediction=prediction,
        start=start,
        path=reference_paths(problem.reference_speed, want.sample_time, index),
        rest_opening=at_rest,
        reference_speed=problem.reference_speed,
        solver=want.solver,
        sample_time=want.sample_time,
        valve=problem.curves[0],
        others=problem.curves[1:],
        sensors=sensors,
        controlled=sensors[:followed],
        actuators=problem.actuators,
        preview=index[-1] if want.preview else 0,
        stated=stated,
    )


def acting_later(law: LinearMPC, samples: int) -> LinearMPC:
    """Return the MPC of the same plant whose openings act some samples late.

    Those on their way are states, the last one first, behind the plant's. What is minimised begins
    when the first move acts, from the states foretold until then.
    """
    o = law.observer
    (n, m), w, more = o.G.shape, o.disturbances, samples * o.G.shape[1]
    places = n - w
    F, G = np.zeros((n + more, n + more)), np.zeros((n + more, m))
    own = np.delete(np.arange(n + more), np.s_[places : places + more])
    F[np.ix_(own, own)] = o.F
    F[own, places + more - m : places + more] = o.G
    F[places + m : places + more, places : places + more - m] = np.eye(more - m)
    G[places : places + m] = np.eye(m)

    def spread(part: Matrix, axis: int) -> Matrix:
        return np.insert(part, [places] * more, 0.0, axis=axis)

    observer = replace(o, F=F, G=G, C=spread(o.C, 1), M=spread(o.M, 0))
    ahead = foretold(o.F, o.G, samples, places)
    prediction = _begun_later(law.prediction, ahead, samples)
    assert law.stated is not None
    stated = partial(_condensed_later, law.stated, ahead, samples)
    start = spread(law.start, 0)
    return replace(law, observer=observer, prediction=prediction, start=start, stated=stated)


def _condensed_later(
    stated: Callable[..., Prediction], ahead: Matrix, samples: int, *, change: Change
) -> Prediction:
    return _begun_later(stated(change=change), ahead, samples)


def _begun_later(prediction: Prediction, ahead: Matrix, samples: int) -> Prediction:
    """Return a prediction that begins some samples later, at what ``ahead`` makes of an estimate.

    Its openings until then are states behind those of the plant.
    """
    m, places = prediction.gain.shape
    own, p = slice(places + samples * m), prediction
    at_rest = np.vstack([p.target[:places], *[p.target[places:]] * samples, p.target[places:]])
    return replace(
        p,
        g_estimate=p.g_estimate @ ahead,
        rows_estimate=p.rows_estimate @ ahead,
        gain=p.gain @ ahead[:places, own],
        target=at_rest,
    )


def reference_paths(speeds: Sequence[float], sample_time: float, index: tuple[int, ...]) -> Matrix:
    """Return the trajectories of references behind two lags, as `LinearMPC` has them.

    The lags have speeds in rad/s, and are sampled every so many s.
    """
    k, fresh = np.array(index), np.array(speeds)[:, None] * sample_time
    kept = (1.0 - fresh) ** k
    passed = k * fresh * kept
    return np.stack([1.0 - kept - passed, passed, kept], axis=2)


def _entries(linear: LinearModel, problem: Problem) -> list[OpeningInput]:
    pairs = zip(problem.curves, problem.actuators, strict=True)
    return [opening_input(linear, curve, actuator) for curve, actuator in pairs]


def observer_of(
    linear: LinearModel, problem: Problem, want: MPCSpecification
) -> DisturbanceObserver:
    """Design the observer of an MPC, whose inputs are the openings, fractions."""
    entries = _entries(linear, problem)
    observer = design_disturbance_observer(
        linear,
        sensors=problem.sensors,
        actuators=tuple(entry.name for entry in entries),
        disturbances=problem.disturbances,
        sensor_noise=want.sensor_noise,
        state_noise=want.state_noise,
        sample_time=want.sample_time,
        offsets=problem.offsets,
    )
    return replace(observer, G=observer.G * np.array([entry.per_opening for entry in entries]))


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
