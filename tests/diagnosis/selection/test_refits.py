"""Selection: penalty, shortlist, and the rules by which an effect is refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest

from tests.diagnosis.axis_case import SAMPLE_TIME, diagnosed, excitation, positions
from tests.diagnosis.example_diagnosis import example_diagnosis
from tests.diagnosis.machine_data import recording
from tests.diagnosis.newcomers import damper, driven_carts, rubbed, two_carts
from tests.machines import machine
from workbench.diagnosis.estimation.made_up import made_up_axis
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.process_noise import (
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
)
from workbench.diagnosis.selection import refits
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.decision import decided, degenerates_to, preferred
from workbench.diagnosis.selection.held_out import NO_RUNS, RunErrors
from workbench.diagnosis.selection.moments import is_event
from workbench.diagnosis.selection.pairs import as_told
from workbench.diagnosis.selection.rules import (
    LEAST_GAIN,
    SURPASSED,
    TOO_LITTLE,
    Limits,
    doubted_in,
    judged,
    selection_penalty,
)
from workbench.diagnosis.selection.score import Score, Scores, by_name, score_library
from workbench.diagnosis.selection.selected import Accepted
from workbench.diagnosis.selection.shortlist import shortlist, where
from workbench.model import State
from workbench.physics.drift import offset_jump
from workbench.physics.friction import coulomb_friction
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.law import Law, size, twins
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.physics.survey import Survey
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis


def _score(entry: Hypothesis | str, gain: float, collinearity: float = 0.2) -> Score:
    entry = _entries()[entry] if isinstance(entry, str) else entry
    return Score(entry, gain, 9.0, entry.typical_size, 0.1, collinearity, 0.01 * entry.largest_size)


@cache
def _entries() -> dict[str, Hypothesis]:
    """Entries of the arm by name."""
    return {entry.name: entry for entry in library(arm(3))}


def test_the_penalty_grows_with_library_samples_and_parameters() -> None:
    base = selection_penalty(40, 1000, 1)
    assert base == pytest.approx(LEAST_GAIN + 0.5 * math.log(1000) + math.log(40))
    assert selection_penalty(80, 1000, 1) - base == pytest.approx(math.log(2))
    assert selection_penalty(40, 1000, 3) - base == pytest.approx(math.log(1000))


def test_shortlist_takes_look_alikes_and_the_best_of_other_places() -> None:
    ranked = [
        ("tilt_gravity", 900.0),
        ("constant_torque", 800.0),
        ("linear_spring", 700.0),
        ("stribeck_friction", 690.0),
        ("ripple", 680.0),
        ("local_catch", 670.0),
        ("valve_offset", 50.0),
        ("chamber_leakage_1", 3.0),
    ]
    confusion = np.eye(len(ranked))
    confusion[0, 1] = confusion[1, 0] = 0.99
    scores = Scores(tuple(_score(name, gain) for name, gain in ranked), confusion, 1.0)
    names = [score.entry.name for score in shortlist(scores, most=3)]
    assert names[0] == "tilt_gravity"
    # The look-alike, and the best of another component although others at the joint score more.
    assert set(names[1:]) == {"constant_torque", "valve_offset"}


def test_what_cannot_be_tested_or_gains_too_little_is_not_refitted() -> None:
    collinear = _score("tilt_gravity", 90.0, collinearity=0.999)
    scores = Scores((replace(collinear, sigma=1.5), _score("ripple", 2.0)), np.eye(2), 1.0)
    assert shortlist(scores, most=18) == ()
    # What parameters reproduce but for a thousandth is refitted where that is seen clearly.
    clear = replace(scores, scores=(collinear, scores.scores[1]))
    assert [score.entry.name for score in shortlist(clear, most=18)] == ["tilt_gravity"]


def test_what_a_parameter_hides_off_its_bound_is_scored_where_it_is_on_it() -> None:
    ripple, tilt = _score("ripple", 90.0), _score("tilt_gravity", 60.0)
    hidden = replace(tilt, sigma=0.4, collinearity=0.999)
    confusion = np.array([[1.0, 0.2], [0.2, 1.0]])
    scores = Scores((ripple, hidden), confusion, 1.0)
    # As good elsewhere, what these data show is left as it was.
    at_bound = Scores((replace(tilt, gain=200.0), replace(ripple, gain=300.0)), np.eye(2), 1.0)
    assert scores.shown_by(at_bound).scores == (at_bound.scores[0], ripple)
    assert scores.shown_by(replace(at_bound, scores=(hidden,))).scores == scores.scores


def test_the_best_score_is_followed_whatever_its_first_refit_gained() -> None:
    names = ("stribeck_friction", "ripple", "valve_offset", "tilt_gravity", "local_catch")
    first = [_candidate(name, 100.0 - i, 0.5) for i, name in enumerate(names)]
    first[4] = replace(first[4], gain=-3.0)
    assert refits._leaders(first, 4) == [0, 1, 2, 3, 4]
    assert refits._leaders(first, 1) == [0, 1, 2, 3]
    assert refits._leaders([replace(first[4], fit=None)], 0) == []
    assert refits._leaders([first[4]], 0) == [0]


def test_what_acts_late_and_in_few_blocks_is_late_too() -> None:
    score = replace(_score("parameter_jump_arm_inertia", 1000.0), due=8000)
    assert score.late == 8000
    # Its scatter about the mean over all blocks is large, and what it gains is too.
    assert replace(score, sigma=1.8).late == 8000
    assert replace(score, sigma=1.8, gain=20.0).late == 0


def test_location_of_an_effect_is_that_of_its_ports() -> None:
    assert where(_entries()["cross_leakage"]) == ("chamber_1", "chamber_2")
    friction = Hypothesis(coulomb_friction("joint.torque", level=0.0), "level", 0.5)
    assert where(friction) == ("joint",)


def test_refused_effects_say_why_and_the_accepted_one_passed_every_rule() -> None:
    found = diagnosed(True)
    (best, _) = found.accepted[0]
    assert best.refused == "" and best.size is not None
    assert abs(best.size.value) > 3 * best.size.std
    assert best.held_out[1] > 0
    for candidate in found.rounds[0][1]:
        if candidate is not best:
            assert candidate.refused


def test_a_candidate_that_failed_has_no_size() -> None:
    failed = Candidate(_entries()["ripple"], None, -math.inf, refused="failed")
    assert failed.size is None and "failed" in str(failed)
    held = Candidate(_entries()["lines"], cast(Any, SimpleNamespace()), 1.0, (0.0, 0.0, 0.0))
    assert held.entry.replaces is (held.size is None)


def _run(error: float) -> RunErrors:
    """Return the errors of a free run, whose mean square is that of noise about them."""
    squares = error**2 * np.random.default_rng(0).uniform(0.8, 1.2, (40, 1))
    return RunErrors(squares, squares.mean(axis=0) / 40)


WITHOUT = _run(1.0)
ASKED = Limits(20.0, 100.0)


def _estimated(value: float, std: float) -> SimpleNamespace:
    return SimpleNamespace(value=value, std=std, unit="s", prior=SimpleNamespace(upper=0.0))


def _model(*misread: tuple[str, float]) -> SimpleNamespace:
    return SimpleNamespace(traits=SimpleNamespace(misread=misread))


def _candidate(
    entry: Hypothesis | str,
    gain: float,
    error: float,
    *,
    unseen: float | None = None,
    uneven: float = 0.0,
    scale: float = 1.0,
    parameters: int | None = None,
    on_bound: str = "",
) -> Candidate:
    """Return a candidate whose free runs have an error; that without any is 1.

    Its costs go up and down by ``uneven`` from block to block, on unseen recordings too.
    """
    entry = _entries()[entry] if isinstance(entry, str) else entry
    estimate = _estimated(entry.typical_size, 1e-3 * entry.typical_size)
    own = [q.name for q in entry.effect.parameters if q.fitted]
    own = own if parameters is None else list(map(str, range(parameters)))
    estimates = [SimpleNamespace(name=f"{entry.name}.{n}", on_bound=n == on_bound) for n in own]
    refit = SimpleNamespace(converged=True, estimate=lambda name: estimate, estimates=estimates)
    fit = cast(
        Any, SimpleNamespace(name=entry.name, refit=refit, noise_scale=scale, model=_model())
    )
    later = gain if unseen is None else unseen
    blocks = tuple(np.tile([-uneven, uneven], 20) - g / 40 for g in (gain, later))
    held_out = (later, 0.8 * later, 1.2 * later)
    return Candidate(entry, fit, gain, held_out, shift=5.0, blocks=blocks, run=_run(error))


def _trusting(candidate: Candidate) -> Any:
    return SimpleNamespace(**{**vars(cast(Any, candidate.fit)), "noise_scale": 0.003})


def _taken(candidates: tuple[Candidate, ...]) -> list[str]:
    return [c.entry.name for c in candidates if not c.refused]


def _winners(*candidates: Candidate, limits: Limits = ASKED) -> list[str]:
    return _taken(decided(candidates, WITHOUT, limits))


def test_a_law_of_the_process_must_not_spoil_free_runs() -> None:
    pair = [_candidate("stribeck_friction", 900.0, 7.0), _candidate("valve_offset", 500.0, 0.5)]
    found = decided(pair, WITHOUT, ASKED)
    assert _taken(found) == ["valve_offset"] and found[0].rule == "free run"


def test_what_makes_all_recordings_likelier_than_a_reliable_law_passes_with_it() -> None:
    friction = _candidate("stribeck_friction", 900.0, 0.3)
    by_moments = replace(friction, held_out=(720.0, -1.0, 1400.0))
    offset = _candidate("valve_offset", 500.0, 0.5)
    near = Limits(20.0, 100.0, near_noise=True)
    assert _winners(by_moments, offset, limits=near) == ["stribeck_friction"]
    assert _winners(by_moments, limits=near) == []
    worse = replace(by_moments, held_out=(400.0, -1.0, 800.0))
    assert _winners(worse, offset, limits=near) == ["valve_offset"]


def test_a_simpler_effect_whose_runs_are_much_closer_need_not_be_the_likelier() -> None:
    for error, taken in ((0.3, "valve_offset"), (0.55, "stribeck_friction")):
        stribeck = _candidate("stribeck_friction", 900.0, 0.6)
        assert _winners(stribeck, _candidate("valve_offset", 500.0, error)) == [taken]


def test_what_a_perfect_predictor_lacks_has_to_show_in_free_runs() -> None:
    for error, taken in ((1.0, []), (0.5, ["valve_offset"])):
        offset = _candidate("valve_offset", 500.0, error)
        assert _winners(offset, limits=Limits(20.0, 100.0, perfect=True)) == taken
        assert _winners(offset) == ["valve_offset"]


def test_a_sensor_has_to_show_in_free_runs() -> None:
    offset = _candidate("valve_offset", 500.0, 0.5)
    worse, closer = (_candidate("sensor_lag_angle", 900.0, error) for error in (1.2, 0.2))
    assert _winners(worse, offset) == ["valve_offset"]
    assert _winners(worse) == []
    assert _winners(closer, offset) == ["sensor_lag_angle"]
    # What remembers nothing colours no noise: the rest of the error may be of what else is missing.
    for name in ("sensor_offset_angle", "sensor_jump_angle"):
        reads_wrong = _candidate(name, 900.0, 1.02)
        assert _winners(reads_wrong, offset) == ["valve_offset"]
        assert _winners(reads_wrong) == [name]


def test_of_processes_that_run_closer_than_a_sensor_the_closest_is_taken() -> None:
    lag, offset = _candidate("sensor_lag_angle", 900.0, 0.9), _candidate("valve_offset", 500.0, 0.3)
    for error, taken in ((0.8, "valve_offset"), (0.1, "stribeck_friction")):
        friction = _candidate("stribeck_friction", 600.0, error)
        assert _winners(lag, friction, offset) == [taken]


@pytest.mark.parametrize(("error", "taken"), [(0.5, True), (0.9, False)])
def test_what_explains_little_is_likely_if_it_takes_much_of_the_free_run(
    error: float, taken: bool
) -> None:
    one = [_candidate("valve_offset", 80.0, error)]
    found = decided(one, WITHOUT, ASKED)
    assert bool(_taken(found)) is taken
    assert bool(found[0].doubts) is taken


def test_what_can_be_run_is_closer_than_what_cannot() -> None:
    assert WITHOUT.closer_than(NO_RUNS) and not NO_RUNS.closer_than(WITHOUT)
    assert NO_RUNS.spoilt_from(WITHOUT) and not WITHOUT.spoilt_from(NO_RUNS)


def test_what_lies_within_a_few_units_unseen_recordings_decide() -> None:
    first = _candidate("valve_offset", 500.0, 0.5)
    other = _candidate("stribeck_friction", 490.0, 0.5)
    unseen = replace(
        other, held_out=(530.0, 500.0, 560.0), blocks=(other.blocks[0], other.blocks[1] - 1.0)
    )
    assert preferred(unseen, first) and not preferred(first, unseen)
    for given, taken in ((other, first), (unseen, other)):
        assert _winners(first, given) == [taken.name]
    # What explains clearly more where it was fitted is not given up.
    far = replace(unseen, gain=400.0)
    assert _winners(first, far) == [first.name]


def test_what_unseen_recordings_prefer_twice_is_taken_before_a_larger_gain() -> None:
    first = _candidate("valve_offset", 900.0, 0.8)
    closer = _candidate("stribeck_friction", 600.0, 0.4)
    unseen = replace(closer, held_out=(950.0, 700.0, 1200.0))
    assert _winners(first, unseen) == [closer.name]
    alike = replace(unseen, blocks=first.blocks)
    assert _winners(first, alike) == [closer.name]
    # Neither the likelier of the two on unseen recordings alone, nor the closer run alone, is.
    as_close = replace(unseen, run=_run(0.7))
    assert _winners(first, closer) == [first.name]
    assert _winners(first, as_close) == [first.name]
    # What has a size of its own in each recording takes that from the unseen one.
    level = _candidate("offset_by_recording_valve_command", 600.0, 0.4)
    told = replace(level, held_out=unseen.held_out)
    assert _winners(first, told) == [first.name]


def test_a_jump_at_time_zero_is_the_offset_that_it_degenerates_to() -> None:
    survey = Survey(arm(3), RecordedFacts(duration=20.0))
    (jump,) = [h for h in offset_jump.hypotheses(survey) if h.ports == ("joint.torque",)]
    (constant,) = [h for h in library(arm(3)) if h.name == "constant_torque"]

    def refitted(
        gain: float, *, scale: float = 0.03, uneven: float = 4.0, **known: Any
    ) -> Candidate:
        return _candidate(jump, gain, 0.1, scale=scale, uneven=uneven, **known)

    plain = _candidate(constant, 900.0, 0.1, scale=0.03)
    at_zero = refitted(903.0, on_bound="time")
    assert _winners(at_zero, plain) == ["constant_torque"]
    # What gains clearly more is a jump.
    for other in (
        refitted(990.0),
        refitted(990.0, on_bound="time"),
        refitted(903.0, unseen=1503.0, on_bound="time"),
    ):
        assert _winners(other, plain) == [jump.name]
    # Unseen recordings tell equals apart only if both were trusted alike.
    further = refitted(903.0, unseen=1503.0, scale=0.003, on_bound="time")
    assert _winners(further, plain) == ["constant_torque"]
    # From block to block as likely it is no jump, and no second explanation either.
    even = refitted(903.0, uneven=0.0)
    assert degenerates_to(even, plain) and not degenerates_to(plain, even)
    assert not degenerates_to(refitted(903.0), plain)
    assert not degenerates_to(refitted(990.0, uneven=0.0), plain)
    # A law of a book describes no machine to a thousandth of what it gains.
    large = _candidate(constant, 30e3, 0.1, scale=0.03)
    assert degenerates_to(refitted(30.05e3, uneven=0.5), large)
    assert not degenerates_to(refitted(30.5e3, uneven=0.5), large)
    assert not degenerates_to(refitted(30.05e3, uneven=9.0), large)


def test_what_may_only_even_out_the_noise_of_an_input_is_doubted() -> None:
    def told(name: str, *misread: tuple[str, float]) -> tuple[str, ...]:
        given = _candidate(name, 900.0, 0.1)
        fit = cast(Any, SimpleNamespace(**vars(cast(Any, given.fit)) | {"model": _model(*misread)}))
        return judged(replace(given, fit=fit), Limits(20.0, 100.0)).doubts

    read = ("pressure", 15.0)
    (said,) = told("sensor_lag_angle", read)
    assert said == "it may only even out the noise with which pressure was read"
    assert told("sensor_lag_angle") == told("valve_offset", read) == ()


def test_doubts_are_those_of_the_fit_that_is_told() -> None:
    candidate = _candidate("valve_offset", 900.0, 0.1)
    assert candidate.fit is not None
    size = _entries()["valve_offset"].typical_size

    def of(std: float) -> Any:
        estimate = _estimated(size, std)
        return SimpleNamespace(
            refit=SimpleNamespace(converged=True, estimate=lambda name: estimate, estimates=())
        )

    vague = judged(replace(candidate, fit=of(size)), ASKED)
    assert len(vague.doubts) == 1 and "standard deviations of zero" in vague.doubts[0]
    told = doubted_in(replace(vague, doubts=(*vague.doubts, "it is small")), of(1e-3 * size))
    assert told.doubts == ("it is small",)
    assert doubted_in(told, of(size)).doubts == (*vague.doubts, "it is small")
    assert doubted_in(candidate, candidate.fit) is candidate


@pytest.mark.parametrize("together", [False, True])
def test_what_explains_little_alone_is_no_doubt_where_all_together_explain_most(
    *, together: bool
) -> None:
    candidate = replace(_candidate("valve_offset", 900.0, 0.1), doubts=(TOO_LITTLE, "odd"))
    assert candidate.fit is not None
    told = as_told(Accepted(candidate, ()), candidate.fit, together=together).candidate
    assert told.doubts == (("odd",) if together else (TOO_LITTLE, "odd"))


def test_what_is_lost_on_unseen_recordings_was_overfitted() -> None:
    simple, rich = "valve_offset", "stribeck_friction"
    plain = _candidate(simple, 900.0, 0.1, parameters=1)
    for unseen, taken in ((870.0, simple), (890.0, rich), (940.0, rich)):
        other = _candidate(rich, 940.0, 0.1, unseen=unseen, parameters=3)
        assert _winners(other, plain) == [taken], unseen


@pytest.mark.parametrize("guess", [2e-4, 0.03])
def test_a_guess_is_tuned_to_the_truth_from_a_plateau_too_on_every_recording(guess: float) -> None:
    friction = coulomb_friction("damper.force", level=4.0, transition_speed=guess, upper=20.0)
    model = damper().with_parameters({"damping": 2.0}).with_effect(friction)
    fit = cast(Any, SimpleNamespace(model=model, noise_scale=0.3))
    seen = [observe(model, run) for run in rubbed()]
    still = replace(seen[0], inputs=0.0 * seen[0].inputs, outputs=0.0 * seen[0].outputs)
    for recordings in (seen, [still, *seen], [*seen, still]):
        tuned = refits.tuned(Hypothesis(friction, "level", 1.0), fit, recordings).effect
        (speed,) = (q.value for q in tuned.parameters if q.name == "transition_speed")
        # A reversal is sampled some ten times; the recordings round it over 0.05 m/s.
        assert speed == pytest.approx(0.05, rel=0.02)


def test_shapes_that_no_refit_changes_are_tried_too() -> None:
    (other,) = refits._variants(_entries()["sensor_lag_angle"])
    assert [q.value for q in other.effect.parameters if q.name == "sampled"] == [1.0]
    # A width that a refit changes is no other variant.
    assert refits._variants(_entries()["lugre_friction"]) == []
    # A machine that sticks reverses within less than another law shows.
    (sticking,) = refits._variants(_entries()["stribeck_friction"])
    sharp, usual = (
        next(q.value for q in e.effect.parameters if q.name == "transition_speed")
        for e in (sticking, _entries()["stribeck_friction"])
    )
    assert sharp == pytest.approx(usual / 40.0)


def test_what_comes_late_is_raced_on_what_shows_it() -> None:
    n, late = 3600, 2750
    force = excitation(n, 4)
    seen = 1e-6 * np.round(positions(force + 30.0 * (np.arange(n) >= late), hidden=False)[0] / 1e-6)
    run = recording("late", SAMPLE_TIME, {"force [N]": force}, {"position [m]": seen})
    axis = servo_axis()
    observed = observe(axis, run)
    priors = default_priors(axis)
    base = fit_with_process_noise(axis, [observed], priors)
    duration = SAMPLE_TIME * n
    tried = [e for e in library(axis, RecordedFacts(duration=duration, sample_time=SAMPLE_TIME))
             if e.name in ("offset_jump_axis_force", "linear_spring")]  # fmt: skip
    scores = score_library(base.model, [observed], priors, tried, noise_scale=base.noise_scale)
    jump = by_name(scores)["offset_jump_axis_force"]
    assert jump.late > refits._HEADS[0]
    prior = base.cost - float(blocks_of_cost(base, [observed]).sum())
    (found,) = refits._raced(refits.Race(base, priors, [observed], known=prior), [jump])
    assert found.fit is not None and found.gain > 1000.0
    assert found.fit.model.parameter("offset_jump_axis_force.time").value == pytest.approx(
        SAMPLE_TIME * late, abs=0.05
    )
    assert found.fit.model.parameter("offset_jump_axis_force.amount").value == pytest.approx(
        30.0, rel=0.05
    )


@pytest.mark.parametrize(
    ("scale", "group", "before", "leader", "all_ways"),
    [
        (0.003, "process", 3.0, 0, 4),
        # One that the score does not put first ends the wait for those well behind it.
        (0.003, "process", 3.0, 7, 12),
        (0.3, "process", 3.0, 0, 30),
        # It colours the noise, and so predicts the next sample of anything.
        (0.003, "sensor", 3.0, 0, 30),
        # The equations were trusted without it.
        (0.003, "process", 0.003, 0, 30),
    ],
)
def test_beside_what_leaves_nothing_out_others_are_not_tried_in_every_way(
    monkeypatch: pytest.MonkeyPatch,
    scale: float,
    group: str,
    before: float,
    leader: int,
    all_ways: int,
) -> None:
    thorough: dict[float, bool] = {}

    def first(race: Any, _: float, score: Score, *__: Any) -> Any:
        thorough[score.gain] = race.thorough
        leads = score.gain == 29.0 - leader
        found = SimpleNamespace(noise_scale=scale if leads else 3.0)
        lag = SimpleNamespace(about=SimpleNamespace(level=False), states=(State("read", "m", 1.0),))
        entry = SimpleNamespace(group=group, effect=lag)
        return SimpleNamespace(entry=entry, fit=found, gain=score.gain)

    monkeypatch.setattr(refits, "_first", first)
    monkeypatch.setattr(refits, "blocks_of_cost", lambda *_: np.zeros(1))
    entry = library(servo_axis())[0]
    field = [_score(entry, float(gain)) for gain in range(30)]
    seen: Any = made_up_axis(1, samples=100)
    base: Any = SimpleNamespace(noise_scale=before)
    found = refits._first_refits(refits.Race(base, (), [seen]), field, 1500, 10.0)
    assert [c.gain for c in found] == [*range(30)]
    assert [thorough[29.0 - rank] for rank in range(30)] == [rank < all_ways for rank in range(30)]


def test_what_is_either_there_or_not_begins_at_the_priors_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[tuple[float, ...]] = []

    def refitted(_: Any, score: Score, way: Any, __: float) -> Any:
        begun.append(way.ladder)
        fit = SimpleNamespace(
            cost=-1.0, noise_scale=0.3, refit=SimpleNamespace(estimates=(), values={})
        )
        return score, fit

    monkeypatch.setattr(refits, "_refitted", refitted)
    monkeypatch.setattr(refits, "_variants", lambda _: [])
    monkeypatch.setattr(refits, "start_values", lambda *_: {})
    base: Any = SimpleNamespace(noise_scale=0.3, refit=SimpleNamespace(estimates=(), values={}))
    ways = {}
    race = refits.Race(base, (), [], thorough=False)
    for name in ("silencers", "valve_offset"):
        refits._first(race, 0.0, _score(name, 90.0), 1.0)
        ways[name], begun = begun, []
    assert ways == {"silencers": [(0.3,), refits._STEEP], "valve_offset": [(0.3,)]}


@pytest.mark.parametrize(("gained", "searches"), [(0.0, 1), (20.0, 2)])
def test_times_of_an_event_that_gain_nothing_are_searched_once(
    monkeypatch: pytest.MonkeyPatch, gained: float, searches: int
) -> None:
    survey = Survey(arm(3), RecordedFacts(duration=20.0))
    (jump,) = [h for h in offset_jump.hypotheses(survey) if h.ports == ("joint.torque",)]
    costs = [-100.0 - gained * k for k in range(3)]
    told = []

    def fitted(cost: float) -> Any:
        refit = SimpleNamespace(estimates=(), values={}, converged=True)
        model = SimpleNamespace(effects=[jump.effect])
        return SimpleNamespace(cost=cost, noise_scale=1.0, refit=refit, model=model)

    def own_starts(effects: Any, *_: Any) -> Any:
        told.append(effects)
        return (replace(effects[0], states=effects[0].states[:]),)

    monkeypatch.setattr(
        refits, "in_turn", lambda _, entry, *__, **___: (entry, fitted(costs.pop(0)), [])
    )
    monkeypatch.setattr(refits, "with_own_starts", own_starts)
    monkeypatch.setattr(refits, "changed_values", lambda *_: {})
    monkeypatch.setattr(refits, "level_everywhere", lambda _: None)
    monkeypatch.setattr(refits, "blocks_of_cost", lambda *_: np.zeros(1))
    monkeypatch.setattr(refits, "_closest_errors", lambda *_: None)
    first = Candidate(jump, fitted(0.0), 100.0)
    base: Any = SimpleNamespace(cost=0.0, model=None)
    refits._judged_on(refits.Race(base, (), ()), first, None)
    assert len(told) == searches


@pytest.mark.parametrize("fails", [False, True])
def test_what_explains_less_is_followed_where_what_explains_nearly_all_is_refused(
    monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    names = ("sensor_lag_angle", "valve_offset")
    both = [_candidate(n, gain, 0.5) for n, gain in zip(names, (900.0, 400.0), strict=True)]
    first = [replace(c, refused=SURPASSED, followed=False, fit=_trusting(c)) for c in both]
    tried, found = _followed_of(monkeypatch, first, fails=names[:1] * fails)
    assert tried == [*names[: 1 + fails]]
    assert _taken(found) == [names[int(fails)]]


@pytest.mark.parametrize(("cosine", "trusts"), [(0.97, False), (0.97, True), (0.9995, True)])
def test_what_does_the_same_as_what_was_found_is_followed_and_may_take_its_place(
    monkeypatch: pytest.MonkeyPatch, cosine: float, trusts: bool
) -> None:
    names = ("cubic_drag", "ripple", "tilt_gravity", "valve_offset", "quadratic_drag")
    gains = (900.0, 30.0, 29.0, 28.0, 6.0)
    every = [_candidate(n, gain, 0.5) for n, gain in zip(names, gains, strict=True)]
    first = [replace(c, refused=SURPASSED, followed=False) for c in every]
    first[0] = replace(first[0], fit=_trusting(first[0]))
    if trusts:
        first[-1] = replace(first[-1], fit=_trusting(first[-1]))

    def alike(name: str, above: float = 0.95) -> tuple[str, ...]:
        return names[-1:] * (name == names[0] and cosine > above)

    tried, found = _followed_of(monkeypatch, first, alike, gained={names[-1]: 1200.0})
    # One of two that nearly do the same may have come to trust the equations by chance.
    again = cosine > 0.999 or not trusts
    assert tried == [names[0], *names[4:] * again]
    assert _taken(found) == [names[4 if again else 0]]


def _followed_of(
    monkeypatch: pytest.MonkeyPatch,
    first: list[Candidate],
    alike: refits.Alike | None = None,
    *,
    fails: tuple[str, ...] = (),
    gained: dict[str, float] | None = None,
) -> tuple[list[str], tuple[Candidate, ...]]:
    """Return which of first refits were followed, and what became of all."""
    tried = []

    def followed(_: Any, candidate: Candidate, *__: Any) -> Candidate:
        tried.append(candidate.name)
        if candidate.name in fails:
            return replace(refits.untried(candidate.entry, "it broke"), followed=True)
        gain = (gained or {}).get(candidate.name, candidate.gain)
        blocks = (np.full(30, -gain / 30.0),)
        return replace(candidate, refused="", followed=True, gain=gain, blocks=blocks)

    monkeypatch.setattr(refits, "_first_refits", lambda *_: list(first))
    monkeypatch.setattr(refits, "_trusted", lambda *given: list(given[-1]))
    monkeypatch.setattr(refits, "_followed", followed)
    monkeypatch.setattr(refits, "_closest_errors", lambda *_: WITHOUT)
    monkeypatch.setattr(refits, "blocks_of_cost", lambda *_: np.zeros(1))
    field = [_score(c.name, 90.0) for c in first]
    base: Any = SimpleNamespace(cost=0.0, model=None)
    seen: Any = SimpleNamespace(outputs=np.zeros((100, 1)))
    found = refits.refit_candidates(
        base, field, (), [seen], [], limits=Limits(20.0, 100.0), jobs=1, alike=alike
    )
    return tried, found


def test_many_short_recordings_are_raced_on_some_among_them_the_one_that_shows_it_best(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recordings = [SimpleNamespace(name=k, outputs=np.zeros(600)) for k in range(12)]
    used = {}

    def first(race: Any, field: Any, *_: Any) -> list[Any]:
        for score in field:
            names = [r.name for r in race.fit_on]
            used[score.number] = names, names[score.clearest]
        return [score.number for score in field]

    @dataclass(frozen=True)
    class Shown:
        number: int
        clearest: int

    monkeypatch.setattr(refits, "_first_refits", first)
    field: Any = [Shown(0, 7), Shown(1, 2), Shown(2, 7)]
    raced = refits._raced(refits.Race(cast(Any, None), (), cast(Any, recordings)), field)
    assert raced == [0, 1, 2]
    assert used[0] == used[2] == ([0, 1, 2, 3, 7], 7)
    assert used[1] == ([0, 1, 2, 3, 4], 2)


def test_what_was_refitted_beside_another_base_goes_on_from_there_and_is_not_raced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = example_diagnosis()
    known, base = given.selected.accepted[0].candidate, replace(given.base, noise_scale=0.3)
    other = _candidate("tilt_gravity", 50.0, 0.5)
    raced: list[str] = []
    handed: dict[str, Candidate] = {}

    def first(_race: Any, field: Sequence[Score], *given: Any) -> list[Candidate]:
        handed.update(given[-1])
        return [replace(handed[s.entry.name], fit=None) for s in field]

    def race(_race: Any, field: Sequence[Score]) -> list[Candidate]:
        raced.extend(s.entry.name for s in field)
        return [other]

    monkeypatch.setattr(refits, "_raced", race)
    monkeypatch.setattr(refits, "_first_refits", first)
    monkeypatch.setattr(refits, "blocks_of_cost", lambda *_: np.zeros(1))
    monkeypatch.setattr(refits, "_closest_errors", lambda *_: WITHOUT)
    field = [_score(known.entry, 90.0), _score(other.name, 90.0)]
    seen: Any = SimpleNamespace(outputs=np.zeros((9000, 1)))
    refits.refit_candidates(
        base, field, (), [seen], [], limits=Limits(20.0, 100.0), begun={known.name: known}
    )
    assert raced == [other.name]
    begun = handed[known.name].fit
    assert known.fit is not None and begun is not None
    assert begun.refit.values == known.fit.refit.values and begun.noise_scale == 0.3


def test_what_acts_at_one_of_a_pair_is_told_from_what_acts_at_both() -> None:
    law = Law(
        "drag",
        "F = F0 - coefficient v |v|",
        twins("force", needs=("speed",)),
        lambda at: (size("coefficient", "N s^2/m^2", 1.0, 10.0, "drag", signed=True),),
        lambda at: at.value - at.p.coefficient * at.signals.speed * ca.fabs(at.signals.speed),
    )
    model = two_carts()
    (both,) = law.hypotheses(Survey(model))
    assert [h.name for h in both.alone] == ["drag_cart_1", "drag_cart_2"]
    priors = default_priors(model)
    for hidden, name in (((2.0, 2.0), "drag"), ((2.0, 0.0), "drag_cart_1")):
        seen = [observe(model, run) for run in driven_carts(hidden)]
        base = fit_with_process_noise(model, seen[:1], priors)
        scores = score_library(base.model, seen[:1], priors, [both], noise_scale=base.noise_scale)
        found = refits.refit_candidates(
            base, scores.scores, priors, seen[:1], seen[1:], limits=Limits(20.0, 20.0), jobs=1
        )
        assert _taken(found) == [name]
        assert found[0].fit is not None
        (size_,) = [e for e in found[0].fit.refit.estimates if e.name.startswith("drag")]
        assert size_.value == pytest.approx(2.0, rel=0.05)


def test_a_law_that_contends_is_refitted_with_the_trust_that_it_earns() -> None:
    """Its first refit ends where steps gain little; what loses from the start stays as it was."""

    block = machine(
        lambda m: {"block": m.p.cooling * (m.u.jacket - m.x.block)},
        "block K 320 scale=30",
        "jacket K nominal=320",
        "block K 0.05",
        "cooling 1/s 0.05 0.01 0.2",
    )
    rng, x, rows = np.random.default_rng(1), 320.0, []
    for jacket in np.repeat(rng.uniform(300.0, 400.0, 15), 40):
        rows.append((jacket, x + 0.05 * rng.normal()))
        # 36 parts of 42 go to the jacket, the others to a room at 290 K.
        rest = (36.0 * jacket + 6.0 * 290.0) / 42.0
        x = rest + (x - rest) * math.exp(-0.042 * 2.0)
    jacket, read = np.array(rows).T
    run = recording("warmed", 2.0, {"jacket [K]": jacket}, {"block [K]": read})
    seen = observe(block, run)
    priors = tuple(default_priors(block))
    base = fit_with_process_noise(block, [seen], priors)
    laws = {
        h.name: h for h in library(block, RecordedFacts(duration=2.0 * len(read), sample_time=2.0))
    }
    field, first = [], []
    for name in ("heat_loss_block", "offset_jacket_command"):
        own, start = refits.entry_priors(laws[name])
        model = block.with_effect(laws[name].at_size(0.0))
        fit = fit_with_process_noise(
            model,
            [extended_start(seen, block, model)],
            (*priors, *own),
            start=start,
            noise_scale=base.noise_scale,
            follow=False,
        )
        first.append(Candidate(laws[name], fit, base.cost - fit.cost))
        field.append(_score(laws[name], 900.0))
    prior = base.cost - float(blocks_of_cost(base, [seen]).sum())
    race = refits.Race(base, priors, [seen], known=prior)
    loss, offset = refits._trusted(race, field, first)
    assert loss.gain > 5.0 * first[0].gain
    assert loss.fit is not None
    found = {e.name: e.value for e in loss.fit.refit.estimates}
    assert found["heat_loss_block.conductance"] == pytest.approx(0.006, rel=0.02)
    assert offset is first[1]
    # What gains more as it trusts the equations more says nothing of what trusts them less.
    assert first[1].fit is not None
    trusting = replace(first[1].fit, noise_scale=0.1 * base.noise_scale)
    rival = replace(first[1], fit=trusting, gain=5.0 * first[0].gain)
    beside = refits._trusted(race, field, [first[0], rival])
    assert beside[0].gain == pytest.approx(loss.gain)


def test_beside_what_explains_nearly_all_a_law_that_gains_little_is_tried_in_one_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[Any] = []

    def refitted(_: Any, score: Score, *given: Any) -> Any:
        tried.append(given[0])
        refit = SimpleNamespace(estimates=(), values={})
        return score, SimpleNamespace(cost=90.0, noise_scale=1.0, refit=refit)

    monkeypatch.setattr(refits, "_refitted", refitted)
    monkeypatch.setattr(refits, "start_values", lambda *_: {})
    on_bound = SimpleNamespace(name="level", value=1.0, on_bound=True)
    base: Any = SimpleNamespace(
        noise_scale=1.0, refit=SimpleNamespace(estimates=(on_bound,), values={})
    )
    race = refits.Race(base, (), [], thorough=False)
    tilt, far = "tilt_gravity", next(e for e in _entries().values() if e.far)
    for entry, least, once in (
        (tilt, 0.0, False),
        (tilt, 20.0, True),
        (tilt, 5.0, False),
        (far, 20.0, False),
    ):
        tried.clear()
        refits._first(race, 100.0, _score(entry, 9.0), 1.0, least=least)
        assert (len(tried) == 1) is once


def test_an_event_is_not_followed_where_the_same_all_the_time_explains_as_much() -> None:
    names = ("sensor_offset_angle", "sensor_jump_angle", "sensor_jump_pressure_1")
    offset, jump, other = (_candidate(n, 100.0 - i, 0.5) for i, n in enumerate(names))
    assert refits._leaders([offset, jump, other], 0) == [0, 2]
    assert refits._leaders([offset, replace(jump, gain=101.0)], 0) == [1, 0]
    # What trusts the equations less gains more without saying more.
    assert refits._leaders([offset, replace(jump, fit=_trusting(jump))], 0) == [0, 1]


def test_events_of_several_recordings_are_followed_beside_what_gains_more_at_one_time() -> None:
    names = ("stribeck_friction", "ripple", "valve_offset", "tilt_gravity")
    events = [entry for entry in _entries().values() if is_event(entry.effect)][:3]
    known = [*names, *events]
    gains = (100.0, 99.0, 98.0, 97.0, 80.0, 79.0, 40.0)
    first = [
        replace(_candidate(e, gain, 0.5), followed=False)
        for e, gain in zip(known, gains, strict=True)
    ]
    assert refits._leaders(first, 0) == [0, 1, 2, 3]
    assert refits._leaders(first, 0, several=True) == [0, 1, 2, 3, 4]
    # Another that gained as much at one time may have come at those times instead.
    now = [replace(c, followed=i < 5) for i, c in enumerate(first)]
    assert refits._came_too(first, now, replace(now[4], gain=300.0)) == [5]
    assert refits._came_too(first, now, now[0]) == []
