"""The converged plan of the nonlinear MPC against the same problem written in do-mpc.

What is independent: the rates are put together here from the plant's own expressions; do-mpc
transcribes them by Radau collocation with all collocation states as variables, where the controller
integrates with Runge-Kutta steps; cost and limits are assembled by do-mpc. What is shared: the
plant's laws, the weights and ipopt.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import casadi as ca
import numpy as np
import pytest

from controllers.nonlinear_mpc.controller import (
    NonlinearMPC,
    NonlinearMPCSpecification,
    design_nonlinear_mpc,
)
from tests.controllers.nonlinear_mpc.converged_plan import converged
from workbench.linearisation.actuator_inverse import straightened
from workbench.model import Model
from workbench.operating_point import operating_point

DISTURBANCES = np.array([2.0, 0.5, -0.5])
"""Scaled disturbances on speed and pressures, per second."""


def do_mpc() -> Any:
    with warnings.catch_warnings():
        # It tells which of its optional parts are not installed.
        warnings.simplefilter("ignore")
        return pytest.importorskip("do_mpc", reason="do-mpc is in the extra test")


def rates(plant: Model, names: tuple[str, ...]) -> ca.Function:
    """Return (states, opening, disturbances) -> rates in SI, the spool following at once."""
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


def solved_by_do_mpc(
    plant: Model, mpc: NonlinearMPC, start: np.ndarray, angle: float, before: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return openings, shape (N,), and scaled states at the ends of the stages, shape (n, N)."""
    library = do_mpc()
    want, size, names = mpc.specification, mpc.prediction.scale, mpc.prediction.names
    model = library.model.Model("continuous", "SX")
    z = model.set_variable("_x", "z", shape=(len(names), 1))
    opening = model.set_variable("_u", "opening")
    push = np.zeros(len(names))
    for name, value in zip(("speed", "pressure_1", "pressure_2"), DISTURBANCES, strict=True):
        push[names.index(name)] = value
    model.set_rhs("z", rates(plant, names)(z * size, opening) / size + push)
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
    off = (
        ((z[i] * size[i] - angle) / want.angle_scale) ** 2
        + (z[j] * size[j] / want.speed_scale) ** 2
    )  # fmt: skip
    solver.set_objective(lterm=off, mterm=off)
    solver.set_rterm(opening=1.0 / want.move_scale**2)
    solver.bounds["lower", "_u", "opening"] = -want.opening_limit
    solver.bounds["upper", "_u", "opening"] = want.opening_limit
    solver.setup()
    solver.x0 = start
    solver.u0 = np.array([before])
    solver.set_initial_guess()
    solver.make_step(start)
    assert solver.solver_stats["success"]
    found = solver.opt_x_num
    plan = [float(found["_u", k, 0]) for k in range(want.stages)]
    trajectory = [np.asarray(found["_x", k + 1, 0, -1]).ravel() for k in range(want.stages)]
    return np.array(plan), np.array(trajectory).T


# do-mpc calls numpy functions on CasADi values, as older versions of CasADi expected.
@pytest.mark.filterwarnings("ignore::FutureWarning")
# A free move of 20 deg has optima so flat that rounding decides between them; one of 5 deg has not.
@pytest.mark.parametrize(
    ("limit", "angle"), [(1.0, 25.0), (0.3, 40.0)], ids=["free", "opening at its limit"]
)
def test_the_converged_plan_is_that_of_do_mpc(plant: Model, limit: float, angle: float) -> None:
    wanted = NonlinearMPCSpecification(stages=6, steps=20, opening_limit=limit)
    mpc = design_nonlinear_mpc(plant.without("bearing_friction"), wanted)
    point = operating_point(plant, {"angle": math.radians(20)})
    start = mpc.predicted(point.x / mpc.observer.rates.scale)
    goal, before = math.radians(angle), 0.05
    ours = converged(mpc, start, DISTURBANCES, np.full(wanted.stages + 1, goal), before)
    plan, trajectory = solved_by_do_mpc(plant, mpc, start, goal, before)
    # The pressure limits are soft here and absent there: they must not be reached.
    assert ours.slack == pytest.approx(0.0, abs=1.0)
    # Runge-Kutta in steps of 1 ms against Radau of order 7 in 6.7 ms: the discrete problems differ
    # by their integration error, below 1e-4 of a stroke in the openings.
    np.testing.assert_allclose(ours.plan, plan, atol=1e-4)
    np.testing.assert_allclose(ours.trajectory[:, 1:], trajectory, atol=1e-4)
    assert np.abs(plan).max() == pytest.approx(limit, abs=1e-3) or limit == 1.0
