"""Predictive controllers of the arm, beside general solvers on the same problems."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from controllers.mpc.whole_model import LinearMPC, design_mpc
from controllers.nonlinear_mpc.controller import NonlinearMPC, design_nonlinear_mpc
from controllers.nonlinear_mpc.prediction import discrete
from controllers.quadratic_program.solver import quadratic_program
from workbench.arrays import Vector
from workbench.linearisation import linearise
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.simulation.equations import compiled
from workbench.speed.measure import REPEATS, Comparison, Times, Way, timed, tried
from workbench.speed.peer_plans import do_mpc_plan, transcribed
from workbench.verification import step_scenario, verify

_CONIC = ("daqp", "osqp", "proxqp", "qrqp")
"""Solvers of quadratic programs that CasADi may have."""

_PROBLEMS = 60
"""Quadratic programs that are compared."""

_SAMPLES, _COMPARED = 60, (20, 21, 22)
"""Samples of the nonlinear comparison, and which of them the others solve."""

OURS, DO_MPC = "workbench, one Gauss-Newton step", "do-mpc, collocation with ipopt"

Quantiles = tuple[float, float]
"""Median, and what 99 of 100 stay below."""


def designed(plant: Model) -> tuple[LinearMPC, NonlinearMPC]:
    """Return the linear and the nonlinear MPC of the arm."""
    point = operating_point(plant.without("bearing_friction"), {"angle": math.radians(30.0)})
    linear = design_mpc(linearise(point, verdict=False))
    known = plant.without("bearing_friction")
    return linear, design_nonlinear_mpc(known, compile_function=compiled)


def solve_times(plant: Model, law: LinearMPC | NonlinearMPC) -> Quantiles:
    """Return median and 99th percentile of the solve times in a closed loop, in s."""
    scenario = step_scenario("angle", 15, 45, unit="deg")
    runs = [verify(law, plant, scenario, tolerance=1e-5) for _ in range(3)]
    # The runs do the same: what one of them took longer for a sample, the machine took.
    times = np.min([run.info("solve_time") for run in runs], axis=0)
    median, slow = np.nanquantile(times, [0.5, 0.99])
    return float(median), float(slow)


def linear_problems(plant: Model, law: LinearMPC) -> Comparison:
    """Compare solvers on the quadratic programs of a closed loop."""
    p = law.prediction
    n, m = p.size
    solver = quadratic_program(n, m)
    asked: list[tuple[Vector, Vector, Vector]] = []
    plain = solver.solve_factored

    def remembering(factors: Any, g: Vector, lower: Vector, upper: Vector) -> Any:
        asked.append((g.copy(), lower.copy(), upper.copy()))
        return plain(factors, g, lower, upper)

    solver.solve_factored = remembering  # type: ignore[assignment,method-assign]
    try:
        verify(law, plant, step_scenario("angle", 15, 45, unit="deg"), tolerance=1e-5)
    finally:
        del solver.solve_factored
    # Those of a step, where constraints are active, and of rest.
    problems = asked[:: max(1, len(asked) // _PROBLEMS)]
    ours = [solver.solve_factored(p.factors, *problem).x.copy() for problem in problems]

    def time_of(solve: Callable[[Vector, Vector, Vector], object], repeats: int = REPEATS) -> Times:
        return timed(lambda: [solve(*q) for q in problems], per=len(problems), repeats=repeats)

    times = time_of(partial(solver.solve_factored, p.factors), 10)
    ways = [Way("workbench, dual active set in C", times, 0.0)]
    structure = {"h": ca.DM(p.H).sparsity(), "a": ca.DM(p.A).sparsity()}
    for name in _CONIC:
        if not ca.has_conic(name):
            ways.append(Way(f"CasADi {name}", None, remark="not in this CasADi"))
            continue

        def measure(_: Any, name: str = name) -> Way:
            options: dict[str, Any] = {"error_on_fail": False, "print_time": False}
            if name == "osqp":
                accurate = {"verbose": False, "eps_abs": 1e-8, "eps_rel": 1e-8}
                options["osqp"] = {**accurate, "max_iter": 20_000}
            elif name == "qrqp":
                options |= {"print_iter": False, "print_header": False, "print_info": False}
            program = ca.conic(name, name, structure, options)
            failed = 0

            def solve(g: Vector, lower: Vector, upper: Vector) -> Vector:
                nonlocal failed
                bounds = {"lba": lower[:m], "uba": upper[:m], "lbx": lower[m:], "ubx": upper[m:]}
                found = program(h=p.H, g=g, a=p.A, **bounds)["x"]
                failed += not program.stats()["success"]
                return np.asarray(found).ravel()

            apart = [
                np.abs(solve(*q) - x)[: n - 1].max() for q, x in zip(problems, ours, strict=True)
            ]
            lost = failed
            times = time_of(solve)
            remark = f"{lost} of {len(problems)} not solved" if lost else ""
            return Way(f"CasADi {name}", times, float(max(apart)), remark)

        ways.append(tried(f"CasADi {name}", "casadi", measure))
    return Comparison(
        "linear-mpc",
        f"Linear MPC: the same {len(problems)} quadratic programs of a step of 30°, one by one",
        "solve",
        "largest difference of a move to the workbench's, as a fraction of the full opening",
        tuple(ways),
        f"{n} variables, {m} rows. The others are called through CasADi, which takes part of the"
        " time.",
    )


def nonlinear_problems(plant: Model, mpc: NonlinearMPC) -> Comparison:
    """Compare one Gauss-Newton step per sample, from 20 to 25 deg, with solvers that iterate."""
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

    def iterating(name: str, solve: Callable[[Vector, float], float]) -> Way:
        solve(*asked[_COMPARED[0] - 1])
        found = {i: timed(partial(solve, *asked[i]), repeats=1) for i in _COMPARED}
        apart = max(abs(one.result - truth.setdefault(i, one.result)) for i, one in found.items())
        times = Times(tuple(one.seconds[0] for one in found.values()))
        return Way(name, times, float(apart), "iterates to the end")

    def general(solver: Any) -> Callable[[Any], Way]:
        def measure(_: Any) -> Way:
            solve = transcribed(mpc, solver=solver)
            return iterating(
                f"CasADi {solver}",
                lambda state, u: float(solve(state, disturbances, path, u).plan[0]),
            )

        return measure

    def with_do_mpc(library: Any) -> Way:
        # Its unknown parameters, which come last, are as the plant has them.
        solver = do_mpc_plan(library, plant, mpc, goal, disturbances[:3])

        def solve(state: Vector, u: float) -> float:
            solver.u0 = np.array([u])
            return float(np.asarray(solver.make_step(state)).ravel()[0])

        state, u = asked[_COMPARED[0] - 1]
        solver.x0, solver.u0 = state, np.array([u])
        solver.set_initial_guess()
        return iterating(DO_MPC, solve)

    # The first of them, converged, is what the errors are against.
    others = [
        tried("CasADi ipopt", "casadi", general("ipopt")),
        tried("CasADi fatrop", "casadi", general("fatrop")),
        tried(DO_MPC, "do_mpc", with_do_mpc),
        Way("acados", None, remark="not on the package index, so it cannot be installed from it"),
    ]
    error = max((abs(openings[i] - opening) for i, opening in truth.items()), default=math.nan)
    quantiles = np.quantile(seconds, [0.1, 0.5, 0.9]).tolist()
    ways = [Way(OURS, Times(tuple(quantiles)), error, "from the plan before"), *others]
    return Comparison(
        "nonlinear-mpc",
        f"Nonlinear MPC with {N} stages: a step from 20° to 25°",
        "solve",
        "largest difference of the first opening to the converged one, a fraction",
        tuple(ways),
        "The others solve samples in the middle of the step, each from their solution of the sample"
        " before; ipopt and fatrop on the workbench's own stages, do-mpc by collocation.",
    )
