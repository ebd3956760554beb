"""The problem of a nonlinear MPC, converged by a general solver.

A slow reference for the controller's real-time steps: the same cost, limits and stages as in
`controllers.nonlinear_mpc`, written independently of its elimination of states. All states stay
variables, the opening before and the slack are carried along as states, and a general solver with
exact second derivatives iterates to the end.

Source: Waechter and Biegler, Mathematical Programming 106, 2006 (ipopt); Vanroye et al., FATROP, a
fast constrained optimal control problem solver for robot trajectory optimization and control, IROS
2023 (fatrop).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np

from controllers.nonlinear_mpc.controller import NonlinearMPC
from workbench.arrays import Matrix
from workbench.errors import NumericalError

_BAR = 1e5


class Converged(NamedTuple):
    """A converged plan.

    Args:
        plan: Openings, shape (N,), fractions.
        trajectory: Scaled states, shape (n, N + 1).
        slack: Pressure out of the limits, in Pa.
        cost: Value of the cost (dimensionless).
        iterations: Its number of iterations (dimensionless).
    """

    plan: Matrix
    trajectory: Matrix
    slack: float
    cost: float
    status: str
    iterations: int


Solve = Callable[[Matrix, Matrix, Matrix, float], Converged]
"""Solves the problem of one sample: start, disturbances, path, opening before."""


def transcribed(controller: NonlinearMPC, *, solver: Literal["ipopt", "fatrop"] = "ipopt") -> Solve:
    """Write the problem of a controller down once, to be solved sample by sample.

    Each solution is where the next one begins.

    Raises:
        NumericalError: From what it returns, if the solver does not converge.
    """
    want, size = controller.specification, controller.prediction.scale
    names = controller.prediction.names
    N, n = want.stages, len(names)
    angle, speed = names.index(controller.sensors[0]), names.index("speed")
    chambers = [names.index(name) for name in controller.sensors[1:]]
    low, high = (limit / _BAR for limit in controller.pressure_limits)
    disturbances = ca.MX.sym("w", controller.prediction.disturbances)
    path = ca.MX.sym("r", N + 1)
    given = ca.MX.sym("given", n + 1)
    # Joined state: (z, opening before, slack in bar).
    X = [ca.MX.sym(f"x{k}", n + 2) for k in range(N + 1)]
    U = [ca.MX.sym(f"u{k}") for k in range(N)]
    cost = want.softness * (X[N][n + 1] + X[N][n + 1] ** 2)
    g: list[ca.MX] = []
    lower: list[float] = []
    upper: list[float] = []
    equality: list[bool] = []

    def constrain(what: ca.MX, least: list[float], most: list[float], *, equal: bool) -> None:
        g.append(what)
        lower.extend(least)
        upper.extend(most)
        equality.extend([equal] * what.numel())

    for k in range(N + 1):
        x = X[k]
        if k < N:
            end = controller.stage(
                x[:n],
                controller.valve.centre + controller.valve.full_stroke * U[k],
                disturbances * controller.fading[:, k],
            )[0]
            # In this sign: fatrop's detection of the structure fails on the other.
            gap = X[k + 1] - ca.vertcat(end, U[k], x[n + 1])
            constrain(gap, [0.0] * (n + 2), [0.0] * (n + 2), equal=True)
            cost += ((U[k] - x[n]) / want.move_scale) ** 2
        if k == 0:
            constrain(x[: n + 1] - given, [0.0] * (n + 1), [0.0] * (n + 1), equal=True)
            constrain(x[n + 1], [0.0], [np.inf], equal=False)
        else:
            pace = (path[k] - path[k - 1]) / want.stage_time
            cost += ((x[angle] * size[angle] - path[k]) / want.angle_scale) ** 2
            cost += ((x[speed] * size[speed] - pace) / want.speed_scale) ** 2
            pressures = x[chambers] * (size[chambers] / _BAR)
            count = len(chambers)
            constrain(pressures + x[n + 1], [low] * count, [np.inf] * count, equal=False)
            constrain(pressures - x[n + 1], [-np.inf] * count, [high] * count, equal=False)
        if k < N:
            limit = [want.opening_limit]
            constrain(U[k], [-want.opening_limit], limit, equal=False)
    variables = ca.vertcat(*(v for pair in zip(X[:-1], U, strict=True) for v in pair), X[N])
    options: dict[str, object] = {"error_on_fail": False, "print_time": False}
    if solver == "ipopt":
        options["ipopt"] = {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 500}
    else:
        options |= {
            "structure_detection": "auto",
            "equality": equality,
            "fatrop": {"print_level": 0, "tol": 1e-9, "max_iter": 500},
        }
    parameters = ca.vertcat(given, disturbances, path)
    problem = {"x": variables, "f": cost, "g": ca.vertcat(*g), "p": parameters}
    program = ca.nlpsol("converged", solver, problem, options)
    guess: Matrix | None = None

    def solve(start: Matrix, disturbing: Matrix, wanted: Matrix, before: float) -> Converged:
        nonlocal guess
        if guess is None:
            resting = np.concatenate([start, [before, 0.0]])
            guess = np.concatenate([np.tile(np.append(resting, before), N), resting])
        values = np.concatenate([start, [before], disturbing, wanted])
        result = program(x0=guess, lbg=lower, ubg=upper, p=values)
        stats = program.stats()
        status = str(stats["return_status"])
        if not stats["success"]:
            raise NumericalError(
                f"{solver} did not solve the problem of {controller.name}: {status} after"
                f" {stats['iter_count']} iterations"
            )
        guess = found = np.asarray(result["x"]).ravel()
        rows = np.append(found, np.nan).reshape(N + 1, n + 3)
        return Converged(
            rows[:N, n + 2],
            rows[:, :n].T,
            float(rows[N, n + 1]) * _BAR,
            float(result["f"]),
            status,
            int(stats["iter_count"]),
        )

    return solve
