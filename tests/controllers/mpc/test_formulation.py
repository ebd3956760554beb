"""The MPC in symbols: the program follows from the expressions, whatever solver takes it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from controllers.mpc.formulation import Change, Formulation
from controllers.mpc.whole_model import LinearMPC, MPCSpecification, design_mpc
from controllers.plain.mpc import design_plain_mpc
from controllers.quadratic_program.solver import OPTIONS, OWN, quadratic_program
from tests.controllers.in_c import InC
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.verification import Scenario, Steps, verify


@pytest.fixture(scope="module")
def known(linear: LinearModel) -> tuple[LinearMPC, Formulation]:
    """A design, and what it stated in symbols."""
    seen: list[Formulation] = []

    def look(problem: Formulation) -> Formulation:
        seen.append(problem)
        return problem

    return design_mpc(linear, change=look), seen[0]


def test_program_is_that_of_eliminated_states(
    known: tuple[LinearMPC, Formulation], linear: LinearModel
) -> None:
    # Written down by hand: y_j = C Phi^j z + sum_i C Phi^(j-1-i) Gamma u_block(i).
    mpc, problem = known
    p, want = mpc.prediction, MPCSpecification()
    n_z = len(mpc.observer.F)
    n_u, N = len(want.blocks), sum(want.blocks)
    states = ca.Function("states", [problem.symbols], [problem.states])
    rng = np.random.default_rng(4)
    z, u = rng.normal(size=n_z), rng.normal(size=n_u)
    symbols = np.concatenate([u, [0.0], z, np.zeros(N), [0.0]])
    x = states(symbols).full()
    free = states(np.concatenate([0 * u, [0.0], z, np.zeros(N), [0.0]])).full()
    one = [states(np.concatenate([e, np.zeros(n_z + N + 2)])).full() for e in np.eye(n_u)]
    np.testing.assert_allclose(
        x, free + np.tensordot(u, one, 1), atol=1e-9 * np.abs(x).max(axis=1, keepdims=True).max()
    )
    followed = np.array([(mpc.observer.C[0, : len(x)] @ part) for part in one])
    q, r, s = (1.0 / scale**2 for scale in (want.angle_scale, want.opening_scale, want.move_scale))
    D = np.eye(n_u) - np.eye(n_u, k=-1)
    ends = np.array([part[:, -1] for part in one])
    cost_to_go = 0.5 * (
        p.H[:n_u, :n_u] - 2.0 * (q * followed @ followed.T + r * np.diag(want.blocks) + s * D.T @ D)
    )
    # What is left of the Hessian is the cost to go of the last state.
    assert np.linalg.matrix_rank(cost_to_go, tol=1e-9 * np.abs(p.H).max()) <= len(x)
    assert np.linalg.eigvalsh(cost_to_go).min() > -1e-9 * np.abs(p.H).max()
    assert ends.shape == (n_u, len(x))
    np.testing.assert_array_equal(p.A[:n_u, :n_u], D)


def test_hessian_and_gradient_are_those_of_the_expression(
    known: tuple[LinearMPC, Formulation],
) -> None:
    mpc, problem = known
    p = mpc.prediction
    n, n_z, N = len(p.H), p.g_estimate.shape[1], p.samples
    slope = ca.Function(
        "slope", [problem.symbols], [ca.gradient(problem.cost, problem.symbols)[:n], problem.rows]
    )
    rng = np.random.default_rng(5)
    x, z, path, before = rng.normal(size=n), rng.normal(size=n_z), rng.normal(size=N), 0.3
    found, rows = (v.full().ravel() for v in slope(np.concatenate([x, z, path, [before]])))
    expected = p.H @ x + p.g_estimate @ z + p.g_reference @ path + p.g_before[:, 0] * before
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(p.H).max())
    beside = np.zeros(len(rows))
    beside[0] = -before
    np.testing.assert_allclose(rows, p.A @ x + p.rows_estimate @ z + beside, atol=1e-12)


def test_user_changes_the_cost_and_it_goes_to_c(linear: LinearModel, tmp_path: Path) -> None:
    def calmer(problem: Formulation) -> Formulation:
        return replace(problem, cost=problem.cost + 300.0 * ca.sumsqr(ca.diff(problem.openings)))

    row = tuple(linear.y0[:3].tolist())
    asked = (row[0] + 0.005,)
    openings = []
    for law in (design_mpc(linear), design_mpc(linear, change=calmer)):
        state = law.initial_state(row)
        for _ in range(3):
            command, state, info = law.step(state, row, asked)
        openings.append(float(info["opening"]))
    assert 0.0 < openings[1] < 0.8 * openings[0] < 0.8
    in_c = InC(law, tmp_path)
    in_c.start(row)
    for _ in range(3):
        in_c.step(row, asked)
    assert in_c.command[0] == pytest.approx(command[0], abs=1e-9)


def test_what_a_program_cannot_hold_is_refused(linear: LinearModel) -> None:
    with pytest.raises(WorkbenchError, match="not quadratic"):
        design_mpc(linear, change=lambda f: replace(f, cost=f.cost + ca.sum1(f.moves**4)))
    with pytest.raises(WorkbenchError, match="a constant"):
        design_mpc(linear, change=lambda f: replace(f, cost=f.cost + 1e3 * f.moves[0]))


@pytest.mark.parametrize("plant", ["1 / (s (0.2 s + 1))", "2 exp(-0.3 s) / (s + 1)"])
def test_the_problem_of_any_plant_may_be_changed(plant: str, tmp_path: Path) -> None:
    # The second one predicts with its delay held sample by sample, from states foretold.
    usual = design_plain_mpc(plant)

    def kept_below(problem: Formulation) -> Formulation:
        outputs = problem.outputs[0, :].T
        rows = ca.vertcat(problem.rows, outputs - 1e-4 * problem.slack)
        ends = np.full(outputs.numel(), 1e9)
        lower, upper = np.append(problem.lower, -ends), np.append(problem.upper, 0.0 * ends + 0.6)
        return replace(problem, rows=rows, lower=lower, upper=upper)

    ends, h = {}, usual.sample_time
    scenario = Scenario("step", {"y": Steps((0.0, 0.1), (0.0, 1.0))}, 6.0, sample_time=h)
    for law in (usual, usual.changed(kept_below)):
        ends[law] = verify(law, plant, scenario.without_imperfections()).outputs[-1, 0]
    asked, limited = ends.values()
    assert asked == pytest.approx(1.0, abs=0.02) and limited == pytest.approx(0.6, abs=0.02)
    in_c, state = InC(law, tmp_path), law.initial_state((0.0,))
    in_c.start((0.0,))
    for _ in range(40):
        command, state, _ = law.step(state, (0.0,), (1.0,))
        in_c.step((0.0,), (1.0,))
        assert in_c.command[0] == pytest.approx(command[0], abs=1e-9)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda f: None, "returns a NoneType"),
        (lambda f: replace(f, cost=f.cost + ca.MX.sym("mass") ** 2), "hold mass, which nothing"),
        (lambda f: replace(f, upper=f.upper[1:]), r"\d+ rows, \d+ lower and \d+ upper limits"),
        (lambda f: replace(f, cost=f.cost - 1e6 * ca.sumsqr(f.moves)), "has no minimum"),
        (lambda f: f.costs, "change of an MPC's problem failed: AttributeError"),
    ],
)
def test_a_mistake_in_a_change_is_a_sentence(
    linear: LinearModel, change: Change, told: str
) -> None:
    with pytest.raises(WorkbenchError, match=told):
        design_mpc(linear, change=change)


@pytest.mark.parametrize("solver", OPTIONS)
def test_solvers_agree(solver: str, linear: LinearModel) -> None:
    row = tuple(linear.y0[:3].tolist())
    laws = [
        design_mpc(linear, MPCSpecification(solver=name, pressure_limits=(3e5, 5e5)))
        for name in (OWN, solver)
    ]
    states = [laws[0].initial_state(row)]
    rng = np.random.default_rng(6)
    for _ in range(30):
        seen = tuple(row + np.array([0.01, 2e4, 2e4]) * rng.normal(size=3))
        steps = [law.step(states[0], seen, (row[0] + 0.2,)) for law in laws]
        told = [info for _, _, info in steps]
        states = [steps[0][1]]
        assert told[1]["status"] == told[0]["status"]
        assert told[1]["opening"] == pytest.approx(told[0]["opening"], abs=1e-5)


def test_unknown_solver_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="solver"):
        quadratic_program(1, 1, "simplex")
