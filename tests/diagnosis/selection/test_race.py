"""The race: what is refitted on how much, and what is followed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest

from tests.diagnosis.axis_case import SAMPLE_TIME, excitation, positions
from tests.diagnosis.example_diagnosis import example_diagnosis
from tests.diagnosis.machine_data import recording
from tests.diagnosis.newcomers import driven_carts, two_carts
from tests.diagnosis.selection.candidates import (
    WITHOUT,
    entries,
    made_candidate,
    made_score,
    taken_of,
    trusting,
)
from tests.machines import machine
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.priors import default_priors, entry_priors, entry_start
from workbench.diagnosis.estimation.process_noise import (
    PERFECT,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
)
from workbench.diagnosis.estimation.simulated_recordings import (
    pushes,
    simulated,
    simulated_axis,
    simulated_recording,
)
from workbench.diagnosis.selection import race
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.first_refit import first_refit, untried
from workbench.diagnosis.selection.moments import is_event
from workbench.diagnosis.selection.refit_in_turn import Basis
from workbench.diagnosis.selection.rules import SURPASSED, Limits
from workbench.diagnosis.selection.score import Score, by_name, score_library
from workbench.diagnosis.selection.task import Task
from workbench.model import State
from workbench.physics.law import Law, size, twins
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.physics.survey import Survey
from workbench.plants.servo_axis import servo_axis


def test_the_best_score_is_followed_whatever_its_first_refit_gained() -> None:
    names = ("stribeck_friction", "ripple", "valve_offset", "tilt_gravity", "local_catch")
    first = [made_candidate(name, 100.0 - i, 0.5) for i, name in enumerate(names)]
    first[4] = replace(first[4], gain=-3.0)
    assert race._leaders(first, 4) == [0, 1, 2, 3, 4]
    assert race._leaders(first, 1) == [0, 1, 2, 3]
    assert race._leaders([replace(first[4], fit=None)], 0) == []
    assert race._leaders([first[4]], 0) == [0]


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
    assert jump.late > race._HEADS[0]
    prior = base.cost - float(blocks_of_cost(base, [observed]).sum())
    (found,) = race._raced(Basis(base, priors, [observed], known=prior), [jump])
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

    def first(basis: Any, score: Score, *__: Any) -> Any:
        thorough[score.gain] = basis.thorough
        leads = score.gain == 29.0 - leader
        found = SimpleNamespace(noise_scale=scale if leads else 3.0)
        lag = SimpleNamespace(about=SimpleNamespace(level=False), states=(State("read", "m", 1.0),))
        entry = SimpleNamespace(group=group, effect=lag)
        return SimpleNamespace(entry=entry, fit=found, gain=score.gain)

    monkeypatch.setattr(race, "first_refit", first)
    monkeypatch.setattr(race, "_head", lambda basis, head: basis._replace(fit_on=head))
    entry = library(servo_axis())[0]
    field = [made_score(entry, float(gain)) for gain in range(30)]
    seen: Any = simulated_axis(1, samples=100)
    base: Any = SimpleNamespace(noise_scale=before)
    heads = race._heads(Basis(base, (), [seen]), field, 1500)
    found = race._first_refits(heads, field, 10.0)
    assert [c.gain for c in found] == [*range(30)]
    assert [thorough[29.0 - rank] for rank in range(30)] == [rank < all_ways for rank in range(30)]


@pytest.mark.parametrize("fails", [False, True])
def test_what_explains_less_is_followed_where_what_explains_nearly_all_is_refused(
    monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    names = ("sensor_lag_angle", "valve_offset")
    both = [made_candidate(n, gain, 0.5) for n, gain in zip(names, (900.0, 400.0), strict=True)]
    first = [replace(c, refused=SURPASSED, followed=False, fit=trusting(c)) for c in both]
    tried, found = _followed_of(monkeypatch, first, fails=names[:1] * fails)
    assert tried == [*names[: 1 + fails]]
    assert taken_of(found) == [names[int(fails)]]


@pytest.mark.parametrize(("cosine", "trusts"), [(0.97, False), (0.97, True), (0.9995, True)])
def test_what_does_the_same_as_what_was_found_is_followed_and_may_take_its_place(
    monkeypatch: pytest.MonkeyPatch, cosine: float, trusts: bool
) -> None:
    names = ("cubic_drag", "ripple", "tilt_gravity", "valve_offset", "quadratic_drag")
    gains = (900.0, 30.0, 29.0, 28.0, 6.0)
    every = [made_candidate(n, gain, 0.5) for n, gain in zip(names, gains, strict=True)]
    first = [replace(c, refused=SURPASSED, followed=False) for c in every]
    first[0] = replace(first[0], fit=trusting(first[0]))
    if trusts:
        first[-1] = replace(first[-1], fit=trusting(first[-1]))

    def alike(name: str, above: float = 0.95) -> tuple[str, ...]:
        return names[-1:] * (name == names[0] and cosine > above)

    tried, found = _followed_of(monkeypatch, first, alike, gained={names[-1]: 1200.0})
    # One of two that nearly do the same may have come to trust the equations by chance.
    again = cosine > 0.999 or not trusts
    assert tried == [names[0], *names[4:] * again]
    assert taken_of(found) == [names[4 if again else 0]]


def test_sensors_that_are_refused_take_nobodys_place(monkeypatch: pytest.MonkeyPatch) -> None:
    # A gain of the angle beside a load that swings: lags and delays gain more, and run no closer.
    names = ("sensor_lag_pressures", "sensor_delay_pressures", "clock_shift", "tilt_gravity",
             "sensor_gain_angle")  # fmt: skip
    first = [
        replace(made_candidate(name, 900.0 - 100.0 * i, 0.5), followed=False, refused=SURPASSED)
        for i, name in enumerate(names)
    ]
    late, rest = [names[0], names[1], names[3]], [names[4]]
    tried, found = _followed_of(monkeypatch, first, fails=(*late,), thorough=True)
    assert (tried, taken_of(found)) == ([*late, *rest], rest)
    # Once something was found, or where nothing may be missing, nobody waits for them.
    for known in ({"thorough": False}, {"thorough": True, "near_noise": True}):
        tried, found = _followed_of(monkeypatch, first, fails=(*late,), **known)
        assert (tried, taken_of(found)) == (late, [])


def _followed_of(
    monkeypatch: pytest.MonkeyPatch,
    first: list[Candidate],
    alike: Callable[..., Sequence[str]] | None = None,
    *,
    fails: tuple[str, ...] = (),
    gained: dict[str, float] | None = None,
    thorough: bool = False,
    near_noise: bool = False,
) -> tuple[list[str], tuple[Candidate, ...]]:
    """Return which of first refits were followed, and what became of all."""
    tried = []

    def followed(_: Any, candidate: Candidate, *__: Any) -> Candidate:
        tried.append(candidate.name)
        if candidate.name in fails:
            return replace(untried(candidate.entry, "it broke"), followed=True)
        gain = (gained or {}).get(candidate.name, candidate.gain)
        blocks = (np.full(30, -gain / 30.0),)
        return replace(candidate, refused="", followed=True, gain=gain, blocks=blocks)

    monkeypatch.setattr(race, "_heads", lambda basis, field, _: [basis] * len(field))
    monkeypatch.setattr(race, "_first_refits", lambda *_: list(first))
    monkeypatch.setattr(race, "_trusted", lambda *given: list(given[-1]))
    monkeypatch.setattr(race, "followed", followed)
    monkeypatch.setattr(race, "closest_errors", lambda *_: WITHOUT)
    monkeypatch.setattr(race, "blocks_of_cost", lambda *_: np.zeros(1))
    field = [made_score(c.name, 90.0) for c in first]
    base: Any = SimpleNamespace(cost=0.0, model=None)
    seen: Any = SimpleNamespace(outputs=np.zeros((100, 1)))
    limits = Limits(20.0, 100.0, near_noise=near_noise)
    found = race.refit_candidates(
        _task_of(seen), base, (), field, limits, alike=alike, thorough=thorough
    )
    return tried, found


def _task_of(seen: Any) -> Any:
    return SimpleNamespace(
        started=lambda recordings, _: recordings, fitting=[seen], judging=[], jobs=1, say=print
    )


def test_many_short_recordings_are_raced_on_some_among_them_the_one_that_shows_it_best(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recordings = [SimpleNamespace(name=k, outputs=np.zeros(600)) for k in range(12)]
    used = {}

    def first(heads: Any, field: Any, *_: Any) -> list[Any]:
        for head, score in zip(heads, field, strict=True):
            names = [r.name for r in head.fit_on]
            used[score.number] = names, names[score.clearest]
        return [score.number for score in field]

    @dataclass(frozen=True)
    class Shown:
        number: int
        clearest: int

    monkeypatch.setattr(race, "_heads", lambda basis, field, _: [basis] * len(field))
    monkeypatch.setattr(race, "_first_refits", first)
    field: Any = [Shown(0, 7), Shown(1, 2), Shown(2, 7)]
    raced = race._raced(Basis(cast(Any, None), (), cast(Any, recordings)), field)
    assert raced == [0, 1, 2]
    assert used[0] == used[2] == ([0, 1, 2, 3, 7], 7)
    assert used[1] == ([0, 1, 2, 3, 4], 2)


def test_what_was_refitted_beside_another_base_goes_on_from_there_and_is_not_raced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given = example_diagnosis()
    known, base = given.selected.accepted[0].candidate, replace(given.base, noise_scale=0.3)
    other = made_candidate("tilt_gravity", 50.0, 0.5)
    raced: list[str] = []
    handed: dict[str, Candidate] = {}

    def first(_heads: Any, field: Sequence[Score], *given: Any) -> list[Candidate]:
        handed.update(given[-1])
        return [replace(handed[s.entry.name], fit=None) for s in field]

    def on_beginnings(_basis: Any, field: Sequence[Score]) -> list[Candidate]:
        raced.extend(s.entry.name for s in field)
        return [other]

    monkeypatch.setattr(race, "_raced", on_beginnings)
    monkeypatch.setattr(race, "_heads", lambda basis, field, _: [basis] * len(field))
    monkeypatch.setattr(race, "_first_refits", first)
    monkeypatch.setattr(race, "blocks_of_cost", lambda *_: np.zeros(1))
    monkeypatch.setattr(race, "closest_errors", lambda *_: WITHOUT)
    field = [made_score(known.entry, 90.0), made_score(other.name, 90.0)]
    seen: Any = SimpleNamespace(outputs=np.zeros((9000, 1)))
    race.refit_candidates(
        _task_of(seen), base, (), field, Limits(20.0, 100.0), begun={known.name: known}
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
        task = Task(model, base, tuple(seen[:1]), tuple(seen[1:]), priors)
        found = race.refit_candidates(task, base, priors, scores.scores, Limits(20.0, 20.0))
        assert taken_of(found) == [name]
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
        own, start = entry_priors(laws[name]), entry_start(laws[name])
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
        field.append(made_score(laws[name], 900.0))
    prior = base.cost - float(blocks_of_cost(base, [seen]).sum())
    heads = race._heads(Basis(base, priors, [seen], known=prior), field, 5000)
    loss, offset = race._trusted(heads, first)
    assert loss.gain > 5.0 * first[0].gain
    assert loss.fit is not None
    found = {e.name: e.value for e in loss.fit.refit.estimates}
    assert found["heat_loss_block.conductance"] == pytest.approx(0.006, rel=0.02)
    assert offset is first[1]
    # What gains more as it trusts the equations more says nothing of what trusts them less.
    assert first[1].fit is not None
    trusting = replace(first[1].fit, noise_scale=0.1 * base.noise_scale)
    rival = replace(first[1], fit=trusting, gain=5.0 * first[0].gain)
    beside = race._trusted(heads, [first[0], rival])
    assert beside[0].gain == pytest.approx(loss.gain)


def test_what_was_refitted_on_a_longer_beginning_gains_no_more_for_that() -> None:
    axis, n = servo_axis(), 2400
    force = pushes(n, largest=200.0)
    truth = axis.with_effect(
        next(e for e in library(axis) if e.name == "linear_spring").at_size(600.0)
    )
    seen = observe(axis, simulated_recording(truth, force, sample_time=0.01))
    priors = default_priors(axis)
    base = fit_with_process_noise(axis, [seen], priors)
    tried = [e for e in library(axis) if e.name in ("linear_spring", "cubic_stiffness")]
    scores = by_name(score_library(base.model, [seen], priors, tried, noise_scale=base.noise_scale))
    basis = Basis(base, priors, [seen])
    spring, cubic = (
        first_refit(race._head(basis, [seen.part(slice(k))]), scores[name], 10.0)
        for name, k in (("linear_spring", 300), ("cubic_stiffness", 1800))
    )
    assert (spring.length, cubic.length) == (300, 1800)
    assert cubic.gain > spring.gain
    spring, cubic = race._with_common_gain(basis, [spring, cubic])
    assert cubic.common_gain == pytest.approx(cubic.gain, rel=0.1)
    assert spring.common_gain > cubic.common_gain > spring.gain
    # So it leads, and stands beside what gained most where it was refitted.
    assert race._ranked([cubic, spring]) == [0, 1]
    assert race._gains([cubic, spring])[1] == [cubic.common_gain, spring.common_gain]


def test_rivals_are_near_by_their_gains_or_by_those_on_as_long_a_beginning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(race, "_trusted", lambda *given: list(given[-1]))
    monkeypatch.setattr(race, "_with_common_gain", lambda _, found: list(found))
    late, always = (made_candidate(n, g, 0.5) for n, g in (("ripple", 900.0), ("creep", 400.0)))
    late, always = (replace(c, fit=trusting(c)) for c in (late, always))

    def rivals(*found: Candidate) -> tuple[list[int], list[int]]:
        return race._rivals(cast(Any, None), cast(Any, [None, None]), found, [0, 1])

    assert rivals(late, always) == ([0], [1])
    assert rivals(replace(late, common_gain=900.0), replace(always, common_gain=850.0)) == (
        [0, 1],
        [],
    )
    assert rivals(replace(late, common_gain=400.0), replace(always, common_gain=800.0)) == (
        [0, 1],
        [],
    )
    imperfect = replace(always, common_gain=1000.0, fit=made_candidate("creep", 1.0, 0.5).fit)
    assert rivals(replace(late, common_gain=900.0), imperfect) == ([0, 1], [])


def test_an_event_is_not_followed_where_the_same_all_the_time_explains_as_much() -> None:
    names = ("sensor_offset_angle", "sensor_jump_angle", "sensor_jump_pressure_1")
    offset, jump, other = (made_candidate(n, 100.0 - i, 0.5) for i, n in enumerate(names))
    assert race._leaders([offset, jump, other], 0) == [0, 2]
    later = replace(jump, gain=101.0)
    assert race._leaders([offset, later], 0) == [1, 0]
    # It was refitted on more of the recordings than what is always there.
    longer = [replace(offset, common_gain=150.0), replace(later, common_gain=120.0)]
    assert race._leaders(longer, 0) == [0]
    # What trusts the equations less gains more without saying more.
    assert race._leaders([offset, replace(jump, fit=trusting(jump))], 0) == [0, 1]


def test_events_of_several_recordings_are_followed_beside_what_gains_more_at_one_time() -> None:
    names = ("stribeck_friction", "ripple", "valve_offset", "tilt_gravity")
    events = [entry for entry in entries().values() if is_event(entry.effect)][:3]
    known = [*names, *events]
    gains = (100.0, 99.0, 98.0, 97.0, 80.0, 79.0, 40.0)
    first = [
        replace(made_candidate(e, gain, 0.5), followed=False)
        for e, gain in zip(known, gains, strict=True)
    ]
    assert race._leaders(first, 0) == [0, 1, 2, 3]
    assert race._leaders(first, 0, several=True) == [0, 1, 2, 3, 4]
    # Another that gained as much at one time may have come at those times instead.
    now = [replace(c, followed=i < 5) for i, c in enumerate(first)]
    assert race._came_too(first, now, replace(now[4], gain=300.0)) == [5]
    assert race._came_too(first, now, now[0]) == []


def test_more_trust_that_the_beginning_of_recordings_bears_is_no_gain_of_a_law() -> None:
    # Dry friction that comes late: with it the equations are trusted less than the beginning bears.
    axis = servo_axis().without("coulomb_friction")
    calm, rubbing = (
        simulated(m, pushes(600, largest=200.0), sample_time=0.01) for m in (axis, servo_axis())
    )
    early = np.arange(600) < 300
    seen = replace(rubbing, outputs=np.where(early[:, None], calm.outputs, rubbing.outputs))
    priors = tuple(default_priors(axis))
    base = fit_with_process_noise(axis, [seen], priors)
    assert base.noise_scale > PERFECT
    known = base.cost - float(blocks_of_cost(base, [seen]).sum())
    basis = Basis(base, priors, [seen], known=known)
    lag = next(h for h in library(axis) if h.name == "sensor_lag_position")
    (head,) = race._heads(basis, [made_score(lag, 9.0)], 300)
    usual, trusted = head.costs
    assert usual - trusted > 100.0
    (found,) = race._first_refits([head], [made_score(lag, 9.0)], 1.0)
    blind = first_refit(head._replace(costs=(usual, usual)), made_score(lag, 9.0), 1.0)
    # More trust alone would seem to be what the sensor's lag explains.
    assert found.fit is not None and blind.fit is not None
    assert blind.fit.noise_scale < found.fit.noise_scale == base.noise_scale
    assert blind.gain > found.gain + 100.0


@dataclass(frozen=True)
class Named:
    name: str
    value: float


@dataclass(frozen=True)
class Refitted:
    estimates: tuple[Named, ...]


@dataclass(frozen=True)
class Fitted:
    refit: Refitted


def test_what_is_told_from_its_equal_goes_on_from_where_that_ended() -> None:
    best = made_candidate("valve_offset", 900.0, 0.1)
    uneven = made_candidate("constant_torque", 895.0, 0.1, uneven=20.0)
    short, equal, less = (made_candidate("constant_torque", g, 0.1) for g in (895.0, 899.5, 850.0))
    asked = [replace(c, followed=True) for c in (short, uneven, equal, less)]
    assert [race._ended_early(c, best) for c in asked] == [True, False, False, False]
    assert not race._ended_early(replace(short, followed=False), best)
    # It keeps what is its own and takes what both have.
    ended = {"viscous": 2.0, "valve_offset.amount": 0.3}
    own = [Named("viscous", 1.0), Named("constant_torque.amount", 0.7)]
    fits = (
        SimpleNamespace(refit=SimpleNamespace(values=ended)),
        Fitted(Refitted(tuple(own))),
    )
    begun = race._from_where(*(replace(best, fit=cast(Any, fit)) for fit in fits))
    assert [e.value for e in cast(Any, begun.fit).refit.estimates] == [2.0, 0.7]
