"""The converged plan of the nonlinear MPC against the same problem written in do-mpc."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

from controllers.nonlinear_mpc.controller import (
    NonlinearMPC,
    NonlinearMPCSpecification,
    design_nonlinear_mpc,
)
from tests.controllers.nonlinear_mpc.converged import converged
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.speed.solvers import do_mpc_plan

DISTURBANCES = np.array([2.0, 0.5, -0.5])
"""Scaled disturbances on speed and pressures, per second."""


def do_mpc() -> Any:
    with warnings.catch_warnings():
        # It tells which of its optional parts are not installed.
        warnings.simplefilter("ignore")
        return pytest.importorskip("do_mpc", reason="do-mpc is in the extra test")


def solved_by_do_mpc(
    plant: Model, mpc: NonlinearMPC, start: np.ndarray, angle: float, before: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return openings, shape (N,), and scaled states at the ends of the stages, shape (n, N)."""
    solver = do_mpc_plan(do_mpc(), plant, mpc, angle, DISTURBANCES)
    solver.x0 = start
    solver.u0 = np.array([before])
    solver.set_initial_guess()
    solver.make_step(start)
    assert solver.solver_stats["success"]
    found, stages = solver.opt_x_num, range(mpc.specification.stages)
    plan = [float(found["_u", k, 0]) for k in stages]
    trajectory = [np.asarray(found["_x", k + 1, 0, -1]).ravel() for k in stages]
    return np.array(plan), np.array(trajectory).T


# do-mpc calls numpy functions on CasADi values, as older versions of CasADi expected.
@pytest.mark.long
@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_the_converged_plan_is_that_of_do_mpc(plant: Model) -> None:
    # A free move of 20 deg has optima so flat that rounding decides between them; one at the limit
    # of the opening has not.
    limit, angle = 0.3, 40.0
    # The other problem has disturbances that last.
    wanted = NonlinearMPCSpecification(
        stages=6, steps=20, opening_limit=limit, unknown={}, fading_time=1e6
    )
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
    assert np.abs(plan).max() == pytest.approx(limit, abs=1e-3)
