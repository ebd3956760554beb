"""What held-out recordings say of a model that was fitted to others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import (
    ProcessNoiseFit,
    blocks_of_cost,
    fit_with_process_noise,
)
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated
from workbench.diagnosis.selection import held_out
from workbench.diagnosis.selection.held_out import RunErrors, held_out_gain, shown_on_bounds
from workbench.plants.servo_axis import servo_axis

TRUE = {"mass": 150.0, "offset": 2.0}


def test_a_value_is_wrong_where_held_out_recordings_refuse_the_usual_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    axis = servo_axis()
    axis = replace(axis, outputs=(replace(axis.outputs[0], noise_rms=2e-4),))
    seen = [
        simulated(axis, pushes(600, largest=200.0, seed=k), sample_time=0.01, values=TRUE, seed=k)
        for k in (1, 2)
    ]
    # The mass is beyond its range; of the offset the range says more than recordings can.
    narrow = {"mass": (80.0, 120.0), "offset": (-1e-4, 1e-4)}
    priors = [
        replace(p, lower=narrow[p.name][0], upper=narrow[p.name][1]) if p.name in narrow else p
        for p in default_priors(axis)
    ]
    fit = fit_with_process_noise(axis, seen[:1], priors, start={"offset": 1e-4})
    assert {e.name for e in fit.refit.estimates if e.on_bound} == {"mass", "offset"}
    assert shown_on_bounds(fit, axis, seen[:1], seen[1:], priors) == ("mass",)

    def runs(one: ProcessNoiseFit, *given: object) -> RunErrors:
        worse = np.full((9, 1), 2.0 if one is fit else 1.0)
        return RunErrors(worse, worse[0])

    # Where whole runs are closer with the usual value, it is not refused.
    monkeypatch.setattr(held_out, "run_errors", runs)
    assert shown_on_bounds(fit, axis, seen[:1], seen[1:], priors) == ()


def test_what_unseen_recordings_reach_beyond_the_others_does_not_hide_the_rest() -> None:
    axis = servo_axis()
    seen, beyond = (
        simulated(axis, pushes(600, largest=200.0, seed=k), sample_time=0.01, values=v, seed=k)
        for k, v in ((1, TRUE), (2, TRUE | {"mass": 100.0}))
    )
    fit = replace(fit_with_process_noise(axis, [seen], default_priors(axis)), noise_scale=0.003)
    without = replace(fit.with_values({"mass": 60.0, "offset": 0.0}), noise_scale=30.0)
    before = blocks_of_cost(without, [beyond])
    # A little less trust is not enough; no less than there is without it counts.
    assert held_out_gain(before, fit, [beyond])[0][1] < 0.0
    assert held_out_gain(before, fit, [beyond], without.noise_scale)[0][1] > 0.0
