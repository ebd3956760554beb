"""A simulation that cannot be trusted is refused; one that left a law's range says so."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.simulation.plants import bristled_axis, convection, explosion, integrator
from workbench.errors import NumericalError, WorkbenchError
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.simulation import Stepper, Trajectory, simulate


def test_stiff_friction_is_refused_by_the_explicit_method() -> None:
    with pytest.raises(NumericalError, match=r"rosenbrock|tighten"):
        simulate(bristled_axis(1e8), np.full(100, 300.0), sample_time=0.05, method="erk")


def test_stiff_friction_is_right_with_the_automatic_choice() -> None:
    stiffness, force = 1e8, 300.0
    run = simulate(bristled_axis(stiffness), np.full(100, force), sample_time=0.05)
    assert run.integrator.startswith("rosenbrock")

    def rates(_: float, x: np.ndarray) -> list[float]:
        drag = 200.0 * x[1] + stiffness * x[2]
        return [x[1], (force - drag) / 95.0, x[1] - stiffness * abs(x[1]) * x[2] / 20.0]

    other = solve_ivp(
        rates, (0.0, 4.95), [0.0, 0.0, 0.0], "Radau", t_eval=run.time, rtol=1e-8, atol=1e-12
    )
    assert run["position"] == pytest.approx(other.y[0], rel=1e-4, abs=1e-6)
    assert run["speed"][-1] == pytest.approx((force - 20.0) / 200.0, rel=1e-2)


def test_runs_that_part_are_refused() -> None:
    with pytest.raises(NumericalError, match="differ by"):
        simulate(convection(), np.zeros(4000), sample_time=0.01, tolerance=1e-6)


def test_a_run_to_infinity_is_refused() -> None:
    # x = 1 / (1 - t): the message names the last second that could be reached.
    with pytest.raises(NumericalError, match=r"after 0\.99 s|after 1 s") as caught:
        simulate(explosion(), np.zeros(300), sample_time=0.01)
    assert "use method='rosenbrock'" not in str(caught.value)  # it was used already


def test_without_a_check_the_difference_is_not_invented() -> None:
    run = simulate(servo_axis(), np.full(100, 50.0), sample_time=0.01, check=False)
    assert np.isnan(run.error)


def test_leaving_the_range_of_a_state_is_reported() -> None:
    run = simulate(integrator(), np.full(201, 1.0), sample_time=0.01)
    (violation,) = run.violations
    assert (violation.signal, violation.unit) == ("level", "m")
    assert violation.extreme == pytest.approx(2.0)
    assert violation.first_time == pytest.approx(1.0, abs=0.0101)
    assert violation.share == pytest.approx(0.5, abs=0.01)
    assert "level left its valid range" in str(run)


def test_running_through_a_stop_is_reported() -> None:
    # 430 deg/s into the stop: 1.2 deg deep, and the other muscle is stretched beyond its law.
    voltage = np.full(300, 5.9)
    run = simulate(arm(3.0, valve_curve="linear"), voltage, sample_time=0.002)
    names = {violation.signal for violation in run.violations}
    assert {"angle", "muscle_2.contraction"} <= names
    assert simulate(arm(3.0), np.full(300, 5.2), sample_time=0.002).violations == ()


def test_a_contraction_beyond_the_identified_range_is_reported() -> None:
    from workbench.plants.arm import pneumatic_muscle

    inputs = np.tile([0.2 - 0.0335, 0.0, 0.0], (50, 1))
    run = simulate(pneumatic_muscle(), inputs, sample_time=0.01)
    assert [v.signal for v in run.violations] == ["muscle.contraction"]
    assert run.violations[0].extreme == pytest.approx(0.0335)


def refusals() -> list[tuple[str, object, str]]:
    axis, held = servo_axis(), np.zeros(10)
    return [
        ("shape", lambda: simulate(axis, np.zeros((10, 2)), sample_time=0.01), "(samples, 1)"),
        ("one", lambda: simulate(axis, np.zeros(1), sample_time=0.01), "two samples or more"),
        ("nan", lambda: simulate(axis, held * np.nan, sample_time=0.01), "not finite"),
        ("range", lambda: simulate(axis, held + 400.0, sample_time=0.01), "-350 to 350 N"),
        ("text", lambda: simulate(axis, ["a", "b"], sample_time=0.01), "not a number"),
        ("time", lambda: simulate(axis, held, sample_time=0.0), "sample time is 0"),
        ("no time", lambda: simulate(axis, held, sample_time=float("nan")), "sample time is nan"),
        ("start", lambda: simulate(axis, held, sample_time=0.1, start=[0.0]), "needs 2"),
        ("name", lambda: simulate(axis, held, sample_time=0.1, start={"sped": 1.0}), "'speed'?"),
        ("values", lambda: simulate(axis, held, sample_time=0.1, values=[1.0]), "parameter vector"),
        ("method", lambda: simulate(axis, held, sample_time=0.1, method="rk4"), "one of auto"),
        ("tolerance", lambda: simulate(axis, held, sample_time=0.1, tolerance=1.0), "tolerance"),
        ("stepper", lambda: Stepper(axis, -1.0), "sample time is -1"),
    ]


@pytest.mark.parametrize(("call", "text"), [r[1:] for r in refusals()], ids=lambda v: str(v)[:30])
def test_mistakes_are_one_clear_sentence(call, text: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(WorkbenchError) as caught:
        call()
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return simulate(servo_axis(), np.full(50, 50.0), sample_time=0.01)


def test_a_trajectory_knows_its_signals_by_name(run: Trajectory) -> None:
    assert np.array_equal(run["speed"], run.states[:, 1])
    assert np.array_equal(run["force"], run.inputs[:, 0])
    assert run["axis.force"][0] == pytest.approx(50.0)
    with pytest.raises(WorkbenchError, match="did you mean 'axis.force'"):
        run["axis.forc"]


def test_a_trajectory_says_how_far_to_trust_it(run: Trajectory) -> None:
    text = str(run)
    assert "tolerance 1e-07" in text
    assert "ten times tighter" in text
    assert "erk" in text
