"""What held-out recordings say of a model that was fitted to others."""

from __future__ import annotations

from dataclasses import replace

from workbench.diagnosis.estimation.made_up import made_up, pushes
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.selection.held_out import shown_on_bounds
from workbench.plants.servo_axis import servo_axis

TRUE = {"mass": 150.0, "offset": 2.0}


def test_a_value_is_wrong_where_held_out_recordings_refuse_the_usual_one() -> None:
    axis = servo_axis()
    axis = replace(axis, outputs=(replace(axis.outputs[0], noise_rms=2e-4),))
    seen = [
        made_up(axis, pushes(600, largest=200.0, seed=k), sample_time=0.01, values=TRUE, seed=k)
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
    assert shown_on_bounds(fit, seen[:1], seen[1:], priors) == ("mass",)
