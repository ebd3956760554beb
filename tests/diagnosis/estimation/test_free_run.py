"""Free runs beside recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.machines import machine
from workbench.diagnosis.estimation.free_run import free_run, free_runs
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.errors import WorkbenchError
from workbench.physics.friction import viscous_friction
from workbench.plants.servo_axis import servo_axis


def _pushed(n: int = 400, *, force: float = 150.0) -> Observed:
    inputs = np.full((n, 1), force)
    return Observed(
        "push",
        0.005,
        inputs,
        np.zeros((n, 1)),
        ("position",),
        np.array([1e-6]),
        np.zeros(2),
        np.zeros(2),
    )


def test_position_under_constant_force_is_that_of_the_closed_form() -> None:
    axis = servo_axis().without("coulomb_friction").with_parameters({"mass": 100.0})
    run = free_run(axis, _pushed())
    tau = 100.0 / 200.0
    exact = 150.0 / 200.0 * (run.time - tau * (1 - np.exp(-run.time / tau)))
    # 1e-6 of the scale 0.1 m per step, and errors of the steps add.
    assert np.max(np.abs(run.simulated[:, 0] - exact)) < 1e-6
    assert run.rmse["position"] == pytest.approx(float(np.sqrt(np.mean(exact**2))), rel=1e-4)


def test_samples_without_measurement_do_not_count() -> None:
    seen = _pushed(force=0.0)
    seen.outputs[::2] = np.nan
    seen.outputs[1::2] = 0.25
    assert free_run(servo_axis(), seen).rmse["position"] == pytest.approx(0.25)


def test_a_model_with_a_further_effect_runs_on_the_same_recording() -> None:
    stiff = servo_axis().with_effect(
        replace(viscous_friction("axis.force", coefficient=100.0), name="more")
    )
    assert (
        free_run(stiff, _pushed()).simulated[-1, 0]
        < free_run(servo_axis(), _pushed()).simulated[-1, 0]
    )


def test_commands_beyond_the_range_are_those_of_the_saturated_actuator() -> None:
    high, limit = (
        free_run(servo_axis(), _pushed(force=900.0)),
        free_run(servo_axis(), _pushed(force=350.0)),
    )
    assert np.array_equal(high.simulated, limit.simulated)


def test_a_run_that_leaves_the_numbers_is_returned_with_the_reason() -> None:
    axis = servo_axis()
    unstable = axis.values
    unstable[[q.name for q in axis.parameters].index("viscous_friction.coefficient")] = -1e6
    run = free_run(axis, _pushed(4000), values=unstable)
    assert not run.finite
    assert run.rmse["position"] == np.inf
    assert "integrator" in run.failure


def test_states_of_another_model_are_refused() -> None:
    seen = _pushed()
    wrong = Observed(
        *(
            getattr(seen, f)
            for f in ("name", "sample_time", "inputs", "outputs", "used", "noise_rms")
        ),
        np.zeros(5),
        np.zeros(5),
    )
    with pytest.raises(WorkbenchError, match="observed with 5 states"):
        free_run(servo_axis(), wrong)


def test_pieces_run_together_as_each_does_alone() -> None:
    axis = servo_axis()
    values = axis.with_parameters({"mass": 80.0}).values
    pieces = [_pushed(n, force=force) for n, force in ((40, 150.0), (7, 900.0), (150, -60.0))]
    for piece, run in zip(pieces, free_runs(axis, pieces, values=values), strict=True):
        alone = free_run(axis, piece, values=values)
        assert run.finite
        assert run.simulated.shape == piece.outputs.shape
        # The steps of an integrator follow those before: two runs differ by its tolerance.
        assert run.simulated == pytest.approx(alone.simulated, abs=1e-6)


def test_a_piece_that_a_model_cannot_follow_does_not_spoil_the_others() -> None:
    escape = machine(
        lambda m: {"position": m.u.force * m.x.position**2},
        "position m scale=1",
        "force N scale=1",
        "position m scale=1",
    )
    # dx/dt = x^2 from 1 is infinite after 1 s.
    start, known = np.ones(1), np.zeros(1)
    calm, lost = (
        replace(_pushed(n, force=force), start=start, start_rms=known)
        for n, force in ((100, 0.0), (400, 1.0))
    )
    first, second, third = free_runs(escape, [calm, lost, calm])
    assert second.failure
    assert np.isnan(second.simulated).all()
    for run in (first, third):
        assert run.simulated[:, 0] == pytest.approx(1.0)
