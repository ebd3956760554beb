"""The MPC: its condensed problem against an independent one, constraints, fallback, offset."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import controllers.mpc.whole_model as mpc_module
from controllers import MPCSpecification, design_mpc
from controllers.quadratic_program.solver import Solution
from workbench.errors import WorkbenchError
from workbench.linearisation.zero_order_hold import zero_order_hold

WANT = MPCSpecification(
    blocks=(1, 1, 2, 4), prediction_time=0.01, rate_limit=20.0, pressure_limits=(1e5, 5e5)
)


def independent_first_move(mpc: Any, model: Any, z: Any, wanted: Any, before: float) -> float:
    """Solve the same problem with the states kept, by an interior-point method."""
    from scipy.linalg import solve_discrete_are

    n, blocks = 4, WANT.blocks
    E = np.eye(4)[:, 1:]
    phi, gamma = zero_order_hold(model.A, np.hstack([model.B, E]), WANT.prediction_time)
    xs_us = np.linalg.solve(
        np.block([[model.A, model.B], [model.C[:1], np.zeros((1, 1))]]),
        np.concatenate([-E @ z[4:], wanted[-1:]]),
    )
    xs, us = xs_us[:4], xs_us[4]
    q, r, s = 1 / WANT.angle_scale**2, 1 / WANT.opening_scale**2, 1 / WANT.move_scale**2
    T = np.diag([1.0, 10.0, 1e5, 1e5])
    f, g, c = np.linalg.inv(T) @ phi @ T, np.linalg.inv(T) @ gamma[:, :1], model.C[:1] @ T
    P = solve_discrete_are(f, g, q * c.T @ c, np.array([[r]]))
    P = np.linalg.inv(T) @ P @ np.linalg.inv(T)
    opti = ca.Opti()
    u, eps = opti.variable(len(blocks)), opti.variable()
    last, x, cost, j = before, ca.DM(z[:n]), WANT.softness * (eps**2 + 0 * eps), 0
    opti.subject_to(eps >= 0)
    for i, length in enumerate(blocks):
        cost += s * (u[i] - last) ** 2 + r * length * (u[i] - us) ** 2
        opti.subject_to(opti.bounded(-0.2, u[i] - last, 0.2))
        opti.subject_to(opti.bounded(-1, u[i], 1))
        last = u[i]
        for _ in range(length):
            x = phi @ x + gamma[:, :1] @ u[i] + gamma[:, 1:] @ z[4:]
            cost += q * (x[0] - wanted[j]) ** 2
            if j % 2 == 0:
                for k in (2, 3):
                    opti.subject_to((x[k] - 1e5) / 1e4 <= eps)
                    opti.subject_to((-3e5 - x[k]) / 1e4 <= eps)
            j += 1
    cost += ca.mtimes([(x - xs).T, P, x - xs])
    opti.minimize(cost)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-11})
    return float(opti.solve().value(u[0]))


@pytest.mark.parametrize("to", [0.501, 0.53, 0.75])
def test_first_move_agrees_with_an_independent_formulation(third_order: Any, to: float) -> None:
    # From a small step without active constraints to one that meets rate and pressure limits.
    mpc = design_mpc(third_order, replace(WANT, preview=True))
    rng = np.random.default_rng(3)
    z = np.concatenate([rng.normal(size=4) * [0.01, 0.1, 1e4, 1e4], [2.0, 1e4, -2e4]])
    state = mpc.initial_state((0.5, 4e5, 4e5))._replace(predicted=z, opening=0.05)
    measured = tuple(float(v) for v in third_order.C @ z[:4] + third_order.y0)
    reference = (to,) * (mpc.preview + 1)
    _, _, info = mpc.step(state, measured, reference)
    wanted = np.full(sum(WANT.blocks), to - 0.5)
    expected = independent_first_move(mpc, third_order, z, wanted, 0.05)
    # The regulator's Riccati equation carries 1e-9 of regularisation.
    assert info["opening"] == pytest.approx(expected, abs=2e-4)


def loop(mpc: Any, model: Any, wanted: float, n: int, A: Any = None, push: float = 0.0) -> Any:
    phi, gamma = zero_order_hold(
        model.A if A is None else A, np.column_stack([model.B, [0, 1.0, 0, 0]]), mpc.sample_time
    )
    x = np.zeros(4)
    state = mpc.initial_state(tuple(model.y0))
    rows = []
    for _ in range(n):
        measured = tuple(float(v) for v in model.C @ x + model.y0)
        _, state, info = mpc.step(state, measured, (wanted,))
        rows.append((*measured, info["opening"], info["slack"], info["fallback"]))
        x = phi @ x + gamma @ [info["opening"], push]
    return np.array(rows)


def test_no_offset_on_a_plant_that_differs(third_order: Any) -> None:
    A = third_order.A.copy()
    A[1, 0] *= 1.3
    rows = loop(design_mpc(third_order), third_order, 0.6, 1500, A=A, push=15.0)
    # 0.001 degrees after 3 s
    assert rows[-1, 0] == pytest.approx(0.6, abs=2e-5)
    assert not rows[:, 5].any()


def test_constraints_are_kept(third_order: Any) -> None:
    want = MPCSpecification(
        opening_limit=0.3, rate_limit=20.0, pressure_limits=(3.5e5, 4.5e5), reference_speed=200.0
    )
    loose = replace(want, pressure_limits=(0.0, 1e6))
    rows = loop(design_mpc(third_order, want), third_order, 0.6, 400)
    free = loop(design_mpc(third_order, loose), third_order, 0.6, 400)
    assert np.abs(rows[:, 3]).max() <= 0.3 + 1e-9
    # The rate holds from block to block of 10 ms, so within five samples.
    assert np.abs(np.diff(rows[:, 3])).max() <= 20.0 * 0.01 + 1e-9
    # The limit is soft and checked every 20 ms: 0.05 bar beyond, where 0.75 bar were wanted.
    assert rows[:, 1:3].max() < 4.5e5 + 5e3
    assert free[:, 1:3].max() > 4.5e5 + 5e4


def test_a_failed_solve_goes_to_the_regulator(
    third_order: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mpc = design_mpc(third_order)
    nothing = Solution(np.full(12, np.nan), False, "SOLVER_RET_LIMITED", 7.0, 1e-3)

    class Broken:
        def solve_factored(self, *problem: Any) -> Solution:
            return nothing

    monkeypatch.setattr(mpc_module, "quadratic_program", lambda *size: Broken())
    rows = loop(mpc, third_order, 0.55, 800)
    assert rows[:, 5].all()
    assert rows[-1, 0] == pytest.approx(0.55, abs=1e-3)
    _, _, info = mpc.step(mpc.initial_state((0.5, 4e5, 4e5)), (0.5, 4e5, 4e5), (0.5,))
    assert info["status"] == "SOLVER_RET_LIMITED"
    assert info["iterations"] == 7.0


def test_preview_moves_before_the_step(third_order: Any) -> None:
    mpc = design_mpc(third_order, MPCSpecification(preview=True))
    assert mpc.preview == 200
    measured = (0.5, 4e5, 4e5)
    state = mpc.initial_state(measured)
    coming = (0.5,) * 40 + (0.6,) * 161
    _, _, info = mpc.step(state, measured, coming)
    assert abs(info["opening"]) > 1e-3
    _, _, info = mpc.step(state, measured, (0.5,) * 201)
    assert abs(info["opening"]) < 1e-9


def test_step_is_pure(third_order: Any) -> None:
    mpc = design_mpc(third_order)
    state = mpc.initial_state((0.5, 4e5, 4e5))
    kept = state.predicted.copy()
    one = mpc.step(state, (0.51, 4e5, 4e5), (0.6,))
    mpc.step(one[1], (0.52, 4e5, 4.1e5), (0.3,))
    two = mpc.step(state, (0.51, 4e5, 4e5), (0.6,))
    assert one[0] == two[0]
    np.testing.assert_array_equal(state.predicted, kept)


def test_crossed_pressure_limits_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="highest pressure"):
        MPCSpecification(pressure_limits=(5e5, 1e5))
