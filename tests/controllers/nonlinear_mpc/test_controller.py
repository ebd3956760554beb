"""The nonlinear MPC: its functions, its step against converged solvers, and the full plant."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from controllers.nonlinear_mpc.controller import (
    NonlinearMPC,
    NonlinearMPCSpecification,
    design_nonlinear_mpc,
)
from controllers.nonlinear_mpc.prediction import discrete, dynamics, shooting
from tests.controllers.families import assert_settles, moves
from tests.controllers.nonlinear_mpc.converged import converged
from workbench.computing.buffered import Buffered
from workbench.errors import WorkbenchError
from workbench.linearisation.actuator_inverse import straightened
from workbench.model import REGULARISED, Model
from workbench.operating_point import operating_point
from workbench.simulation.equations import compiled
from workbench.simulation.stepper import Stepper
from workbench.verification import metrics, verify

REST, GOAL = (math.radians(30), 4.2e5, 4.2e5), (math.radians(33),)

DISTURBED = ("speed", "pressure_1", "pressure_2")


@pytest.fixture(scope="module")
def mpc(plant: Model) -> NonlinearMPC:
    return design_nonlinear_mpc(plant.without("bearing_friction"), compile_function=compiled)


def problem(mpc: NonlinearMPC, plant: Model) -> tuple[np.ndarray, np.ndarray]:
    point = operating_point(plant, {"angle": math.radians(20)})
    start = mpc.predicted(point.x / mpc.observer.rates.scale)
    return start, np.array([2.0, 0.5, -0.5, 0.05])


def test_a_stage_is_the_plant_over_its_duration(mpc: NonlinearMPC, plant: Model) -> None:
    # Independent route: adaptive integration of the whole plant, spool included. The spool lags by
    # 2 to 3 ms of 20 ms, so it starts where it is commanded.
    proportional = straightened(plant.without("bearing_friction"), "opening")
    names = [q.name for q in proportional.states]
    x = operating_point(plant, {"angle": math.radians(20)}).x.copy()
    x[names.index("spool")] = 1.5
    stepper = Stepper(proportional, 0.02, tolerance=1e-10, form=REGULARISED)
    there = stepper.step(x, [6.5])
    z = mpc.predicted(x / mpc.observer.rates.scale)
    end = np.asarray(mpc.stage(z, 6.5, np.zeros(4))[0]).ravel() * mpc.prediction.scale
    expected = np.array([there[names.index(name)] for name in mpc.prediction.names])
    # Runge-Kutta of fourth order in steps of 5 ms
    np.testing.assert_allclose(end / expected, 1.0, atol=2e-4)


def test_derivatives_are_those_of_the_discrete_map(plant: Model) -> None:
    rates = dynamics(
        straightened(plant, "opening"),
        DISTURBED,
        unknown=("supply_pressure",),
        resting=("spool", "spool_speed"),
    )
    stage = discrete(rates, 0.02, 2, "stage")
    x = plant.initial_state()
    names = [q.name for q in plant.states]
    z = np.array([x[names.index(name)] for name in rates.names]) / rates.scale
    z[rates.names.index("speed")] = 0.7
    at = [z, np.array([5.8]), np.array([1.0, 0.3, -0.2, -0.1])]
    results = [np.asarray(r) for r in stage(*at)]
    step = 1e-6
    for which, derivative in enumerate(results[1:]):
        for column in range(derivative.shape[1]):
            moved = [[v.copy() for v in at] for _ in range(2)]
            moved[0][which][column] -= step
            moved[1][which][column] += step
            low, high = (np.asarray(stage(*m)[0]).ravel() for m in moved)
            # Central differences of 1e-6: rounding 1e-10 of numbers up to 30
            np.testing.assert_allclose(
                derivative[:, column], (high - low) / (2 * step), rtol=1e-5, atol=1e-6
            )


def test_shots_are_stages_side_by_side(plant: Model) -> None:
    rates = dynamics(straightened(plant, "opening"), DISTURBED, resting=("spool", "spool_speed"))
    stage = discrete(rates, 0.02, 2, "stage")
    rng = np.random.default_rng(3)
    x = plant.initial_state()[[q.name for q in plant.states].index("pressure_1") :]
    z = x / rates.scale
    Z = z[:, None] * (1 + 0.05 * rng.standard_normal((len(z), 3)))
    U = np.array([[4.0, 5.0, 6.5]])
    W = np.array([[0.5, 0.4, 0.3], [0.1, 0.0, -0.1], [0.2, 0.2, 0.2]])
    ends, by_z, by_u = Buffered(shooting(stage, 3))(Z, U, W)
    for k in range(3):
        end, A, B, _ = (np.asarray(r) for r in stage(Z[:, k], U[:, k], W[:, k]))
        np.testing.assert_allclose(ends[:, k], end.ravel(), rtol=1e-14)
        np.testing.assert_allclose(by_z[:, 6 * k : 6 * k + 6], A, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(by_u[:, k], B.ravel(), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("tight", [False, True], ids=["free", "at limits"])
def test_the_step_iterated_is_the_converged_solution(plant: Model, tight: bool) -> None:
    # The filled muscle needs more than 4.9 bar on the way, and the opening more than 0.3.
    wanted = NonlinearMPCSpecification(
        stages=10,
        steps=2,
        opening_limit=0.3 if tight else 1.0,
        pressure_limits=(2e5, 4.9e5) if tight else (0.1e5, 5.9e5),
    )
    mpc = design_nonlinear_mpc(plant.without("bearing_friction"), wanted)
    start, w = problem(mpc, plant)
    N = mpc.specification.stages
    path = np.full(N + 1, math.radians(40.0))
    plan, trajectory = np.zeros(N), np.tile(start[:, None], (1, N + 1))
    for _ in range(60):
        step = mpc.improve(plan, trajectory, start, w, path, 0.0)
        assert step.solution.solved
        change = float(np.abs(step.plan - plan).max())
        plan, trajectory = step.plan, step.trajectory
        if change < 1e-8:
            break
    assert change < 1e-7
    reference = converged(mpc, start, w, path, 0.0)
    # An interior-point solver stops a little inside limits that are met exactly here.
    np.testing.assert_allclose(plan, reference.plan, atol=2e-4)
    np.testing.assert_allclose(trajectory, reference.trajectory, rtol=1e-4, atol=1e-4)
    assert step.slack == pytest.approx(reference.slack, abs=50.0)
    if tight:
        assert np.abs(plan).max() == pytest.approx(0.3, abs=1e-6)
        # The penalty is exact: a limit that can be kept is kept.
        chambers = [mpc.prediction.names.index(f"pressure_{i}") for i in (1, 2)]
        pressures = trajectory[chambers] * mpc.prediction.scale[chambers, None]
        assert pressures.max() == pytest.approx(mpc.pressure_limits[1], abs=100.0)


def test_a_failed_solve_follows_the_plan(mpc: NonlinearMPC) -> None:
    state = mpc.initial_state(REST)
    for _ in range(5):
        _, state, info = mpc.step(state, REST, GOAL)
    assert info["fallback"] == 0.0
    broken = state._replace(trajectory=np.full_like(state.trajectory, np.nan))
    (voltage,), after, info = mpc.step(broken, REST, GOAL)
    assert info["fallback"] == 1.0 and info["status"]
    assert voltage == pytest.approx(mpc.valve.command(float(info["opening"])))
    # It recovers by itself: the trajectory is started anew from the estimate.
    (_,), _, info = mpc.step(after, REST, GOAL)
    assert info["fallback"] == 0.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e5, 1e200])
def test_an_estimate_that_runs_away_starts_anew(mpc: NonlinearMPC, size: float) -> None:
    state = mpc.initial_state(REST)
    hot = state.estimate.copy()
    hot[mpc.observer.rates.names.index("temperature_1")] = size
    _, after, info = mpc.step(state._replace(estimate=hot), REST, GOAL)
    assert info["fallback"] == 1.0
    assert np.isfinite(after.estimate).all() and np.isfinite(after.covariance).all()
    for _ in range(3):
        (voltage,), after, info = mpc.step(after, REST, GOAL)
    assert info["fallback"] == 0.0 and math.isfinite(voltage)


def test_an_estimate_that_may_be_anywhere_starts_anew(mpc: NonlinearMPC) -> None:
    state = mpc.initial_state(REST)
    anywhere = state._replace(covariance=1e12 * np.eye(len(state.covariance)))
    _, after, info = mpc.step(anywhere, REST, GOAL)
    assert info["fallback"] == 1.0 and after.covariance.max() <= state.covariance.max()


@pytest.mark.filterwarnings("error")
def test_measurements_that_no_plant_has_leave_numbers(mpc: NonlinearMPC) -> None:
    state = mpc.initial_state(REST)
    for _ in range(20):
        (voltage,), state, _ = mpc.step(state, (REST[0], 1e12, REST[2]), GOAL)
        assert math.isfinite(voltage)
    for _ in range(3):
        (voltage,), state, info = mpc.step(state, REST, GOAL)
    assert info["fallback"] == 0.0 and np.isfinite(state.estimate).all()


def test_a_step_changes_nothing_but_what_it_returns(mpc: NonlinearMPC) -> None:
    state = mpc.initial_state(REST)
    first = mpc.step(state, REST, GOAL)
    mpc.step(first[1], REST, (0.2,))
    again = mpc.step(state, REST, GOAL)
    assert first[0] == again[0]
    np.testing.assert_array_equal(first[1].plan, again[1].plan)
    np.testing.assert_array_equal(first[1].estimate, again[1].estimate)


def test_it_can_be_sent_to_another_process(plant: Model) -> None:
    mpc = design_nonlinear_mpc(plant, NonlinearMPCSpecification(stages=3))
    copy = pickle.loads(pickle.dumps(mpc))  # noqa: S301
    here, there = (each.step(each.initial_state(REST), REST, GOAL) for each in (mpc, copy))
    assert here[0] == there[0]


def test_steps_on_the_plant_settle_without_offset(
    mpc: NonlinearMPC, plant_with_hysteresis: Model
) -> None:
    steps = moves((0.2, 1.4), 15, 45, 30, duration=2.6)
    assert_settles(mpc, plant_with_hysteresis, steps, 0.4)


def test_a_rate_that_is_missed_for_a_moment_does_not_fill_the_horizon(
    mpc: NonlinearMPC, plant: Model
) -> None:
    want = mpc.specification
    start = mpc.predicted(
        operating_point(plant, {"angle": math.radians(50)}).x / mpc.observer.rates.scale
    )
    plan, still = np.zeros(want.stages), np.tile(start[:, None], (1, want.stages + 1))
    path = np.full(want.stages + 1, math.radians(50.0))
    # The noise of the pressures is estimated as rates of some bar/s.
    missed = np.array([0.0, 4.0, 4.0, 0.0])
    ends = mpc.improve(plan, still, start, missed, path, 0.0)
    assert np.abs(ends.plan).max() < 0.1
    # What lasts is the torque, as another load's weight.
    np.testing.assert_allclose(mpc.fading[[0, 3]], 1.0)
    np.testing.assert_allclose(mpc.fading[1], np.exp(-np.arange(20) * 0.02 / want.fading_time))


@pytest.mark.parametrize("supply", [5e5, 7e5])
def test_another_supply_leaves_no_offset(
    mpc: NonlinearMPC, plant_with_hysteresis: Model, supply: float
) -> None:
    move = moves((0.1,), 34, 54, duration=1.1)
    rig = plant_with_hysteresis.with_parameters({"supply_pressure": supply})
    found = metrics(verify(mpc, rig, move))
    assert found["steady_error"].value < math.radians(0.05)
    assert found["oscillation"].value < math.radians(0.05)


def test_a_supply_that_is_lower_than_known_is_found_on_the_first_move(
    mpc: NonlinearMPC, plant: Model
) -> None:
    move = moves((0.1,), 34, 54, duration=0.5)
    run = verify(mpc, plant.with_parameters({"supply_pressure": 4.5e5}), move)
    believed = run.info("supply_pressure")
    # It hardly shows at rest.
    assert believed[run.time < 0.1].min() > 5.7e5
    assert believed[-1] == pytest.approx(4.5e5, abs=1e4)


def test_preview_moves_before_the_step(plant: Model) -> None:
    wanted = NonlinearMPCSpecification(preview=True)
    mpc = design_nonlinear_mpc(plant, wanted, compile_function=compiled)
    assert mpc.preview == 200
    step = moves((0.3,), 23, 34, duration=0.6).without_imperfections()
    run = verify(mpc, plant, step)
    assert run["angle"][run.time < 0.3][-1] > 0.42
    assert metrics(run)["rmse"].value < 0.05


def test_wrong_specifications_are_named(plant: Model) -> None:
    with pytest.raises(WorkbenchError, match="as many disturbances as sensors"):
        design_nonlinear_mpc(plant, NonlinearMPCSpecification(disturbances={"pressure_1": 1.0}))
    with pytest.raises(WorkbenchError, match="highest pressure"):
        NonlinearMPCSpecification(pressure_limits=(5e5, 1e5))
