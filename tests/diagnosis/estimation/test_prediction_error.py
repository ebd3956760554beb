"""Prediction errors and their derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from tests.diagnosis.machine_data import recording
from tests.machines import machine
from workbench.computing.counted import done
from workbench.computing.machine_code import compiler
from workbench.diagnosis.estimation.filter import Steps, exponential_of, steps_of
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import (
    Observed,
    PredictionError,
    filter_of,
    stack,
)
from workbench.diagnosis.estimation.simulated_recordings import simulated, simulated_axis
from workbench.errors import WorkbenchError
from workbench.model import Model, Scope
from workbench.model.trace import Equations
from workbench.physics.stiffness import end_stop
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording
from workbench.simulation.equations import _library as built_before

AXIS = servo_axis()
FREE = ("mass", "offset", "viscous_friction.coefficient", "coulomb_friction.level")


def _sure(seen: Observed) -> Observed:
    """Take the start as certain: without process noise the filter then simulates."""
    return replace(seen, start_rms=np.zeros_like(seen.start_rms))


def test_derivatives_are_those_of_a_simulation_when_nothing_is_corrected() -> None:
    seen = _sure(simulated_axis(3, samples=250))
    filter_ = PredictionError(AXIS, seen, FREE)
    p = AXIS.values
    jacobian = filter_.run(seen, p).jacobian[:, 0, :]
    for column, name in enumerate(FREE):
        i = [q.name for q in AXIS.parameters].index(name)
        step = 1e-4 * filter_.free_scale[column]
        ends = []
        for sign in (1, -1):
            moved = p.copy()
            moved[i] += sign * step
            part = filter_.run(seen, moved)
            # A certain start leaves the noise of the sensor as the only deviation.
            ends.append(part.whitened[:, 0] * np.exp(part.log_deviation[:, 0]))
        noise = seen.noise_rms[0] / AXIS.outputs[0].scale
        difference = (ends[0] - ends[1]) / (2e-4) / noise
        plain = np.abs(filter_.run(seen, p).whitened[:, 0]) < 4.9
        # Rounded friction makes the derivative of a reversal rough; elsewhere 1 % is the
        # error of the midpoint rule for the sensitivity.
        error = np.abs(jacobian[plain, column] - difference[plain])
        assert np.all(error <= 0.02 * np.max(np.abs(difference)) + 1e-6)


def test_whitened_errors_of_the_true_model_have_unit_variance() -> None:
    axis = replace(AXIS, outputs=(replace(AXIS.outputs[0], noise_rms=2e-4),))
    seen = replace(simulated_axis(1, samples=4000), noise_rms=np.array([2e-4]))
    noise = np.random.default_rng(0).normal(0.0, 2e-4, seen.outputs.shape)
    seen = replace(seen, outputs=seen.outputs + noise)
    p = axis.with_parameters({"mass": 100.0, "offset": 2.0}).values
    whitened = PredictionError(axis, seen, ()).run(seen, p).whitened
    # Chi-squared with 4000 degrees of freedom: 1 +- 0.022; three standard deviations.
    assert np.mean(whitened**2) == pytest.approx(1.0, abs=0.07)


def test_length_need_not_be_a_multiple_of_the_block() -> None:
    seen = simulated_axis(2, samples=230)
    filter_ = PredictionError(AXIS, seen, ("mass",), {"axis.force": 1.0})
    whole = filter_.run(seen, AXIS.values)
    part = filter_.run(
        replace(seen, inputs=seen.inputs[:123], outputs=seen.outputs[:123]), AXIS.values
    )
    assert np.array_equal(part.whitened, whole.whitened[:123])
    assert np.array_equal(part.jacobian, whole.jacobian[:123])


def test_missing_measurements_are_left_out() -> None:
    seen = simulated_axis(2, samples=200)
    gaps = seen.outputs.copy()
    gaps[50:60] = np.nan
    part = PredictionError(AXIS, seen, ("mass",)).run(replace(seen, outputs=gaps), AXIS.values)
    errors, rows = stack([part])
    assert len(errors) == len(rows) == 190
    assert np.isnan(part.whitened[50:60]).all()


def test_an_outlier_counts_five_and_pulls_as_its_logarithm() -> None:
    seen = replace(_sure(simulated_axis(2, samples=100)), start=np.zeros(2))
    seen = replace(seen, noise_rms=np.array([1e-4]))
    p = AXIS.with_parameters({"mass": 100.0, "offset": 2.0}).values
    filter_ = PredictionError(AXIS, seen, ("offset",))
    plain = filter_.run(seen, p)
    spoilt = seen.outputs.copy()
    spoilt[80] += 1.0
    part = filter_.run(replace(seen, outputs=spoilt), p)
    assert part.whitened[80, 0] == pytest.approx(5.0)
    # d log|e| / dp = (de / dp) / e, where the whitened error is 5.
    size = np.exp(plain.log_deviation[80, 0])
    slope = plain.jacobian[80, 0, 0] * size
    expected = slope / (1.0 / AXIS.outputs[0].scale)
    assert part.jacobian[80, 0, 0] * 5.0 == pytest.approx(expected, rel=1e-3)


def test_unknown_names_are_refused() -> None:
    seen = simulated_axis(2, samples=50)
    with pytest.raises(WorkbenchError, match="parameter is 'mas'"):
        PredictionError(AXIS, seen, ("mas",))
    with pytest.raises(WorkbenchError, match="port is 'axis'"):
        PredictionError(AXIS, seen, (), {"axis": 1.0})


@pytest.mark.skipif(compiler() is None, reason="there is no C compiler to compare with")
@pytest.mark.parametrize("steps", [None, Steps(0, 3), Steps(1, 24), Steps(2, 8)])
def test_without_a_compiler_the_filter_gives_the_same(
    steps: Steps | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = simulated_axis(2, samples=330)
    seen.outputs[40:45] = np.nan
    seen.outputs[200] += 0.05  # an outlier
    disturbed = {AXIS.ports[0].name: 3.0}
    found = []
    for setting in ("", "none"):
        monkeypatch.setenv("WORKBENCH_CC", setting)
        compiler.cache_clear()
        built_before.cache_clear()
        runs = PredictionError(AXIS, seen, FREE, disturbed)
        runs._steps = steps or runs._steps
        found.append(runs.run(seen, AXIS.values))
    monkeypatch.undo()
    compiler.cache_clear()
    built_before.cache_clear()
    for name in ("whitened", "jacobian", "log_deviation", "states"):
        ours, other = (getattr(run, name) for run in found)
        np.testing.assert_allclose(ours, other, rtol=1e-9, atol=1e-9 * np.nanmax(np.abs(other)))
    assert np.isnan(found[0].whitened[40:45]).all()


def test_few_steps_do_where_nothing_bends_and_a_contact_gets_all() -> None:
    model = AXIS.with_effect(
        end_stop("axis.force", stiffness=2e7, place=-0.25, side=-1.0, loss=0.5)
    )
    force = 100.0 * np.sin(0.5 * np.pi * 0.01 * np.arange(600)) - 20.0
    seen = _sure(simulated(model, force, sample_time=0.01))
    assert 1 <= (seen.outputs < -0.25).sum() <= 10
    # The same with 63 samples that nobody reads between two.
    often = np.full((600 * 64, 1), np.nan)
    often[::64] = seen.outputs
    finer = replace(
        seen, sample_time=0.01 / 64, inputs=np.repeat(seen.inputs, 64, axis=0), outputs=often
    )
    work, found = [], []
    for observed, every in ((seen, 1), (finer, 64)):
        runs = PredictionError(model, observed, FREE, {"axis.force": 1.0})
        before = done()["model_evaluations"]
        found.append(runs.run(observed, model.values).states[::every])
        work.append(done()["model_evaluations"] - before)
    ours, other = (states / states.std(axis=0) for states in found)
    np.testing.assert_allclose(ours, other, rtol=0, atol=3e-3)
    assert 5 * work[0] < work[1]


@pytest.mark.parametrize("fastest", [0.1, 3.0, 3e5])
def test_the_exponential_of_stiff_slopes_fades_as_it_should(fastest: float) -> None:
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    slopes = turn @ np.diag([-fastest, -fastest / 2, -0.1, 0.0]) @ turn.T
    transition, mean = (np.asarray(v) for v in exponential_of(4)(slopes))
    np.testing.assert_allclose(transition, expm(slopes), atol=1e-3)
    # The second block of the exponential of this matrix is the integral of the first.
    both = expm(np.block([[slopes, np.eye(4)], [np.zeros((4, 8))]]))
    np.testing.assert_allclose(mean, both[:4, 4:], atol=1e-3)


SAMPLE, MASS, STIFFNESS, DAMPING, NOISE = 0.002, 0.7, 2e4, 60.0, 1e-6


def _push(position: float, speed: float) -> float:
    """Return the force of a stop at the origin, in N, on a mass behind it."""
    return max(0.0, -STIFFNESS * position - DAMPING * speed) if position < 0.0 else 0.0


def _falling() -> Recording:
    """Let a mass fall on a stop again and again, by Heun's method in far finer steps."""
    rng = np.random.default_rng(3)
    n, parts = 3000, 200
    h, position, speed, read = SAMPLE / parts, 0.05, 0.0, []
    force = np.repeat(rng.uniform(-9.0, 5.0, n // 60), 60)

    def acceleration(at: float, moving: float, pushed: float) -> float:
        return (pushed - 2.0 * moving - 20.0 * (at - 0.02) + _push(at, moving)) / MASS

    for pushed in force.tolist():
        read.append(position)
        for _ in range(parts):
            first = acceleration(position, speed, pushed)
            second = acceleration(position + h * speed, speed + h * first, pushed)
            position += h * (speed + 0.5 * h * first)
            speed += 0.5 * h * (first + second)
    position = np.array(read) + NOISE * rng.normal(size=n)
    return recording("falling", SAMPLE, {"force [N]": force}, {"position [m]": position})


def _before_a_stop() -> Model:
    def equations(m: Scope) -> Equations:
        x, p = m.x, m.p
        push = m.form.ramp(-p.stiffness * x.position - p.damping * x.speed, 1.0)
        touching = m.form.step(-x.position, 1e-6)
        stop = m.port("stop", touching * push, unit="N", scale=10.0, relative_disturbance=0.1)
        force = m.u.force - 2.0 * x.speed - 20.0 * (x.position - 0.02) + stop
        return {"position": x.speed, "speed": force / MASS}, {"position": x.position}

    return machine(
        equations,
        "position m 0.05 scale=0.05, speed m/s scale=1",
        "force N scale=10",
        f"position m {NOISE} scale=0.05",
        f"stiffness N/m {STIFFNESS}, damping N s/m {DAMPING}",
    )


def test_a_stop_that_is_met_between_samples_is_predicted_to_the_noise() -> None:
    model = _before_a_stop()
    seen = observe(model, _falling())
    errors = filter_of(model, seen, 0.003, ["stiffness"]).run(seen, model.values).whitened
    # An impact is an outlier of 5 standard deviations where steps do not end at the stop.
    assert np.abs(errors).max() < 4.5
    assert np.mean(errors**2) < 1.0


def test_the_rounded_corner_of_a_stop_asks_for_no_steps() -> None:
    model, rest = _before_a_stop(), [0.02, 0.0]
    # A mass meets the stop at 1 m/s, or is away from it.
    met, away = (
        steps_of(model, SAMPLE, np.array([rest, [place, -1.0]]), np.zeros((2, 1)))
        for place in (0.0, 0.01)
    )
    assert met == away


def test_whole_numbers_are_read_as_what_they_are() -> None:
    """In memory a whole 300 stands otherwise than a number of 300.0: C code read 1.5e-321."""
    plain = machine(
        lambda m: {"heater": m.u.heat - m.x.heater, "tip": m.x.heater - m.x.tip},
        "heater K scale=300, tip K scale=300",
        "heat K",
        "tip K 0.02 scale=300",
    )
    whole = replace(plain, states=tuple(replace(q, scale=int(q.scale)) for q in plain.states))
    assert [q.scale for q in whole.states] == [300.0, 300.0]
    assert all(isinstance(q.scale, float) for q in whole.states)
    heat, tip = np.linspace(0.0, 50.0, 200), np.sin(np.arange(200.0))
    seen = observe(plain, recording("tip", 0.1, {"heat [K]": heat}, {"tip [K]": tip}))
    found, other = (filter_of(model, seen, 1.0).run(seen, model.values) for model in (plain, whole))
    np.testing.assert_array_equal(found.states, other.states)
