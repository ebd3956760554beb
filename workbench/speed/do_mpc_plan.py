"""The problem of a nonlinear MPC, written in do-mpc.

The rates are put together here from the plant's own expressions; do-mpc transcribes them by Radau
collocation with all collocation states as variables, where the controller integrates with
Runge-Kutta steps; cost and limits are assembled by do-mpc. What is shared: the plant's laws, the
weights and ipopt.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from controllers.nonlinear_mpc.controller import NonlinearMPC
from workbench.linearisation.actuator_inverse import straightened
from workbench.model import Model


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
    library: Any,
    plant: Model,
    mpc: NonlinearMPC,
    angle: float,
    disturbances: npt.NDArray[np.float64],
) -> Any:
    """Return do-mpc's controller for the problem of another, without limits of the pressures.

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
    off = (
        ((z[i] * size[i] - angle) / want.angle_scale) ** 2
        + (z[j] * size[j] / want.speed_scale) ** 2
    )  # fmt: skip
    solver.set_objective(lterm=off, mterm=off)
    solver.set_rterm(opening=1.0 / want.move_scale**2)
    solver.bounds["lower", "_u", "opening"] = -want.opening_limit
    solver.bounds["upper", "_u", "opening"] = want.opening_limit
    solver.setup()
    return solver
