"""Search: what is taken back, and why."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.example_diagnosis import example_diagnosis, example_task
from tests.diagnosis.newcomers import levels, oscillations, oscillator, recorded
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import Prior, default_priors, entry_priors, entry_start
from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.selection import pairs, withdrawal
from workbench.diagnosis.selection import search as selection_search
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.pairs import _openings, with_pair
from workbench.diagnosis.selection.rules import (
    FREE_RUN,
    HELD_OUT,
    LEAST_PREDICTED,
    LEAST_SHARE,
    SHARE,
    Limits,
)
from workbench.diagnosis.selection.search import as_it_is_told
from workbench.diagnosis.selection.selected import Accepted, Round, Selected
from workbench.diagnosis.selection.simplification import simplified
from workbench.diagnosis.selection.task import Task
from workbench.diagnosis.selection.withdrawal import taken_up_again, too_little_withdrawn
from workbench.physics.library import Hypothesis, library


def test_effects_that_explain_too_little_are_taken_back_with_the_reason() -> None:
    given, task = example_diagnosis(), example_task()
    gain = given.base.cost - given.selected.fits[1].cost
    little = gain / (0.8 * LEAST_SHARE)
    ((found, alike),) = given.selected.accepted
    unseen = replace(given.selected, accepted=(Accepted(replace(found, run=None), alike),))
    left = too_little_withdrawn(task, unseen, little)
    assert left.accepted == () and left.extended is given.base
    ((candidate, why),) = left.withdrawn
    assert candidate.entry.name == "coulomb_friction"
    assert why.startswith(f"explains too little: {80 * LEAST_SHARE:.0f} %")
    assert too_little_withdrawn(task, given.selected, gain) is given.selected
    # Free runs show it: where no other search finds more, it is told, with a doubt.
    assert taken_up_again(task, left) is left
    aside = too_little_withdrawn(task, given.selected, little)
    assert aside.accepted == () and aside.extended is given.base
    assert aside.free == task.priors
    told = taken_up_again(task, aside)
    ((kept, _),) = told.accepted
    assert kept.name == "coulomb_friction" and why in kept.doubts[-1]
    assert told.extended.cost == given.selected.fits[1].cost and told.withdrawn == ()
    # But not if it predicts next to nothing of what is missing.
    gone = too_little_withdrawn(task, given.selected, 2.0 * gain / LEAST_PREDICTED)
    assert gone.accepted == gone.aside == () and left.aside != ()


@pytest.mark.parametrize("one_place", [False, True])
def test_a_search_begins_again_unless_all_is_missing_at_one_place(
    one_place: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, task = example_diagnosis(), example_task()
    task.__dict__["one_place"] = (Location({}), given.base) if one_place else None
    came_to_nothing = Selected(given.base, task.priors, began="creep")
    monkeypatch.setattr(selection_search, "_round", lambda *_: (came_to_nothing, False))
    assert given.scored is not None
    state = selection_search._advanced(task, given.scored, came_to_nothing)
    assert state.failed == ("creep",) and state.finished is one_place


@pytest.mark.parametrize("apart", [False, True])
def test_what_is_not_told_from_a_beginning_that_led_nowhere_is_none(
    apart: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, task = example_diagnosis(), example_task()
    ((found, _),) = given.selected.accepted
    entry = replace(found.entry, effect=replace(found.entry.effect, name="other"))
    blocks = tuple(b + 50.0 * apart for b in found.blocks)
    other = replace(found, entry=entry, blocks=blocks, gain=found.gain - 50.0 * apart)
    assert given.scored is not None
    first = Round(given.scored.scores, (found, other))
    state = Selected(given.base, task.priors, rounds=(first,), failed=(found.name,))
    begun: list[str] = []

    def begins(_: Task, state: Selected, one: Candidate, __: Round) -> Selected:
        begun.append(one.name)
        return state

    monkeypatch.setattr(selection_search, "with_candidate", begins)
    selection_search._round(task, given.scored, state)
    assert begun == ["other"] * apart


@pytest.mark.parametrize(("share", "more"), [(0.2, False), (0.4, True)])
def test_near_the_noise_what_is_left_may_be_another_effect(
    monkeypatch: pytest.MonkeyPatch, share: float, more: bool
) -> None:
    monkeypatch.setattr(selection_search, "_near_noise", lambda *_: True)
    given, task = example_diagnosis(), example_task()
    extended = replace(given.selected.extended, noise_scale=0.03)
    left = replace(given.scored, excess=100.0, perfect=extended.cost - 100.0 * share)
    before, state = replace(given.base, noise_scale=0.3), replace(given.selected, extended=extended)
    assert selection_search.goes_on(task, left, before, state) is more


@pytest.mark.parametrize(("near", "whiteness", "more"), [(0, 0.7, 1), (0, 1.0, 0), (1, 0.7, 0)])
def test_sensors_less_noisy_than_declared_hide_nothing(
    monkeypatch: pytest.MonkeyPatch, near: int, whiteness: float, more: int
) -> None:
    monkeypatch.setattr(selection_search, "_near_noise", lambda *_: bool(near))
    given, task = example_diagnosis(), example_task()
    extended = given.selected.extended
    refit = replace(extended.refit, whiteness=dict.fromkeys(extended.refit.whiteness, whiteness))
    state = replace(given.selected, extended=replace(extended, refit=refit))
    scored = replace(given.scored, excess=1e3, perfect=extended.cost + 10.0)
    samples = sum(r.outputs.size for r in task.fitting)
    left = selection_search._left(task, scored, state, 50.0)
    assert left == pytest.approx(0.5 * (1.0 - whiteness) * samples * more - 10.0)


def test_an_effect_is_doubted_as_sure_as_it_is_told() -> None:
    given = example_diagnosis()
    fit = given.selected.extended
    vague = tuple(replace(e, std=abs(e.value)) for e in fit.refit.estimates)
    unsure = replace(fit, refit=replace(fit.refit, estimates=vague))
    state = replace(given.selected, extended=unsure, closest={"extended": fit})
    ((found, _),) = as_it_is_told(state, 1.0).accepted
    assert found.doubts == ()
    ((found, _),) = as_it_is_told(replace(state, closest={}), 1.0).accepted
    assert found.doubts == ("its size is within 3 standard deviations of zero",)


def test_only_what_gains_where_it_was_not_fitted_opens_a_pair() -> None:
    given = example_diagnosis()
    candidate = given.selected.accepted[0].candidate
    asked = Limits(penalty=0.5 * min(candidate.gain, candidate.held_out[0]))
    for rule in (SHARE.name, HELD_OUT.name, FREE_RUN):
        refused = replace(candidate, refused="too little", rule=rule)
        assert _openings([refused, refused], asked) == [refused]
        assert _openings([replace(refused, held_out=(0.0, -1.0, 1.0))], asked) == []
        assert _openings([replace(refused, gain=0.0)], asked) == []
    assert _openings([replace(candidate, refused="failed", rule="refit")], asked) == []


def _opened(task: Task) -> tuple[Candidate, Selected]:
    """Return what may open a pair, and a search that found it too little."""
    given = example_diagnosis()
    (found,) = given.selected.accepted
    opening = replace(found.candidate, refused="too little", rule=SHARE.name)
    rounds = (given.selected.rounds[0]._replace(candidates=(opening,)),)
    base = replace(given.base, noise_scale=0.3)
    return opening, replace(given.selected, rounds=rounds, extended=base, free=task.priors)


def test_where_the_equations_leave_nothing_out_no_pair_is_searched_for() -> None:
    said: list[str] = []
    given = example_diagnosis()
    task = example_task(
        entries=tuple(s.entry for s in given.selected.rounds[0].scores.scores), say=said.append
    )
    opening, both = _opened(task)
    asked = Limits(0.5 * min(opening.gain, opening.held_out[0]))
    assert _openings([opening], asked) == [opening]
    begun = replace(both, accepted=())
    assert with_pair(task, begun, replace(asked, near_noise=True)) is begun
    perfect = replace(begun, extended=replace(begun.extended, noise_scale=0.03))
    assert with_pair(task, perfect, asked) is perfect
    assert said == []
    with_pair(task, begun, asked)
    assert said[0] == "searching for what coulomb_friction hides"


@pytest.mark.parametrize(
    ("explained", "left", "searched"), [(0.99, 0.4, True), (0.99, 0.2, False), (0.4, 0.2, True)]
)
def test_beside_what_drifts_a_pair_is_searched_for_while_much_is_left_out(
    monkeypatch: pytest.MonkeyPatch, explained: float, left: float, searched: bool
) -> None:
    task = example_task()
    opening, begun = _opened(task)
    beside: list[str] = []

    def completed(
        _: object, state: Selected, begun: Selected, *__: object
    ) -> tuple[Selected, None]:
        beside.append(begun.accepted[-1].candidate.name)
        return state, None

    monkeypatch.setattr(pairs, "run_freely", lambda _, state: (state, explained))
    monkeypatch.setattr(pairs, "with_candidate", lambda _, state, *__: state)
    monkeypatch.setattr(pairs, "_completed", completed)
    asked = Limits(0.5 * min(opening.gain, opening.held_out[0]))
    assert with_pair(task, begun, asked, left).accepted == begun.accepted
    assert beside == ["coulomb_friction"] * searched


@pytest.mark.parametrize(("noise_scale", "searched"), [(0.03, 1), (0.3, 2)])
def test_beside_a_pair_that_leaves_nothing_out_no_other_opening_is_tried(
    monkeypatch: pytest.MonkeyPatch, noise_scale: float, searched: int
) -> None:
    task = example_task()
    opening, found = _opened(task)
    begun = replace(found, accepted=())
    both = replace(found, extended=replace(found.extended, noise_scale=noise_scale))
    tried: list[Selected] = []

    def completed(_: object, state: Selected, *__: object) -> tuple[Selected, Selected]:
        tried.append(state)
        return state, both

    monkeypatch.setattr(pairs, "_openings", lambda *_, **__: [opening, opening])
    monkeypatch.setattr(pairs, "with_candidate", lambda _, state, *__: state)
    monkeypatch.setattr(pairs, "_completed", completed)
    with_pair(task, begun, Limits(1.0))
    assert len(tried) == searched


def test_what_ends_on_its_upper_bound_may_be_too_little() -> None:
    given, task = example_diagnosis(), example_task()
    assert task._more_of == set()
    estimate = given.base.refit.estimates[0]
    prior = replace(estimate.prior, name="drag.level", lower=0.0, mean=1.0, upper=2.0)
    for value, more in ((2.0, {"drag"}), (0.0, set()), (1.0, set())):
        ended = replace(
            estimate, name="drag.level", value=value, prior=prior, on_bound=value != 1.0
        )
        refit = replace(given.base.refit, estimates=(ended,))
        assert replace(task, base=replace(given.base, refit=refit))._more_of == more


def _found_instead(
    task: Task,
    state: Selected,
    entry: Hypothesis,
    own: tuple[Prior, ...],
    start: dict[str, float],
    noise_scale: float = 0.03,
) -> Selected:
    """Return a search that found one law instead of another, refitted."""
    model, free = task.base.model.with_effect(entry.at_size(0.0)), (*task.priors, *own)
    seen = task.started(task.fitting, model)
    fit = fit_with_process_noise(model, seen, free, start=start, noise_scale=noise_scale)
    candidate = replace(state.accepted[0].candidate, entry=entry, fit=fit)
    accepted = (Accepted(candidate, (entry.name,)),)
    return replace(state, accepted=accepted, extended=fit, free=free)


def test_what_ended_as_a_simpler_law_is_told_as_that() -> None:
    given, task = example_diagnosis(), example_task()
    assert simplified(task, given.selected) is given.selected
    (curve,) = (e for e in task.tried(given.base.model) if e.law == "stribeck_friction")
    ((found, _),) = given.selected.accepted
    tuned = {q.name: q.value for q in found.entry.effect.parameters if not q.fitted}
    curve = replace(curve, effect=curve.effect.with_parameters(tuned))
    own, start = entry_priors(curve), entry_start(curve)
    # Of the places where its shape is that of a simpler law, the one at a bound.
    own = tuple(
        replace(p, lower=1.0 - 1e-6) if p.name.endswith("coulomb_share") else p for p in own
    )
    level = given.selected.extended.refit.estimate("coulomb_friction.level").value
    begin = start | {f"{curve.name}.break_away": level, f"{curve.name}.coulomb_share": 1.0}
    named = _found_instead(task, given.selected, curve, own, begin)
    assert named.extended.refit.estimate(f"{curve.name}.coulomb_share").on_bound
    ((told, alike),) = simplified(task, named).accepted
    assert told.entry.law == "coulomb_friction" and alike == (told.name,)
    assert told.size is not None and told.size.value == pytest.approx(level, rel=0.02)


@pytest.mark.parametrize("other", [1.01, -1.0])
def test_what_ended_alike_in_all_recordings_is_told_as_what_acts_always(other: float) -> None:
    given, task = example_diagnosis(), example_task()
    tried = {e.law: e for e in task.tried(given.base.model)}
    entry = tried["offset_by_recording"]
    (level,) = entry.effect.states
    level = replace(level, start_in=(("axis 1", 1.0), ("axis 2", other)))
    entry = replace(entry, effect=replace(entry.effect, states=(level,)))
    # Neither explains what is hidden there: trusted, the equations end in any of many valleys.
    named = _found_instead(
        task, given.selected, entry, entry_priors(entry), entry_start(entry), 1.0
    )
    ((told, _),) = simplified(task, named).accepted
    assert told.entry.law == ("constant_force" if other > 0.0 else "offset_by_recording")


@dataclass(frozen=True)
class _Found:
    extended: Any
    closest: Any = None


@pytest.mark.parametrize(
    ("windows", "whole", "share"),
    [
        # Within slack no filter knows where a window begins: all of the recording tells more.
        (0.9, 0.2, 0.97),
        # It drifts: what windows say stands.
        (0.9, 2.0, 0.19),
        # What goes farther than without it is not excused by its uncertain starts.
        (2.0, 2.0, 0.0),
    ],
)
def test_runs_over_windows_do_not_hide_that_all_of_a_recording_is_followed(
    monkeypatch: pytest.MonkeyPatch, windows: float, whole: float, share: float
) -> None:
    over_windows = {"refitted": 1.0, "extended": windows}
    over_all = {"refitted": 1.2, "extended": whole}

    def runs(errors: dict[str, float]) -> Any:
        return lambda fit, *_: SimpleNamespace(rmse={"y": errors[getattr(fit, "model", fit)]})

    monkeypatch.setattr(withdrawal, "judged_run", runs(over_windows))
    monkeypatch.setattr(withdrawal, "settled_run", runs(over_all))
    floors = {"refitted": {"y": 0.1}, "extended": {"y": 3.0 if windows > 1.0 else 0.1}}
    monkeypatch.setattr(withdrawal, "start_floors", lambda *_: floors)
    seen = SimpleNamespace(
        name="a", used=("y",), all_noise_rms=np.array([0.1]), drifts=True, diverges=False
    )
    refitted, extended = (SimpleNamespace(model=name) for name in ("refitted", "extended"))
    task: Any = SimpleNamespace(
        base=refitted, nominal=None, judging=(seen,), closest=lambda fit, robust: fit
    )
    state: Any = _Found(extended)
    assert withdrawal.run_freely(task, state)[1] == pytest.approx(share, abs=0.01)


def test_a_damper_on_its_bound_hides_no_more_viscosity(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = oscillations(lambda x, v: -30.0 * x - 1.5 * v)
    free = oscillator()
    kept = [replace(q, upper=0.9) if q.name == "damping" else q for q in free.parameters]
    model = replace(free, parameters=tuple(kept))
    seen, priors = [observe(model, r) for r in runs], default_priors(model)
    fit = fit_with_process_noise(model, seen[:2], priors)
    assert [e.name for e in fit.refit.estimates if e.on_bound] == ["damping"]
    more = tuple(e for e in library(model) if e.law == "viscous_friction")
    task = Task(model, fit, tuple(seen[:2]), tuple(seen[2:]), priors, entries=more)

    # Off its bound the damper is the same law, and may leave nothing to it.
    def score_library(model: Any, recordings: Any, free: Any, entries: Any, **known: Any) -> Any:
        found = scored(model, recordings, free, entries, **known)
        if all(p.name != "damping" for p in free):
            return found
        hidden = (replace(s, sigma=0.1, collinearity=1.0) for s in found.scores)
        return replace(found, scores=tuple(hidden))

    scored = selection_search.score_library
    monkeypatch.setattr(selection_search, "score_library", score_library)
    (found,) = selection_search.score(task).scores.scores
    assert found.testable and found.collinearity < 0.9
    assert found.size == pytest.approx(0.6, rel=0.3)


@pytest.mark.parametrize(("excess", "tried"), [(0.0, 0), (500.0, 3)])
def test_held_out_runs_a_little_off_by_chance_call_for_no_law_that_does_not_score(
    excess: float, tried: int
) -> None:
    model = oscillator()
    force = lambda x, v: -30.0 * x - 0.6 * v  # noqa: E731
    seen = [
        observe(model, recorded(1.2, force, levels(200, i, 6.0, 15, 40), 0.02, 1e-3, seed=i))
        for i in (1, 2)
    ]
    priors = default_priors(model)
    base = fit_with_process_noise(model, seen[:1], priors)
    laws = ("cubic_stiffness", "coulomb_friction", "quadratic_drag")
    few = tuple(e for e in library(model) if e.law in laws)
    task = Task(model, base, (seen[0],), (seen[1],), priors, entries=few, jobs=1)
    scored = replace(selection_search.score(task), over_floor={"position": 1.15}, excess=excess)
    first = next(iter(selection_search.search(task, scored)))
    assert len(first.rounds[0].candidates) == tried
    # However little a filter trusts equations that leave nothing out, they are complete.
    assert scored.near_noise(replace(base, noise_scale=0.3)) is (excess == 0.0)
    assert not first.accepted


@pytest.mark.parametrize(
    ("lacking", "far", "complete"), [(0.04, 1.05, True), (0.06, 1.05, False), (0.04, 1.15, False)]
)
def test_nothing_is_missing_where_runs_are_at_the_noise_and_next_to_nothing_is_lacking(
    lacking: float, far: float, complete: bool
) -> None:
    given = example_diagnosis()
    samples = sum(r.outputs.size for r in given.prepared.fitting)
    scored = replace(given.scored, over_floor={"position": far}, excess=lacking * samples)
    fitted = replace(given.fitted, base=replace(given.base, noise_scale=0.3))
    found = replace(given, scored=scored, fitted=fitted, validated=None)
    # What was found speaks for itself.
    assert not found.complete
    nothing = replace(found, selected=replace(given.selected, accepted=()))
    assert nothing.complete is complete
