"""Refits to free runs, of equations that lack something, on data from SciPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import pytest

from tests.diagnosis.newcomers import oscillations, oscillator
from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import FreeRun, free_run
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit, fit_with_process_noise
from workbench.diagnosis.selection import simulation_error
from workbench.diagnosis.selection.held_out import run_errors
from workbench.diagnosis.selection.rules import IMPERFECT
from workbench.diagnosis.selection.simulation_error import closest_runs
from workbench.model import Model
from workbench.physics.friction import coulomb_friction


@dataclass(frozen=True)
class Case:
    """A refitted oscillator that lacks dry friction, or rounds it, with its recordings."""

    model: Model
    fit: ProcessNoiseFit
    fitting: tuple[Observed, ...]
    judging: tuple[Observed, ...]

    @cached_property
    def closer(self) -> ProcessNoiseFit:
        return closest_runs(self.fit, self.model, self.fitting, self.judging)

    def error(self, fit: ProcessNoiseFit, **values: float) -> float:
        """Mean square of the error of free runs on the fitting recordings, in m2."""
        other = replace(fit, refit=replace(fit.refit, model=fit.model.with_parameters(values)))
        return float(run_errors(other, self.model, self.fitting).mean[0])


@lru_cache(maxsize=2)
def lacking(*, rounded: bool = False) -> Case:
    """Fit an oscillator without dry friction, or with a rounded one, to one that has 4 N."""
    model = oscillator()
    if rounded:
        model = model.with_effect(
            coulomb_friction("mass.force", level=2.0, transition_speed=1.0, upper=20.0)
        )
    runs = oscillations(lambda x, v: -30.0 * x - 0.6 * v - 4.0 * np.tanh(v / 0.01))
    seen = tuple(observe(model, run) for run in runs)
    fit = fit_with_process_noise(model, seen[:2], default_priors(model))
    return Case(model, fit, seen[:2], seen[2:])


def test_runs_get_closer_to_recordings_that_were_not_fitted() -> None:
    case = lacking()
    assert case.fit.noise_scale > IMPERFECT
    before, after = (run_errors(fit, case.model, case.judging) for fit in (case.fit, case.closer))
    assert after.mean[0] < 0.95 * before.mean[0]
    # What it cost to predict the next sample is that of the fit to prediction errors.
    assert case.closer.cost == case.fit.cost and case.closer.noise_scale == case.fit.noise_scale


def test_no_value_beside_the_found_ones_runs_closer() -> None:
    case = lacking()
    least = case.error(case.closer)
    for estimate in case.closer.refit.estimates:
        for factor in (0.9, 1.1):
            beside = case.error(case.closer, **{estimate.name: factor * estimate.value})
            assert beside > 0.999 * least, estimate.name


def test_intervals_come_from_the_scatter_between_blocks() -> None:
    case = lacking()
    halves = [closest_runs(case.fit, case.model, [one], case.judging).refit for one in case.fitting]
    for estimate, one, other in zip(
        case.closer.refit.estimates, *(half.estimates for half in halves), strict=True
    ):
        apart = abs(one.value - other.value)
        assert 0.0 < apart < 10.0 * estimate.std, estimate.name
    assert np.allclose(
        np.sqrt(np.diag(case.closer.refit.covariance)), [e.std for e in case.closer.refit.estimates]
    )


def test_complete_equations_and_long_work_keep_their_estimates(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case = lacking()
    complete = replace(case.fit, noise_scale=IMPERFECT)
    assert closest_runs(complete, case.model, case.fitting, case.judging) is complete
    monkeypatch.setattr(simulation_error, "_MOST_WORK", 1.0)
    assert closest_runs(case.fit, case.model, case.fitting, case.judging) is case.fit
    assert closest_runs(case.fit, case.model, case.fitting, ()) is case.fit


def test_a_rounded_reversal_is_sharpened() -> None:
    case = lacking(rounded=True)
    name = "coulomb_friction.transition_speed"
    assert case.closer.model.parameter(name).value < 0.3 * case.fit.model.parameter(name).value
    # What the fit before it was off is told, as far as that was good.
    for parameter, true in (("coulomb_friction.level", 4.0), ("damping", 0.6)):
        told = case.closer.refit.estimate(parameter)
        assert abs(told.value - true) < 2.0 * told.std < 0.05 * true
    before, after = (run_errors(fit, case.model, case.judging) for fit in (case.fit, case.closer))
    assert after.mean[0] < 0.25 * before.mean[0]


def test_moments_far_off_do_not_decide_where_tails_are_heavy() -> None:
    case = lacking()
    true = oscillator().with_parameters({"stiffness": 30.0, "damping": 0.6, "mass": 1.0})
    begun, rng = [], np.random.default_rng(5)
    for seen in case.fitting:
        outputs = free_run(true, seen).simulated + 0.01 * rng.normal(size=seen.outputs.shape)
        # For a tenth of the time something else holds the mass.
        outputs[100 : 100 + len(outputs) // 10] = 1.5
        begun.append(replace(seen, outputs=outputs))
    near = replace(case.fit, refit=replace(case.fit.refit, model=true))
    found = {
        loss: simulation_error._refitted(near, begun, loss).refit.estimate("stiffness").value
        for loss in ("linear", "cauchy")
    }
    assert abs(found["cauchy"] - 30.0) < 0.1 * abs(found["linear"] - 30.0)


def test_runs_that_leave_everything_are_lost_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    case, usual = lacking(), simulation_error.free_runs
    damping = [q.name for q in case.model.parameters].index("damping")

    def runs(model: Model, begun: Sequence[Observed], *, values: Vector) -> list[FreeRun]:
        found = usual(model, begun, values=values)
        far = abs(values[damping] - case.fit.model.values[damping]) > 1e-3
        return [replace(r, simulated=r.simulated + 1e200 * far) for r in found]

    monkeypatch.setattr(simulation_error, "free_runs", runs)
    # Warnings are errors here.
    found = simulation_error._refitted(case.fit, list(case.fitting), "linear")
    assert np.isfinite(found.model.values).all()


def test_equations_without_anything_to_refit_run_as_they_are() -> None:
    case = lacking()
    given = replace(case.fit, refit=replace(case.fit.refit, estimates=()))
    # Warnings are errors here.
    assert simulation_error._refitted(given, list(case.fitting), "linear") is given
