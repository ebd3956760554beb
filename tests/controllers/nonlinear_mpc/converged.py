"""The problem of a nonlinear MPC, converged by a general solver.

A slow reference for the controller's real-time steps: the same cost, limits and stages as in
`controllers.nonlinear_mpc`, but the states follow from the moves, and nothing is linearised.

Source: Waechter and Biegler, Mathematical Programming 106, 2006 (ipopt).
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from controllers.nonlinear_mpc.controller import NonlinearMPC
from workbench.arrays import Matrix

_BAR = 1e5


class Converged(NamedTuple):
    """A converged plan.

    Args:
        plan: Openings, shape (N,), fractions.
        trajectory: Scaled states, shape (n, N + 1).
        slack: Pressure out of the limits, in Pa.
    """

    plan: Matrix
    trajectory: Matrix
    slack: float


def converged(
    mpc: NonlinearMPC, start: Matrix, disturbances: Matrix, path: Matrix, before: float
) -> Converged:
    """Solve the problem of one sample as `NonlinearMPC.improve` is asked it, to the end."""
    want, N = mpc.specification, mpc.specification.stages
    variables = ca.MX.sym("moves and slack", N + 1)
    moves, slack = variables[:N], variables[N]
    states = [ca.MX(start)]
    for k in range(N):
        voltage = mpc.valve.centre + mpc.valve.full_stroke * moves[k]
        states.append(mpc.stage(states[-1], voltage, disturbances * mpc.fading[:, k])[0])
    rows = ca.vertsplit(ca.mtimes(ca.diag(mpc.prediction.scale), ca.hcat(states[1:])))
    reached = dict(zip(mpc.prediction.names, rows, strict=True))
    angle, *pressures = (reached[name] for name in mpc.sensors)
    pace = np.diff(path) / want.stage_time
    cost = (
        ca.sumsqr((angle.T - path[1:]) / want.angle_scale)
        + ca.sumsqr((reached["speed"].T - pace) / want.speed_scale)
        + ca.sumsqr((moves - ca.vertcat(before, moves[:-1])) / want.move_scale)
        + want.softness * (slack + slack**2)
    )
    low, high = mpc.pressure_limits
    chambers = ca.hcat(pressures).T
    room = ca.vertcat(chambers - low, high - chambers) / _BAR + slack
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9}}
    problem = {"x": variables, "f": cost, "g": room}
    program = ca.nlpsol("converged", "ipopt", problem, options)
    limit = np.full(N, want.opening_limit)
    lower, upper = np.append(-limit, 0.0), np.append(limit, np.inf)
    found = program(x0=0.0, lbx=lower, ubx=upper, lbg=0.0, ubg=np.inf)["x"]
    assert program.stats()["success"], program.stats()["return_status"]
    trajectory = ca.Function("along", [variables], [ca.hcat(states)])(found).full()
    return Converged(found.full()[:N, 0], trajectory, float(found[N]) * _BAR)
