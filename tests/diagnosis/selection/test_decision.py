"""Which of several refitted hypotheses is taken, and why the others are not."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.diagnosis.axis_case import diagnosed
from tests.diagnosis.selection.candidates import (
    ASKED,
    WITHOUT,
    entries,
    made_candidate,
    run_of,
    taken_of,
)
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.decision import decided, degenerates_to, preferred
from workbench.diagnosis.selection.held_out import NO_RUNS
from workbench.diagnosis.selection.pairs import as_told
from workbench.diagnosis.selection.rules import TOO_LITTLE, Limits
from workbench.diagnosis.selection.selected import Accepted
from workbench.physics.drift import offset_jump
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.physics.survey import Survey
from workbench.plants.arm import arm


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
    failed = Candidate(entries()["ripple"], None, -math.inf, refused="failed")
    assert failed.size is None and "failed" in str(failed)
    held = Candidate(entries()["lines"], cast(Any, SimpleNamespace()), 1.0, (0.0, 0.0, 0.0))
    assert held.entry.replaces is (held.size is None)


def _winners(*candidates: Candidate, limits: Limits = ASKED) -> list[str]:
    return taken_of(decided(candidates, WITHOUT, limits))


def test_a_law_of_the_process_must_not_spoil_free_runs() -> None:
    pair = [
        made_candidate("stribeck_friction", 900.0, 7.0),
        made_candidate("valve_offset", 500.0, 0.5),
    ]
    found = decided(pair, WITHOUT, ASKED)
    assert taken_of(found) == ["valve_offset"] and found[0].rule == "free run"


def test_what_makes_all_recordings_likelier_than_a_reliable_law_passes_with_it() -> None:
    friction = made_candidate("stribeck_friction", 900.0, 0.3)
    by_moments = replace(friction, held_out=(720.0, -1.0, 1400.0))
    offset = made_candidate("valve_offset", 500.0, 0.5)
    near = Limits(20.0, 100.0, near_noise=True)
    assert _winners(by_moments, offset, limits=near) == ["stribeck_friction"]
    assert _winners(by_moments, limits=near) == []
    worse = replace(by_moments, held_out=(400.0, -1.0, 800.0))
    assert _winners(worse, offset, limits=near) == ["valve_offset"]


def test_a_simpler_effect_whose_runs_are_much_closer_need_not_be_the_likelier() -> None:
    for error, taken in ((0.3, "valve_offset"), (0.55, "stribeck_friction")):
        stribeck = made_candidate("stribeck_friction", 900.0, 0.6)
        assert _winners(stribeck, made_candidate("valve_offset", 500.0, error)) == [taken]


def test_what_a_perfect_predictor_lacks_has_to_show_in_free_runs() -> None:
    for error, taken in ((1.0, []), (0.5, ["valve_offset"])):
        offset = made_candidate("valve_offset", 500.0, error)
        assert _winners(offset, limits=Limits(20.0, 100.0, perfect=True)) == taken
        assert _winners(offset) == ["valve_offset"]


def test_a_sensor_has_to_show_in_free_runs() -> None:
    offset = made_candidate("valve_offset", 500.0, 0.5)
    worse, closer = (made_candidate("sensor_lag_angle", 900.0, error) for error in (1.2, 0.2))
    assert _winners(worse, offset) == ["valve_offset"]
    assert _winners(worse) == []
    assert _winners(closer, offset) == ["sensor_lag_angle"]
    # What remembers nothing colours no noise: the rest of the error may be of what else is missing.
    for name in ("sensor_offset_angle", "sensor_jump_angle"):
        reads_wrong = made_candidate(name, 900.0, 1.02)
        assert _winners(reads_wrong, offset) == ["valve_offset"]
        assert _winners(reads_wrong) == [name]


def test_of_processes_that_run_closer_than_a_sensor_the_closest_is_taken() -> None:
    lag, offset = (
        made_candidate("sensor_lag_angle", 900.0, 0.9),
        made_candidate("valve_offset", 500.0, 0.3),
    )
    for error, taken in ((0.8, "valve_offset"), (0.1, "stribeck_friction")):
        friction = made_candidate("stribeck_friction", 600.0, error)
        assert _winners(lag, friction, offset) == [taken]


@pytest.mark.parametrize(("error", "taken"), [(0.5, True), (0.9, False)])
def test_what_explains_little_is_likely_if_it_takes_much_of_the_free_run(
    error: float, taken: bool
) -> None:
    one = [made_candidate("valve_offset", 80.0, error)]
    found = decided(one, WITHOUT, ASKED)
    assert bool(taken_of(found)) is taken
    assert bool(found[0].doubts) is taken


def test_what_can_be_run_is_closer_than_what_cannot() -> None:
    assert WITHOUT.closer_than(NO_RUNS) and not NO_RUNS.closer_than(WITHOUT)
    assert NO_RUNS.spoilt_from(WITHOUT) and not WITHOUT.spoilt_from(NO_RUNS)


def test_what_lies_within_a_few_units_unseen_recordings_decide() -> None:
    first = made_candidate("valve_offset", 500.0, 0.5)
    other = made_candidate("stribeck_friction", 490.0, 0.5)
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
    first = made_candidate("valve_offset", 900.0, 0.8)
    closer = made_candidate("stribeck_friction", 600.0, 0.4)
    unseen = replace(closer, held_out=(950.0, 700.0, 1200.0))
    assert _winners(first, unseen) == [closer.name]
    alike = replace(unseen, blocks=first.blocks)
    assert _winners(first, alike) == [closer.name]
    # Neither the likelier of the two on unseen recordings alone, nor the closer run alone, is.
    as_close = replace(unseen, run=run_of(0.7))
    assert _winners(first, closer) == [first.name]
    assert _winners(first, as_close) == [first.name]
    # What has a size of its own in each recording takes that from the unseen one.
    level = made_candidate("offset_by_recording_valve_command", 600.0, 0.4)
    told = replace(level, held_out=unseen.held_out)
    assert _winners(first, told) == [first.name]


def test_a_jump_at_time_zero_is_the_offset_that_it_degenerates_to() -> None:
    survey = Survey(arm(3), RecordedFacts(duration=20.0))
    (jump,) = [h for h in offset_jump.hypotheses(survey) if h.ports == ("joint.torque",)]
    (constant,) = [h for h in library(arm(3)) if h.name == "constant_torque"]

    def refitted(
        gain: float, *, scale: float = 0.03, uneven: float = 4.0, **known: Any
    ) -> Candidate:
        return made_candidate(jump, gain, 0.1, scale=scale, uneven=uneven, **known)

    plain = made_candidate(constant, 900.0, 0.1, scale=0.03)
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
    large = made_candidate(constant, 30e3, 0.1, scale=0.03)
    assert degenerates_to(refitted(30.05e3, uneven=0.5), large)
    assert not degenerates_to(refitted(30.5e3, uneven=0.5), large)
    assert not degenerates_to(refitted(30.05e3, uneven=9.0), large)


@pytest.mark.parametrize("together", [False, True])
def test_what_explains_little_alone_is_no_doubt_where_all_together_explain_most(
    *, together: bool
) -> None:
    candidate = replace(made_candidate("valve_offset", 900.0, 0.1), doubts=(TOO_LITTLE, "odd"))
    assert candidate.fit is not None
    told = as_told(Accepted(candidate, ()), candidate.fit, together=together).candidate
    assert told.doubts == (("odd",) if together else (TOO_LITTLE, "odd"))


def test_what_is_lost_on_unseen_recordings_was_overfitted() -> None:
    simple, rich = "valve_offset", "stribeck_friction"
    plain = made_candidate(simple, 900.0, 0.1, parameters=1)
    for unseen, taken in ((870.0, simple), (890.0, rich), (940.0, rich)):
        other = made_candidate(rich, 940.0, 0.1, unseen=unseen, parameters=3)
        assert _winners(other, plain) == [taken], unseen
