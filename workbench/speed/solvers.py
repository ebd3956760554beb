"""Predictive controllers of the arm: how long they solve, and the nonlinear one beside do-mpc."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from controllers.mpc.whole_model import LinearMPC, design_mpc
from controllers.nonlinear_mpc.controller import NonlinearMPC, design_nonlinear_mpc
from controllers.nonlinear_mpc.prediction import discrete
from workbench.arrays import Vector
from workbench.linearisation import linearise
from workbench.linearisation.actuator_inverse import straightened
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.simulation.equations import compiled
from workbench.speed.measure import Comparison, Times, Way, timed, tried
from workbench.verification import step_scenario, verify

_SAMPLES, _COMPARED = 60, (20, 21, 22)
"""Samples of the nonlinear comparison, and which of them do-mpc solves too."""

DO_MPC = "do-mpc, collocation with ipopt"


def designed(plant: Model) -> tuple[LinearMPC, NonlinearMPC]:
    """Return the linear and the nonlinear MPC of the arm."""
    known = plant.without("bearing_friction")
    linear = linearise(operating_point(known, {"angle": math.radians(30.0)}), verdict=False)
    return design_mpc(linear), design_nonlinear_mpc(known, compile_function=compiled)


def solve_times(plant: Model, law: LinearMPC | NonlinearMPC) -> tuple[float, float]:
    """Return median and 99th percentile of the solve times in a closed loop, in s."""
    scenario = step_scenario("angle", 15, 45, unit="deg")
    runs = [verify(law, plant, scenario, tolerance=1e-5) for _ in range(3)]
    # The runs do the same: what one of them took longer for a sample, the machine took.
    times = np.min([run.info("solve_time") for run in runs], axis=0)
    median, slow = np.nanquantile(times, [0.5, 0.99])
    return float(median), float(slow)


def nonlinear_problems(plant: Model, mpc: NonlinearMPC) -> Comparison:
    """Compare one Gauss-Newton step per sample, from 20 to 25 deg, with do-mpc, which iterates."""
    want = mpc.specification
    N, goal = want.stages, math.radians(25.0)
    rest = operating_point(plant, {"angle": math.radians(20.0)}).x
    z = mpc.predicted(rest / mpc.observer.rates.scale)
    disturbances, path = np.zeros(mpc.prediction.disturbances), np.full(N + 1, goal)
    after = discrete(mpc.prediction, want.sample_time, 2, "after")
    plan, trajectory, before = np.zeros(N), np.tile(z[:, None], (1, N + 1)), 0.0
    asked: list[tuple[Vector, float]] = []
    openings, seconds = [], []
    for _ in range(_SAMPLES):
        asked.append((z, before))
        shifted = mpc._shifted(plan, trajectory)  # noqa: SLF001
        step = mpc.improve(*shifted, z, disturbances, path, before)
        again = partial(mpc.improve, *shifted, z, disturbances, path, before)
        seconds.append(min(timed(again).seconds))
        plan, trajectory, before = step.plan, step.trajectory, float(step.plan[0])
        openings.append(before)
        voltage = mpc.valve.centre + mpc.valve.full_stroke * before
        z = np.asarray(after(z, voltage, disturbances)[0]).ravel()
    truth: dict[int, float] = {}

    def with_do_mpc(library: Any) -> Way:
        # Its unknown parameters, which come last, are as the plant has them.
        solver = do_mpc_plan(library, plant, mpc, goal, disturbances[:3])

        def solve(state: Vector, u: float) -> float:
            solver.u0 = np.array([u])
            return float(np.asarray(solver.make_step(state)).ravel()[0])

        state, u = asked[_COMPARED[0] - 1]
        solver.x0, solver.u0 = state, np.array([u])
        solver.set_initial_guess()
        solve(state, u)
        found = {i: timed(partial(solve, *asked[i]), repeats=1) for i in _COMPARED}
        truth.update((i, one.result) for i, one in found.items())
        times = Times(tuple(one.seconds[0] for one in found.values()))
        return Way(DO_MPC, times, 0.0, "iterates to the end")

    other = tried(DO_MPC, "do_mpc", with_do_mpc)
    error = max((abs(openings[i] - opening) for i, opening in truth.items()), default=math.nan)
    times = Times(tuple(np.quantile(seconds, [0.1, 0.5, 0.9]).tolist()))
    ours = Way("workbench, one Gauss-Newton step", times, error, "from the plan before")
    return Comparison(
        "nonlinear-mpc",
        f"Nonlinear MPC with {N} stages: a step from 20° to 25°",
        "solve",
        "largest difference of the first opening to the converged one, a fraction",
        (ours, other),
        "do-mpc solves samples in the middle of the step by collocation, each from its solution of"
        " the sample before.",
    )


def _rates(plant: Model, names: tuple[str, ...]) -> ca.Function:
    """Return (states, opening) -> rates in SI, the spool following at once."""
    soft = plant.without("bearing_friction").with_parameters(
        {"stop_stiffness": 1e3, "stop_damping": 1.0}
    )
    traced = straightened(soft, "opening").regularised
    every = [q.name for q in soft.states]
    x, opening = ca.SX.sym("x", len(names)), ca.SX.sym("opening")
    volts = 5.0 + 5.0 * opening
    known = {"spool": volts - 5.0, "spool_speed": ca.SX(0)}
    full = ca.vertcat(*(known[n] if n in known else x[names.index(n)] for n in every))
    values = straightened(soft, "opening").values
    out = ca.substitute(
        traced.rates,
        ca.vertcat(traced.x, traced.u, traced.p),
        ca.vertcat(full, volts, ca.DM(values)),
    )
    return ca.Function("rates", [x, opening], [out[[every.index(n) for n in names]]])


def do_mpc_plan(
    library: Any, plant: Model, mpc: NonlinearMPC, angle: float, disturbances: Vector
) -> Any:
    """Return do-mpc's controller for the problem of another, without limits of the pressures.

    The rates are put together from the plant's own expressions; do-mpc transcribes them by Radau
    collocation with all collocation states as variables, where the controller integrates with
    Runge-Kutta steps. What is shared: the plant's laws and the weights.

    Args:
        angle: Wanted angle, in rad.
        disturbances: Scaled disturbances of speed and pressures, per second.
    """
    want, size, names = mpc.specification, mpc.prediction.scale, mpc.prediction.names
    model = library.model.Model("continuous", "SX")
    z = model.set_variable("_x", "z", shape=(len(names), 1))
    opening = model.set_variable("_u", "opening")
    push = np.zeros(len(names))
    for name, value in zip(("speed", "pressure_1", "pressure_2"), disturbances, strict=True):
        push[names.index(name)] = value
    model.set_rhs("z", _rates(plant, names)(z * size, opening) / size + push)
    model.setup()
    solver = library.controller.MPC(model)
    solver.settings.n_horizon = want.stages
    solver.settings.t_step = want.stage_time
    solver.settings.state_discretization = "collocation"
    solver.settings.collocation_type = "radau"
    solver.settings.collocation_deg = 4
    solver.settings.collocation_ni = 3
    solver.settings.store_full_solution = True
    solver.settings.nlpsol_opts = {
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": 0,
        "ipopt.tol": 1e-10,
        "ipopt.acceptable_iter": 0,
    }
    i, j = names.index("angle"), names.index("speed")
    # At the first stage the cost is that of the given state, a constant.
    off = ((z[i] * size[i] - angle) / want.angle_scale) ** 2
    off += (z[j] * size[j] / want.speed_scale) ** 2
    solver.set_objective(lterm=off, mterm=off)
    solver.set_rterm(opening=1.0 / want.move_scale**2)
    solver.bounds["lower", "_u", "opening"] = -want.opening_limit
    solver.bounds["upper", "_u", "opening"] = want.opening_limit
    solver.setup()
    return solver
