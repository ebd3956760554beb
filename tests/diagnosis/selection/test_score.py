"""Scores: expected size and gain against a full refit, collinearity, confusion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.axis_case import COULOMB_N, observed
from tests.diagnosis.newcomers import Law, levels, oscillator, recorded
from tests.diagnosis.selection.candidates import made_score
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated
from workbench.diagnosis.selection.moments import moments
from workbench.diagnosis.selection.score import COLLINEAR, Scores, by_name, score_library
from workbench.physics.friction import coulomb_friction, viscous_friction
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.servo_axis import servo_axis

_AT = "axis.force"


def _coulomb() -> Hypothesis:
    effect = coulomb_friction(_AT, level=0.0, transition_speed=1e-3, upper=100.0)
    return Hypothesis(effect, "level", 20.0)


@pytest.fixture(scope="module")
def without_friction() -> Scores:
    """Scores of an axis whose model lacks the Coulomb friction that the recording has."""
    model = servo_axis().without("coulomb_friction")
    seen = [observed(1, hidden=False, n=800)]
    priors = default_priors(model)
    base = fit_with_process_noise(model, seen, priors)
    entries = [e for e in library(base.model) if e.name != "coulomb_friction" and not e.stiff]
    return score_library(
        base.model, seen, priors, [_coulomb(), *entries], noise_scale=base.noise_scale
    )


def test_the_missing_effect_scores_near_its_size(without_friction: Scores) -> None:
    score = by_name(without_friction)["coulomb_friction"]
    # The derivative at size zero is exact for small effects; this one is as large as the drive.
    assert score.size == pytest.approx(COULOMB_N, rel=0.35)
    assert score.gain > 0.5 * without_friction.scores[0].gain
    assert score.sigma > 4 and score.testable
    # What parameters reproduce but for half a percent is seen by that half, or is not.
    assert replace(score, collinearity=0.995, sigma=3.0).testable
    assert not replace(score, collinearity=0.995, sigma=1.5).testable


def test_a_stiff_law_is_scored_with_each_of_its_shapes() -> None:
    axis = servo_axis()
    stop = next(h for h in library(axis) if h.name == "end_stop")
    place = {"side": -1.0, "place": -0.06}
    assert stop.stiff and place in stop.shapes[1:]
    forces = pushes(600, largest=100.0, seed=3)
    free, held = (
        simulated(model, forces, sample_time=0.01)
        for model in (axis, axis.with_effect(stop.at_size(1.0, place)))
    )
    seen = replace(free, outputs=held.outputs)
    priors = default_priors(axis)
    base = fit_with_process_noise(axis, [seen], priors)
    (score,) = score_library(
        base.model, [seen], priors, [stop], noise_scale=base.noise_scale
    ).scores
    assert score.shape == place and score.size == pytest.approx(1.0, rel=0.1)


def test_scores_are_sorted_and_confusion_is_a_cosine(without_friction: Scores) -> None:
    gains = [score.gain for score in without_friction.scores]
    assert gains == sorted(gains, reverse=True)
    confusion = without_friction.confusion
    # An effect that these data never touch, such as a clipping, has no signature at all.
    diagonal = np.diag(confusion)
    np.testing.assert_allclose(diagonal[diagonal > 0], 1.0, atol=1e-6)
    assert np.count_nonzero(diagonal == 0) <= 2
    np.testing.assert_allclose(confusion, confusion.T, atol=1e-9)
    assert confusion.max() <= 1.0 + 1e-6


def test_what_a_parameter_reproduces_is_collinear(without_friction: Scores) -> None:
    # The axis has a free constant force of its own, as fitted parameter ``offset``.
    assert by_name(without_friction)["constant_force"].collinearity > COLLINEAR
    assert not by_name(without_friction)["constant_force"].testable


def test_the_same_law_twice_is_one_class() -> None:
    model = servo_axis().without("viscous_friction")
    seen = [observed(2, hidden=False, n=400)]
    base = fit_with_process_noise(model, seen, default_priors(model), follow=False)
    one = viscous_friction(_AT, coefficient=0.0, upper=1e4)
    entries = [Hypothesis(replace(one, name=name), "coefficient", 100.0) for name in ("one", "two")]
    other = next(e for e in library(base.model) if e.name == "cubic_stiffness")
    scores = score_library(
        base.model, seen, default_priors(model), [*entries, other], noise_scale=base.noise_scale
    )
    assert scores.look_alikes("one") == ("two",)


def test_what_a_parameter_hides_off_its_bound_is_scored_where_it_is_on_it() -> None:
    ripple, tilt = made_score("ripple", 90.0), made_score("tilt_gravity", 60.0)
    hidden = replace(tilt, sigma=0.4, collinearity=0.999)
    confusion = np.array([[1.0, 0.2], [0.2, 1.0]])
    scores = Scores((ripple, hidden), confusion)
    # As good elsewhere, what these data show is left as it was.
    at_bound = Scores((replace(tilt, gain=200.0), replace(ripple, gain=300.0)), np.eye(2))
    assert scores.beside(at_bound).scores == (at_bound.scores[0], ripple)
    assert scores.beside(at_bound).leading == ("tilt_gravity", "ripple")
    assert scores.beside(replace(at_bound, scores=(hidden,))).scores == scores.scores


def test_what_acts_late_and_in_few_blocks_is_late_too() -> None:
    score = replace(made_score("parameter_jump_arm_inertia", 1000.0), due=8000)
    assert score.late == 8000
    # Its scatter about the mean over all blocks is large, and what it gains is too.
    assert replace(score, sigma=1.8).late == 8000
    assert replace(score, sigma=1.8, gain=20.0).late == 0


@pytest.mark.parametrize("jumps", [(99.0, 3.0), (3.0, 99.0)])
def test_an_event_that_one_of_two_recordings_wants_does_not_come_to_the_other(
    jumps: tuple[float, float],
) -> None:
    plain = oscillator()
    seen = []
    for seed, time in enumerate(jumps, 1):
        more = 0.2 * (0.02 * np.arange(300) >= time)
        drive = levels(300, seed, 3.0, 20, 80)
        law: Law = lambda x, v: -30.0 * x - 0.6 * v  # noqa: E731
        seen.append(observe(plain, recorded(1.0, law, drive, 0.02, 1e-3, seed=seed, unread=more)))
    known = {"mass": 1.0, "stiffness": 30.0, "damping": 0.6}
    right = plain.with_parameters(known)
    priors = [replace(p, mean=known[p.name], std=1e-3 * p.std) for p in default_priors(plain)]
    facts = RecordedFacts(("position",), 6.0, 0.02)
    (entry,) = (e for e in library(plain, facts) if e.name == "offset_jump_mass_force")
    (score,) = score_library(right, seen, priors, [entry], noise_scale=0.03).scores
    own = int(np.argmin(jumps))
    effect, other = score.entry.effect, f"run {2 - own}"
    assert score.clearest == own and [dict(q.start_in).keys() for q in effect.states] == [{other}]
    assert moments(right.with_effect(effect), effect, other)[0] > 6.0
    assert score.size == pytest.approx(0.2, rel=0.3)
