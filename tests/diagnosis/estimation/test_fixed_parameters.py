"""Intervals that count what a refit holds."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from typing import Any

import pytest

from tests.machines import machine
from workbench.diagnosis.estimation.fixed_parameters import (
    value_instead,
    with_all_uncertainty,
    with_fixed_refitted,
    with_fixed_uncertainty,
)
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import extended_start, fit_with_process_noise
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated
from workbench.model import Model, Scope
from workbench.physics.delay import sensor_lag
from workbench.physics.friction import quadratic_drag
from workbench.physics.library import library
from workbench.physics.offset_gain import gain
from workbench.physics.saturation import slew_limit
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
    seen = simulated(axis, pushes(400, largest=200.0), sample_time=0.01)
    fit = fit_with_process_noise(axis, [seen], default_priors(axis, ["mass"]))
    assert with_fixed_uncertainty(fit, [seen]) is fit
    model = fixed(fit.model, "drive.excess")
    wide = with_fixed_uncertainty(replace(fit, refit=replace(fit.refit, model=model)), [seen])
    (mass,) = wide.refit.estimates
    assert mass.value == fit.refit.estimate("mass").value
    assert fit.refit.estimate("mass").std < 0.01 * mass.value
    # A quarter of the bounds: 0.04.
    assert mass.std == pytest.approx(0.04 * mass.value, rel=0.05)


def test_a_guess_widens_the_interval_of_what_takes_its_part() -> None:
    # A slew limit that follows small motions more slowly is later, as one with a lower rate is.
    limited = slew_limit("axis.force", share=1.0, largest_rate=1e3, time_constant=0.01)
    axis = servo_axis().with_effect(limited)
    seen = simulated(axis, pushes(400, largest=200.0), sample_time=0.01)
    names = ("mass", "slew_limit.largest_rate")
    fit = fit_with_process_noise(axis, [seen], default_priors(axis, names))
    wide = with_all_uncertainty(fit, [seen])
    assert wide.refit.values == fit.refit.values
    for before, after in zip(fit.refit.estimates, wide.refit.estimates, strict=True):
        assert after.std > 1.5 * before.std


def test_times_are_told_to_a_part_of_a_sample() -> None:
    # 400 steps of a sledge nearly without noise would tell its lag to microseconds.
    axis = servo_axis().with_effect(sensor_lag("position.reading", time=0.03))
    seen = simulated(axis, pushes(400, largest=200.0), sample_time=0.01)
    fit = fit_with_process_noise(axis, [seen], default_priors(axis, ["sensor_lag.time", "mass"]))
    (lag, mass), told = fit.refit.estimates, with_all_uncertainty(fit, [seen]).refit
    assert lag.std < 5e-5
    assert told.estimate(lag.name).std == pytest.approx(math.hypot(lag.std, 1e-4), rel=0.05)
    assert told.estimate("mass").std == pytest.approx(mass.std, rel=0.2)
    assert told.covariance[0, 0] == pytest.approx(told.estimate(lag.name).std ** 2)


def test_what_was_held_is_refitted_at_the_end_where_unseen_recordings_agree() -> None:
    axis = servo_axis()
    priors = default_priors(axis, ["mass"])
    true = {"mass": 110.0, "offset": 2e-3}
    fitting, same, other = (
        simulated(axis, pushes(400, largest=200.0, seed=k), sample_time=0.01, values=v, seed=k)
        for k, v in enumerate((true, true, {"mass": 107.0}))
    )
    given = fit_with_process_noise(axis, [fitting], priors, noise_scale=0.003)
    fit = replace(given, refit=replace(given.refit, model=fixed(given.model, "offset")))
    found = with_fixed_refitted(fit, [fitting], [same]).refit
    for name, value in true.items():
        assert abs(found.estimate(name).value - value) < 3.0 * found.estimate(name).std
    # A machine that others were recorded of keeps what it had.
    kept = with_fixed_refitted(fit, [fitting], [other]).refit
    assert [e.value for e in kept.estimates] == [given.refit.estimate("mass").value]


@pytest.mark.parametrize("fitted", [False, True])
def test_a_value_that_nobody_refits_is_told_where_an_effect_stands_for_it(fitted: bool) -> None:
    coil = machine(
        lambda m: ({"i": (m.u.U - m.p.R * m.x.i) / m.p.L}, {"I": m.x.i}),
        "i A scale=1",
        "U V scale=1",
        "I A 1e-3 scale=1",
        "R ohm 1 0.1 9, L H 0.02 2e-3 0.2",
    )
    law = next(e for e in library(coil) if e.name == "gain_i_rate")
    model = coil.with_effect(law.at_size(-0.1))
    true = coil.with_parameters({"L": 0.024})
    seen = simulated(true, pushes(600, largest=3.0, seed=1), sample_time=2e-3)
    priors = default_priors(model, ["R", *["L"] * fitted, "gain_i_rate.excess"])
    fit = fit_with_process_noise(model, [extended_start(seen, coil, model)], priors)
    found = value_instead(fit, law.effect, "excess", coil, [seen])
    # U / (0.024 H) is a sixth less than U / (0.02 H).
    assert found is None if fitted else found == ("L", pytest.approx(0.024, rel=2e-3))


def test_a_gain_of_a_sensor_may_be_that_of_what_it_reads() -> None:
    lag = machine(
        lambda m: ({"x": (m.p.b * m.u.drive - m.x.x) / m.p.T}, {"y": m.x.x}),
        "x m scale=1",
        "drive m scale=1",
        "y m 1e-3 scale=1",
        # Nothing depends on the first one.
        "spare kg 3 1 9, b 1 1 0.1 9, T s 0.5 0.1 2",
    )
    law = next(e for e in library(lag) if e.name == "sensor_gain_y")
    model = lag.with_effect(law.at_size(0.1))
    seen = simulated(
        lag.with_parameters({"b": 1.2}), pushes(600, largest=3.0, seed=1), sample_time=0.02
    )
    priors = default_priors(model, ["T", "sensor_gain_y.excess"])
    fit = fit_with_process_noise(model, [extended_start(seen, lag, model)], priors)
    found = value_instead(fit, law.effect, "excess", lag, [seen])
    assert found == ("b", pytest.approx(1.2, rel=2e-3))


def test_what_all_else_scales_with_is_no_value_instead() -> None:
    def equations(m: Scope) -> dict[str, Any]:
        force = m.port("body.force", m.p.gain * m.u.drive - m.p.damping * m.x.speed, unit="N",
                       signals={"speed": m.x.speed})  # fmt: skip
        return {"speed": force / m.p.mass}

    body = machine(
        equations,
        "speed m/s scale=1",
        "drive V scale=1",
        "speed m/s 1e-3 scale=1",
        "gain N/V 1 0.1 9, damping N s/m 0.5 0.01 5, mass kg 0.1",
    )
    # Its sign would be chance.
    for size in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6):
        model = body.with_effect(quadratic_drag("body.force", coefficient=size))
        seen = simulated(model, pushes(600, largest=3.0, seed=1), sample_time=0.02)
        priors = default_priors(model, ["gain", "damping", "quadratic_drag.coefficient"])
        fit = fit_with_process_noise(model, [seen], priors)
        assert fit.refit.estimate("quadratic_drag.coefficient").value == pytest.approx(
            size, rel=0.1
        )
        assert value_instead(fit, model.effects[0], "coefficient", body, [seen]) is None


def test_a_mass_that_moves_too_fast_to_be_seen_is_no_value_instead() -> None:
    def moved(m: Scope) -> dict[str, Any]:
        return {"speed": (2.0 * m.u.drive - m.p.damping * m.x.speed) / m.p.mass}

    body = machine(moved, "speed m/s scale=1", "drive N", "speed m/s 1e-3 scale=1",
                   "damping N s/m 0.5 0.01 5, mass kg 0.002")  # fmt: skip
    # At rest its drag per mass is as much as twice the mass is less: on a straight line, until
    # there is none.
    model = body.with_effect(quadratic_drag("speed.rate", coefficient=50.0))
    seen = simulated(model, pushes(600, largest=3.0, seed=1), sample_time=0.05)
    priors = default_priors(model, ["damping", "quadratic_drag.coefficient"])
    fit = fit_with_process_noise(model, [extended_start(seen, body, model)], priors)
    assert value_instead(fit, model.effects[0], "coefficient", body, [seen]) is None
