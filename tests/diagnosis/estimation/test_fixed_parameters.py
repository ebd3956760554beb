"""Intervals that count what a refit holds."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import pytest

from workbench.diagnosis.estimation.fixed_parameters import with_fixed_uncertainty
from workbench.diagnosis.estimation.made_up import made_up, pushes
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.model import Model
from workbench.physics.offset_gain import gain
from workbench.plants.servo_axis import servo_axis


def fixed(model: Model, name: str) -> Model:
    """Return a model that holds a parameter because it scales with others."""
    changed = copy(model)
    parameters = tuple(replace(q, fixed=q.name == name) for q in model.parameters)
    object.__setattr__(changed, "parameters", parameters)
    return changed


def test_what_is_held_widens_the_interval_of_what_scales_with_it() -> None:
    # A gain on the whole force cannot be told from the mass: the mass is as uncertain as the gain.
    axis = servo_axis().with_effect(
        gain(("axis.force",), excess=0.0, lower=-0.08, upper=0.08, name="drive")
    )
    seen = made_up(axis, pushes(400, largest=200.0), sample_time=0.01)
    fit = fit_with_process_noise(axis, [seen], default_priors(axis, ["mass"]))
    assert with_fixed_uncertainty(fit, [seen]) is fit
    model = fixed(fit.model, "drive.excess")
    wide = with_fixed_uncertainty(replace(fit, refit=replace(fit.refit, model=model)), [seen])
    (mass,) = wide.refit.estimates
    assert mass.value == fit.refit.estimate("mass").value
    assert fit.refit.estimate("mass").std < 0.01 * mass.value
    # A quarter of the bounds: 0.04.
    assert mass.std == pytest.approx(0.04 * mass.value, rel=0.05)
