"""Refits of a small plant: intervals, bounds, gauges, disagreement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.estimation.simulated_recordings import (
    pushes,
    simulated,
    simulated_axis,
)
from workbench.errors import WorkbenchError
from workbench.model import Model
from workbench.plants.servo_axis import servo_axis

TRUE = {
    "mass": 100.0,
    "offset": 2.0,
    "viscous_friction.coefficient": 220.0,
    "coulomb_friction.level": 24.0,
}
SEEDS = 150
NO_DISTURBANCE = (0.03, 0.001)
"""Shares that leave no room for unmodelled forces, as there are none in what is made up."""


def _axis(noise: float = 2e-4) -> Model:
    axis = servo_axis()
    outputs = (replace(axis.outputs[0], noise_rms=noise),)
    return replace(axis, outputs=outputs).with_parameters(
        {"coulomb_friction.transition_speed": 5e-3}
    )


def _seen(axis: Model, seed: int, **values: float) -> Observed:
    forces = pushes(600, largest=200.0, seed=seed)
    return simulated(
        axis, forces, sample_time=0.01, values=TRUE | values, seed=seed, name=f"trial {seed}"
    )


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    axis = _axis()
    held = dict.fromkeys(TRUE, 0)
    scores: dict[str, list[float]] = {name: [] for name in TRUE}
    for seed in range(SEEDS):
        found = refit(axis, [_seen(axis, seed)], stages=NO_DISTURBANCE)
        for name, value in TRUE.items():
            estimate = found.estimate(name)
            low, high = estimate.interval
            held[name] += low <= value <= high
            scores[name].append((estimate.value - value) / estimate.std)
    # 95 % of 150: 142.5 +- 2.7; 90 to 99 % is three standard deviations either way.
    for name, count in held.items():
        assert 0.90 * SEEDS <= count <= 0.99 * SEEDS + 1, (name, count)
        # Mean of 150 standard scores: 0 +- 0.08; the linearisation may add a tenth.
        assert abs(np.mean(scores[name])) < 0.4, name
        assert 0.85 < np.std(scores[name]) < 1.2, name


def test_room_for_disturbances_only_widens_the_intervals() -> None:
    axis = _axis()
    seen = [_seen(axis, 0)]
    tight, wide = (refit(axis, seen, stages=s) for s in (NO_DISTURBANCE, (1.0, 0.3)))
    for name in TRUE:
        assert wide.estimate(name).std > tight.estimate(name).std


def test_two_recordings_say_more_than_one() -> None:
    axis = _axis()
    seen = [_seen(axis, 0), _seen(axis, 1)]
    one, both = (refit(axis, seen[:n], stages=NO_DISTURBANCE) for n in (1, 2))
    for name in TRUE:
        # 0.71 for equal excitation; the forces differ.
        assert both.estimate(name).std < 0.95 * one.estimate(name).std
    assert both.disagreements == ()


def test_recordings_of_different_machines_disagree() -> None:
    axis = _axis()
    seen = [_seen(axis, 0), _seen(axis, 1), _seen(axis, 2, offset=3.0)]
    found = refit(axis, seen, stages=NO_DISTURBANCE)
    assert any(text.startswith("offset: trial 2") for text in found.disagreements)


def test_combinations_that_the_data_do_not_determine_are_named() -> None:
    axis = _axis()
    rest = Observed(
        "rest",
        0.01,
        np.zeros((200, 1)),
        np.zeros((200, 1)),
        ("position",),
        np.array([2e-4]),
        np.zeros(2),
        np.array([1e-4, 1e-4]),
    )
    found = refit(axis, [rest], stages=NO_DISTURBANCE)
    assert any("mass" in text for text in found.unidentifiable)
    # What the data do not say, the prior does.
    assert found.estimate("mass").std == pytest.approx(found.estimate("mass").prior.std, rel=0.05)


def test_a_parameter_on_its_bound_is_said_to_be() -> None:
    axis = _axis()
    narrow = tuple(replace(p, upper=98.0) if p.name == "mass" else p for p in default_priors(axis))
    estimate = refit(axis, [_seen(axis, 0)], priors=narrow).estimate("mass")
    assert estimate.on_bound
    assert estimate.value == pytest.approx(98.0)
    assert "ON BOUND" in str(estimate)


def test_a_fixed_parameter_stays() -> None:
    axis = _axis()
    free = tuple(p for p in default_priors(axis) if p.name != "mass")
    found = refit(axis, [_seen(axis, 0)], priors=free)
    assert found.model.parameter("mass").value == 95.0
    with pytest.raises(WorkbenchError, match="was not refitted"):
        found.estimate("mass")


def test_several_starts_find_the_same_place_and_are_repeatable() -> None:
    axis = _axis()
    seen = [_seen(axis, 0)]
    priors = [replace(p, std=0.5 * p.std) for p in default_priors(axis)]
    one = refit(axis, seen, priors=priors, stages=(1.0, 0.001))
    several = refit(axis, seen, priors=priors, stages=(1.0, 0.001), starts=3, seed=4)
    assert several.cost <= one.cost + 1e-9
    for name in TRUE:
        a, b = one.estimate(name), several.estimate(name)
        assert abs(a.value - b.value) < 0.1 * a.std


def test_no_recording_and_mixed_recordings_are_refused() -> None:
    axis = servo_axis()
    with pytest.raises(WorkbenchError, match="no recording"):
        refit(axis, [])
    slow = replace(simulated_axis(0), sample_time=0.02)
    with pytest.raises(WorkbenchError, match="same outputs and sample time"):
        refit(axis, [simulated_axis(0), slow])


def test_draws_spread_as_the_estimates_do_whatever_their_units() -> None:
    axis = _axis()
    found = refit(axis, [_seen(axis, 0)], stages=NO_DISTURBANCE)
    # A conductance in m3/(s Pa) beside a coefficient in W/(m2 K).
    stds = 10.0 ** np.array([0.0, 3.0, -18.0, -8.0])
    units = stds / [e.std for e in found.estimates]
    free = {"lower": -np.inf, "upper": np.inf}
    moved = replace(
        found,
        covariance=found.covariance * np.outer(units, units),
        estimates=tuple(
            replace(e, value=0.0, std=s, prior=replace(e.prior, **free))
            for e, s in zip(found.estimates, stds.tolist(), strict=True)
        ),
    )
    rng = np.random.default_rng(0)
    drawn = np.array([list(moved.drawn(rng).values()) for _ in range(4000)])
    np.testing.assert_allclose(drawn.std(axis=0), stds, rtol=0.05)
    own = found.covariance / np.outer(*2 * [[e.std for e in found.estimates]])
    np.testing.assert_allclose(np.corrcoef(drawn.T), own, atol=0.06)
