"""The likelihood under imperfect equations: start, blocks, bootstrap, share of disturbance."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from tests.diagnosis.axis_case import diagnosed, observed
from tests.diagnosis.machine_data import recording
from tests.diagnosis.newcomers import levitation, maglev
from tests.machines import machine
from workbench.diagnosis.estimation import process_noise
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.prediction_error import PredictionError, disturbances
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import (
    PERFECT,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    gain_interval,
    perfect_cost,
    ranges_along,
    start_values,
)
from workbench.diagnosis.estimation.simulated_recordings import simulated_axis
from workbench.diagnosis.estimation.start import fit_with_likely_starts
from workbench.diagnosis.undeclared.plant import with_undeclared
from workbench.errors import NumericalError
from workbench.evaluation.foreign.foreign_case import plan
from workbench.model import Scope
from workbench.model.trace import Equations
from workbench.physics.hysteresis import muscle_hysteresis
from workbench.physics.library import library
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.recording import Recording


def test_disturbances_scale_with_the_share() -> None:
    whole, tenth = disturbances(arm(3), 1.0), disturbances(arm(3), 0.1)
    assert set(whole) == {"joint.torque", "chamber_1.flow", "chamber_2.flow"}
    assert tenth == pytest.approx({name: 0.1 * size for name, size in whole.items()})


def filled(seed: int) -> Recording:
    """Return a tank that its equations describe, with the noise of its sensor."""
    rng = np.random.default_rng(seed)
    inflow, level, levels = np.repeat(rng.uniform(0.2, 1.8, 31), 20)[:600], 1.0, []
    for u in inflow:
        levels.append(level + rng.normal(0.0, 0.01))
        level += (1.0 - math.exp(-0.1)) * (u - level)
    return recording(f"tank {seed}", 1.0, {"inflow [m3/s]": inflow}, {"level [m]": levels})


@pytest.mark.parametrize("seed", [22, 72])
def test_equations_that_leave_nothing_out_are_trusted_whatever_noise_makes_of_them(
    seed: int,
) -> None:
    def equations(m: Scope) -> Equations:
        return {"level": (m.u.inflow - m.p.valve * m.x.level) / m.p.area}, {"level": m.x.level}

    tank = machine(
        equations, "level m 1", "inflow m3/s 0 2", "level m", "valve m2/s 0.9 0.1 5, area m2 9 1 50"
    )
    both = [filled(seed), filled(seed + 1)]
    told, _ = with_undeclared(tank, both)
    seen = [observe(told, recording) for recording in both]
    fit = fit_with_process_noise(told, seen, default_priors(told))
    assert fit.noise_scale <= PERFECT


def test_a_start_is_extended_by_the_states_of_new_effects() -> None:
    model = arm(3)
    seen = observed(1, hidden=False, n=50)
    assert extended_start(seen, servo_axis(), servo_axis()) is seen
    more = model.with_effect(muscle_hysteresis())
    start = model.initial_state()
    rms = np.full(len(start), 0.01)
    given = type(seen)(
        "arm", 0.002, seen.inputs, seen.outputs, ("angle",), seen.noise_rms, start, rms
    )
    longer = extended_start(given, model, more)
    assert len(longer.start) == len(more.states) > len(start)
    own = [i for i, q in enumerate(more.states) if q.name in {p.name for p in model.states}]
    np.testing.assert_allclose(longer.start[own], start)
    np.testing.assert_allclose(longer.start_rms[own], rms)


def test_a_clock_is_not_set_by_a_filter() -> None:
    # Otherwise the filter moves the time of an event in each recording to where it likes it.
    case = next(c for c in plan(60, 9200) if c.title == "tank: heater_failure")
    model = case.build()
    law = next(e for e in library(model) if e.name == "gain_jump_heater_power")
    extended = model.with_effect(law.at_size(0.0))
    seen = observe(model, next(iter(case.recordings().values())))
    started = extended_start(seen, model, extended)
    rms = dict(zip((q.name for q in extended.states), started.start_rms, strict=True))
    # An hour of a recording of days is known to well below a sample.
    assert rms["gain_jump_heater_power.clock"] < 1e-3 * seen.sample_time


def test_a_start_told_by_a_sensor_is_open_where_that_sensor_may_be_shifted() -> None:
    model = servo_axis()
    seen = observed(1, hidden=False, n=50)
    known = {h.name: h for h in library(model)}

    def rms(name: str) -> float:
        extended = model.with_effect(known[name].effect)
        return float(extended_start(seen, model, extended).start_rms[0])

    place = model.states[0]
    assert seen.start_rms[0] < 0.01 * place.scale
    assert rms("sensor_offset_position") == (place.start_rms or place.scale)
    # What a slow sensor remembers may be as far from what is there as its law says.
    memory = known["sensor_lag_position"].effect.states[0].start_rms
    assert rms("sensor_lag_position") == pytest.approx(memory, rel=0.01)
    assert rms("stribeck_friction") == seen.start_rms[0]


def test_ranges_are_those_of_what_was_read_and_of_the_filtered_states() -> None:
    fit = diagnosed(False).base
    seen = diagnosed(False).prepared.fitting
    found = ranges_along(fit, seen)
    read = np.concatenate([r.outputs[:, 0] for r in seen])
    low, high = found["position.reading"]
    assert read.min() <= low < high <= read.max()
    assert found["position"] == pytest.approx((low, high), abs=0.02 * (high - low))
    pushed = np.concatenate([r.inputs[:, 0] for r in seen])
    assert found["axis.force"][1] <= 1.5 * pushed.max()


def test_bootstrap_interval_holds_the_sum_and_has_its_coverage() -> None:
    rng = np.random.default_rng(3)
    inside = 0
    for seed in range(100):
        gains = rng.normal(0.5, 1.0, 80)
        gain, low, high = gain_interval(gains, np.zeros(80), draws=400, seed=seed)
        assert gain == pytest.approx(gains.sum()) and low < gain < high
        inside += low <= 40.0 <= high
    # 99 % intervals; the bootstrap of 80 blocks is a little narrow.  Below 92 of 100 has a
    # probability of less than 1e-4 at a coverage of 98 %.
    assert inside >= 92


def test_bootstrap_tells_a_gain_from_chance() -> None:
    rng = np.random.default_rng(4)
    nothing = rng.normal(0.0, 1.0, 200)
    assert gain_interval(nothing, np.zeros(200))[1] < 0 < gain_interval(nothing, np.zeros(200))[2]
    assert gain_interval(nothing + 1.0, np.zeros(200))[1] > 0


def test_blocks_add_up_to_the_cost_of_the_filter() -> None:
    seen = observed(1, hidden=False, n=400)
    model = servo_axis()
    fit = fit_with_process_noise(model, [seen], default_priors(model), follow=False)
    blocks = blocks_of_cost(fit, [seen])
    filter_ = PredictionError(fit.model, seen, (), disturbances(fit.model, fit.noise_scale))
    assert blocks.sum() == pytest.approx(filter_.run(seen, fit.model.values).cost)


def test_the_share_falls_only_for_the_right_equations() -> None:
    right, wrong = diagnosed(False).base, diagnosed(True).base
    assert right.noise_scale <= 0.03 < wrong.noise_scale
    # The true mass is 100 kg, the model's 95 kg.
    assert right.refit.estimate("mass").value == pytest.approx(100.0, abs=0.5)


def test_estimates_on_a_bound_start_again_from_their_prior() -> None:
    model = servo_axis()
    fit = fit_with_process_noise(
        model, [observed(1, hidden=True, n=400)], default_priors(model), follow=False
    )
    priors = default_priors(model)
    values = start_values(fit.refit, priors)
    means = {p.name: p.mean for p in priors}
    for estimate in fit.refit.estimates:
        wanted = means[estimate.name] if estimate.on_bound else estimate.value
        assert values[estimate.name] == wanted


@pytest.mark.parametrize(
    ("costs", "scale"),
    [
        # Where the recordings do not mind, the equations are trusted more.
        ((10.0, 10.05, 10.06, 30.0), 0.3),
        ((10.0, 9.0, 13.0, 9.0), 1.0),
        # A little at every step is not a little.
        ((10.0, 12.0, 14.0, 16.0), 1.0),
    ],
)
def test_the_equations_are_trusted_as_far_as_it_costs_nothing(
    monkeypatch: pytest.MonkeyPatch, costs: tuple[float, ...], scale: float
) -> None:
    left = iter(costs)
    refitted = lambda *_, **__: SimpleNamespace(cost=next(left), values={})  # noqa: E731
    monkeypatch.setattr(process_noise, "refit", refitted)
    seen = simulated_axis(1, samples=50)
    found = fit_with_process_noise(servo_axis(), [seen], (), noise_scale=3.0)
    assert found.noise_scale == scale


def test_what_an_unstable_plant_leaves_at_best_needs_no_right_parameters() -> None:
    runs = [levitation(seed, samples=600) for seed in (1, 2)]
    ball, _ = with_undeclared(maglev(), runs)
    fit, started = fit_with_likely_starts(ball, [observe(ball, runs[0])], default_priors(ball))
    assert fit.noise_scale <= PERFECT
    assert perfect_cost(ball, started) == pytest.approx(fit.cost, rel=0.02)


def test_what_a_plant_leaves_at_best_whose_run_leaves_its_range() -> None:
    def rates(m: Scope) -> Equations:
        return {"x": m.u.speed + m.p.drift + 1e-9 * ca.log(1.0 - m.x.x)}, {"x": m.x.x}

    plant = machine(
        rates, "x m scale=0.5", "speed m/s scale=0.4", "x m 1e-3 scale=0.5", "drift m/s 0 -1 1"
    )
    time, random = 0.01 * np.arange(2000), np.random.default_rng(1)
    middle = np.cos(time + 0.005)
    x = 0.5 + 0.4 * np.sin(time) + random.normal(0.0, 1e-3, len(time))
    run = recording("slide", 0.01, {"speed [m/s]": 0.4 * middle}, {"x [m]": x})
    seen = [observe(plant, run)]
    wrong = plant.with_parameters({"drift": 0.1})
    assert perfect_cost(wrong, seen) == pytest.approx(perfect_cost(plant, seen), rel=0.02)


def test_a_refit_begins_at_the_likeliest_scale_beyond_one_that_is_less_likely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # As along a cycle of hares and lynxes that the equations run through out of phase.
    costs = {3.0: 11792.0, 30.0: 11800.0, 300.0: 11087.0, 3000.0: 5093.0}

    def run(*_: object) -> object:
        return SimpleNamespace(cost=costs[scale[-1]])

    scale: list[float] = []
    monkeypatch.setattr(
        process_noise, "filter_of", lambda *at: scale.append(at[2]) or SimpleNamespace(run=run)
    )
    assert process_noise.likely_scale(servo_axis(), [observed(1, hidden=False)], {}) == 3000.0


def test_a_model_that_recordings_throw_off_is_trusted_less(monkeypatch: pytest.MonkeyPatch) -> None:
    base, tried = diagnosed(False).base, list[float]()

    def blocks(fit: process_noise.ProcessNoiseFit, _: object) -> np.ndarray:
        tried.append(fit.noise_scale)
        if fit.noise_scale < 30.0:
            raise NumericalError("the filter left the finite numbers")
        return np.ones(2)

    monkeypatch.setattr(process_noise, "blocks_of_cost", blocks)
    found = process_noise.blocks_as_trusted(replace(base, noise_scale=1.0), [])
    assert tried == [1.0, 3.0, 30.0] and found.tolist() == [1.0, 1.0]
