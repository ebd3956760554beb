"""The search for what is missing: forward over the library, then backward.

Forward: the library is scored on what is left, the best hypotheses are refitted, and the one that
gains the most among those that pass every rule is added. Backward: effects that together explain
too little are taken back, and so are those that a later one made needless. What gains the most at
first may lead nowhere: then the next best begins. Each step is a function from one `Selected` to
the next, so that a search can be written down and continued.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, substeps_along
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import (
    INDIFFERENT,
    PERFECT,
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    gain_interval,
    perfect_cost,
    ranges_along,
    start_values,
)
from workbench.diagnosis.location.locate import Location
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.held_out import (
    RunErrors,
    explained,
    held_out_errors,
    judged_run,
    over_floor,
    run_errors,
    start_floors,
    told_apart,
)
from workbench.diagnosis.selection.refits import (
    closer_unseen,
    decided,
    degenerates_to,
    entry_priors,
    is_sensor,
    preferred,
    refit_candidates,
    untried,
)
from workbench.diagnosis.selection.rules import (
    AT_NOISE,
    FREE_RUN,
    HELD_OUT,
    IMPERFECT,
    LEAST_AT_FIRST,
    LEAST_EXPLAINED,
    LEAST_LEFT,
    LEAST_OF_ALL,
    LEAST_OF_REST,
    LEAST_PREDICTED,
    LEAST_SHARE,
    LEAST_SHOWN,
    LEAST_TOGETHER,
    NEAR_NOISE,
    REFIT,
    SAME,
    SHARE,
    SURPASSED,
    Limits,
    doubted_in,
    selection_penalty,
)
from workbench.diagnosis.selection.score import Score, Scores, by_name, score_library
from workbench.diagnosis.selection.selected import (
    Accepted,
    Aside,
    Round,
    Scored,
    Selected,
    Withdrawn,
)
from workbench.diagnosis.selection.shortlist import shortlist
from workbench.diagnosis.selection.simulation_error import closest_runs
from workbench.diagnosis.selection.weights import Compared
from workbench.errors import NumericalError
from workbench.model import Model
from workbench.physics.library import Hypothesis, Law, library, look_alikes

Progress = Callable[[str], None]

Shorter = tuple[ProcessNoiseFit, tuple[Prior, ...]] | None
"""A model without one of its effects, with its free parameters; None if it cannot be fitted."""

MOST_FINDINGS = 3
"""Effects that are searched for, one after the other."""

MOST_SEARCHES = 3
"""How many effects may be tried as the first one found."""

_OPENINGS = 2
"""Effects beside which another is searched for where none passes alone."""

_RIVALS, _NEWCOMERS = 4, 3
"""Rivals of an effect, and laws that score best then, among which is chosen again after the next
one was found."""

_MOST_AT_FIRST, _MOST_AGAIN = 18, 8
"""Laws that are refitted for their score, before and after the first one was found."""

_STIFF = 5
"""Laws that are refitted in the time of a stiff one."""

_BUDGET = 6000
"""Work that laws beyond the best scores may take together: each costs the square of the number of
states times that of free parameters. A plant of two states has room for all, the arm for nine."""


_TOGETHER = "only together with another effect"


@dataclass(frozen=True)
class Task:
    """What a search works on.

    Args:
        nominal: The model that the recordings were observed with.
        fitting: Fitting recordings.
        judging: Held-out recordings.
        priors: Priors of the free parameters of the nominal model.
        location: Where the refitted nominal model lacks something; None if unknown.
        entries: Effects that may be missing; the whole library if None.
        extra: Laws and hypotheses that may be missing beside the library.
        shorter: Models that were refitted without one of their effects, by identity and effect.
        refitted: Models that were refitted to free runs, by identity and whether with heavy tails.
        say: Called with a line of text before each step.
    """

    nominal: Model
    base: ProcessNoiseFit
    fitting: tuple[Observed, ...]
    judging: tuple[Observed, ...]
    priors: tuple[Prior, ...]
    location: Location | None = None
    entries: tuple[Hypothesis, ...] | None = None
    jobs: int = 2
    say: Progress = lambda text: None
    extra: tuple[Law | Hypothesis, ...] = ()
    shorter: dict[tuple[int, str], tuple[ProcessNoiseFit, Shorter]] = field(default_factory=dict)
    refitted: dict[tuple[int, bool], tuple[ProcessNoiseFit, ProcessNoiseFit]] = field(
        default_factory=dict
    )

    def tried(self, model: Model) -> list[Hypothesis]:
        """Return the effects that may be missing from a model."""
        entries = self.entries
        given = {effect.name for effect in self.nominal.effects}
        attached = {effect.name for effect in model.effects}
        if entries is None:
            longest = max(self.fitting, key=lambda r: len(r.outputs))
            entries = library(
                model,
                outputs=longest.used,
                extra=self.extra,
                duration=longest.sample_time * (len(longest.outputs) - 1),
                sample_time=longest.sample_time,
                ranges=self._ranges,
                more_of=self._more_of,
                found=attached - given,
            )
        return [e for e in entries if e.name not in attached]

    def closest(self, fit: ProcessNoiseFit, *, robust: bool = False) -> ProcessNoiseFit:
        """Return a fit as it runs closest to the recordings."""
        key = id(fit), robust
        if key not in self.refitted:
            # The fit is kept with it: its identity must not become that of another.
            found = closest_runs(fit, self.nominal, self.fitting, self.judging, robust=robust)
            self.refitted[key] = fit, found
        return self.refitted[key][1]

    def longer(self, model: Model) -> float:
        """Return how much longer a filter takes with what was found, dimensionless, 1 or more."""
        steps = [
            substeps_along(m, r) * max(len(m.states), 1) ** 2
            for m, r in (
                (self.base.model, self.fitting[0]),
                (model, self.started(self.fitting[:1], model)[0]),
            )
        ]
        return max(1.0, steps[1] / steps[0])

    @cached_property
    def _ranges(self) -> dict[str, tuple[float, float]]:
        try:
            return ranges_along(self.base, self.fitting)
        except NumericalError:
            return {}

    @cached_property
    def _more_of(self) -> set[str]:
        """Effects of the nominal model of which the refit would take more than is plausible."""
        full = [e.name for e in self.base.refit.estimates if e.on_bound and e.value > e.prior.mean]
        return {name.split(".")[0] for name in full if "." in name}

    def started(self, recordings: Sequence[Observed], model: Model) -> list[Observed]:
        """Return recordings with a start for a model with effects attached."""
        return [extended_start(r, self.nominal, model) for r in recordings]


def score(task: Task) -> Scored:
    """Score the library at the refitted nominal model, with parameters off their bounds."""
    base = task.base
    perfect = _perfect(task)
    tried = task.tried(base.model)
    task.say(f"scoring {len(tried)} effects")
    # A parameter on its bound has gone there to reproduce something.
    model = base.model.with_parameters(start_values(base.refit, task.priors))
    try:
        blocks_of_cost(replace(base, refit=replace(base.refit, model=model)), task.fitting)
    except NumericalError:
        model = base.model
    scores = score_library(model, task.fitting, task.priors, tried, noise_scale=base.noise_scale)
    task.say("running the refitted model on the held-out recordings")
    try:
        floor = over_floor(base, task.nominal, task.judging, jobs=task.jobs)
    except (NumericalError, np.linalg.LinAlgError):
        # A model that cannot be run is not near the noise.
        floor = dict.fromkeys(task.judging[0].used, math.inf)
    return Scored(scores, perfect, max(base.cost - perfect, 0.0), floor)


def _perfect(task: Task) -> float:
    for model in (task.base.model, task.nominal):
        try:
            return perfect_cost(model, task.fitting)
        except NumericalError:
            # Refitted values that stand for something else may not be fit for a simulation.
            continue
    return task.base.cost


def search(task: Task, scored: Scored, begun: Selected | None = None) -> Iterator[Selected]:
    """Add one effect after the other as long as one is accepted.

    Args:
        scored: The library at the refitted nominal model.
        begun: A search that was interrupted, to be continued.

    Yields:
        The search after each round; the last one is finished but for a term without a name.
    """
    state = begun or Selected(
        task.base, task.priors, fits=(task.base,), compared=_without_any(task)
    )
    while not state.finished:
        state = _advanced(task, scored, state)
        yield state


def _without_any(task: Task) -> tuple[Compared, ...]:
    try:
        blocks = tuple(blocks_of_cost(task.base, some) for some in (task.fitting, task.judging))
    except NumericalError:
        return ()
    return (Compared((), blocks),)


def _remembered(task: Task, state: Selected, candidates: Sequence[Candidate]) -> Selected:
    """Remember the sets of effects that were judged on all recordings.

    What failed, or does not show in free runs as it should, is none; nor is what is no more than
    the one that was taken.
    """
    taken = next((c for c in candidates if not c.refused), None)
    own = {effect.name for effect in task.nominal.effects}
    sets = tuple(
        Compared(tuple(sorted(e.name for e in c.fit.model.effects if e.name not in own)), c.blocks)
        for c in candidates
        if c.followed and c.fit and len(c.blocks) > 1 and c.rule not in (REFIT.name, FREE_RUN)
        if not (taken and degenerates_to(c, taken))
    )
    return replace(state, compared=(*state.compared, *sets))


def _to_refit(
    task: Task, scores: Scores, most: int, model: Model, *, quiet: bool
) -> tuple[tuple[Score, ...], tuple[Score, ...]]:
    """Choose what is refitted first: the best scores, and the laws of the located groups.

    The score is a derivative at size zero. It orders, but of a law whose derivative vanishes
    there, or whose effect the refitted parameters have taken over, it tells nothing.

    Args:
        model: The model beside which they are refitted.
        quiet: Whether the model without an effect runs to the noise. What its parameters took over
            is then not missing: only what scores is refitted, and that of which a score cannot
            tell.

    Returns:
        What to refit, and what is left for the case that nothing of it explains the recordings.
    """
    chosen = list(shortlist(scores, most=most))
    groups = {port.name: port.group for port in task.base.model.ports}
    alone = task.location.alone if task.location else {}
    best = max(alone.values(), default=0.0)
    located = {group for group, gain in alone.items() if gain > 0.0 and gain >= 0.5 * best}
    room = _room(task, most, model)
    rest = [s for s in scores.scores if s not in chosen]
    here = [s for s in rest if any(groups.get(port) in located for port in s.entry.ports)]
    # A law whose derivative at size zero tells nothing is tried wherever it may be.
    far = [s for s in here if s.entry.far]
    if quiet:
        return (*chosen, *far), ()
    taken = [*far, *_within([s for s in here if s not in far], room)]
    elsewhere = [s for s in rest if s not in here]
    # A small plant has room for the whole library, wherever the mismatch was located.
    later = tuple(elsewhere) if _within(rest, room) == rest else ()
    return (*chosen, *taken), later


def _room(task: Task, most: int, model: Model) -> float:
    """Return for how many laws there is room beside so many of the best scores.

    Args:
        model: The model with what was found: stiff laws in it make every refit longer.
    """
    cost = max(len(task.base.model.states), 1) ** 2 * (len(task.priors) + 1)
    return _BUDGET * most / _MOST_AT_FIRST / cost / task.longer(model)


def _within(scores: Sequence[Score], room: float) -> list[Score]:
    """Return the first scores that there is room for; a stiff law takes that of several."""
    taken = []
    for score in scores:
        needed = _STIFF if score.entry.stiff else 1
        if needed <= room:
            taken.append(score)
            room -= needed
    return taken


def _advanced(task: Task, scored: Scored, state: Selected) -> Selected:
    """Do one round, and what follows the last one."""
    state, goes_on = _round(task, scored, state)
    if goes_on and len(state.rounds) < MOST_FINDINGS:
        return state
    state = _withdrawn(task, state, scored.excess)
    if len(state.accepted) > 1:
        task.say("leaving out one effect at a time")
        state = _left_out(task, state, max(state.penalty, LEAST_OF_ALL.value * scored.excess))
    state, share = _run_as_found(task, _simplified(task, state))
    failed = (*state.failed, state.began)
    shown = any(a.shown for a in state.aside)
    if not state.accepted and state.began and len(failed) < (2 if shown else MOST_SEARCHES):
        # The next search begins with the next best of the first round.
        return replace(state, failed=failed, began="", rounds=state.rounds[:1], free=task.priors)
    if not state.accepted:
        state = _shown(task, replace(state, failed=failed if state.began else state.failed))
        state, share = _run_as_found(task, state)
    together = len(state.accepted) > 1 and share >= LEAST_SHOWN.value
    accepted = tuple(_told(a, state.extended, together=together) for a in state.accepted)
    return replace(state, accepted=accepted, finished=True)


def _run_as_found(task: Task, state: Selected) -> tuple[Selected, float]:
    """Run the improved model freely, and take back what spoils that.

    Returns:
        The search with the runs, and the share of the error that goes; NaN if nothing was found.
    """
    share = math.nan
    while state.accepted:
        task.say("running the improved model freely on the held-out recordings")
        state, share = run_freely(task, state)
        least = LEAST_EXPLAINED.value
        if not share < least:
            break
        why = (
            f"what was found takes away {100 * share:.0f} % of the error of the free run on"
            f" held-out recordings, {100 * least:.0f} % is asked for"
        )
        last = state.accepted[-1]
        without = _without(task, state, last) if len(state.accepted) > 1 else None
        if without is None:
            return all_withdrawn(task, state, why), share
        # One that spoils the run must not take those before it along.
        state = replace(
            state,
            accepted=state.accepted[:-1],
            withdrawn=(*state.withdrawn, Withdrawn(last.candidate, why)),
            extended=without[0],
            free=without[1],
        )
    return state, share


def _shown(task: Task, state: Selected) -> Selected:
    """Take up again, with the doubt, what explains too little but shows in free runs."""
    shown = [a for a in state.aside if a.shown]
    if not shown:
        return state
    best = min(shown, key=lambda a: a.extended.cost)
    doubts = (*best.candidate.doubts, f"it {best.reason}")
    return replace(
        state,
        accepted=(Accepted(replace(best.candidate, doubts=doubts), best.alike),),
        withdrawn=tuple(w for w in state.withdrawn if w.candidate.name != best.candidate.name),
        extended=best.extended,
        fits=(task.base, best.extended),
        rounds=state.rounds[:1],
    )


def run_freely(task: Task, state: Selected) -> tuple[Selected, float]:
    """Run the models along the held-out recordings.

    Returns:
        The search with the runs, and the share of the error that goes, dimensionless; NaN if a
        model could not be run.
    """
    try:
        fits = {
            label: task.closest(fit, robust=True)
            for label, fit in (("refitted", task.base), ("extended", state.extended))
        }
        runs = {
            label: {r.name: judged_run(fit, task.nominal, r) for r in task.judging}
            for label, fit in fits.items()
        }
        errors = held_out_errors(runs, task.judging)
        share = explained(errors)
        if share < LEAST_EXPLAINED.value:
            # What seems too little may be what the starts of the runs hide.
            share = explained(errors, start_floors(fits, task.nominal, task.judging))
    except (NumericalError, np.linalg.LinAlgError) as error:
        task.say(f"the improved model could not be run: {error}")
        return state, math.nan
    state = replace(state, closest=fits)
    first = task.judging[0]
    if first.diverges or not first.drifts:
        state = replace(state, runs=runs)
    return state, share


def likely(state: Selected) -> Selected:
    """Take up again what was withdrawn although it clearly gains on the held-out recordings.

    A rule on how much of the misfit an effect explains lowers the belief in it; it does not undo
    what the held-out recordings say. Of several the one that gains most there is reported, as
    likely, with the rule that speaks against it. What a sensor does is not: it colours the noise,
    and so predicts the next sample of anything.
    """
    aside = [a for a in state.aside if a.candidate.held_out[1] > 0.0]
    aside = [a for a in aside if not is_sensor(a.candidate)]
    if state.accepted or not aside:
        return state
    best = max(aside, key=lambda a: a.candidate.held_out[0])
    doubted = replace(best.candidate, doubts=(*best.candidate.doubts, best.reason))
    return replace(
        state,
        accepted=(Accepted(doubted, best.alike),),
        withdrawn=tuple(w for w in state.withdrawn if w.candidate is not best.candidate),
        extended=best.extended,
    )


def _round(task: Task, scored: Scored, state: Selected) -> tuple[Selected, bool]:
    """Do one round of a search; returns whether another may follow."""
    again = bool(state.failed) and not state.began
    number = 0 if again else len(state.rounds)
    current = state.extended
    least = _least(scored, current, number)
    if number and max(current.cost - scored.perfect, 0.0) < least:
        return state, False
    if again:
        scores, candidates = state.rounds[0]
        passing = [c for c in candidates if _passed(c) and c.entry.name not in state.failed]
        if any(a.shown for a in state.aside):
            # A sensor colours the noise: it is no better beginning than what shows in free runs.
            passing = [c for c in passing if not is_sensor(c)]
    else:
        begun = task.started(task.fitting, current.model)
        scores = scored.scores
        if number:
            tried = task.tried(current.model)
            if not tried:
                return state, False
            task.say(f"scoring {len(tried)} effects on what is left")
            scores = score_library(
                current.model, begun, state.free, tried, noise_scale=current.noise_scale
            )
        first = not number
        quiet = first and scored.near_noise(task.base, AT_NOISE.value)
        most = _MOST_AT_FIRST if first else _MOST_AGAIN
        chosen, later = _to_refit(task, scores, most, current.model, quiet=quiet)
        samples = sum(len(r.outputs) for r in task.fitting)
        penalty = selection_penalty(len(scores.scores), samples, 2)
        limits = Limits(
            penalty,
            least,
            scored.near_noise(task.base),
            perfect=current.noise_scale <= PERFECT and bool(number),
        )

        candidates = _refits(task, current, state.free, chosen, limits, thorough=first)
        if later and all(c.refused for c in candidates):
            more = _refits(task, current, state.free, later, limits, thorough=first)
            candidates = tuple(sorted((*more, *candidates), key=lambda c: -c.gain))
        scored_names = {s.entry.name for s in scores.scores}
        candidates += tuple(
            untried(entry, why)
            for entry in task.tried(current.model)
            for name, why in scores.failed
            if entry.name == name and name not in scored_names
        )
        state = _remembered(task, state, candidates)
        state = replace(state, rounds=(*state.rounds, Round(scores, candidates)), penalty=penalty)
        passing = [c for c in candidates if not c.refused]
        if not passing:
            state = _with_pair(task, state, limits)
    if passing:
        task.say(f"found {passing[0].entry.name}")
        rivals = [c for c in candidates if c.entry.name not in state.failed]
        state = _with_candidate(task, state, passing[0], Round(scores, tuple(rivals)))
    if state.extended is current:
        return state, False
    if len(state.accepted) > 1:
        state = _exchanged(task, scored, state)
    became_perfect = state.extended.noise_scale <= PERFECT < current.noise_scale
    return state, not (became_perfect and _near_noise(task, state))


def _refits(
    task: Task,
    base: ProcessNoiseFit,
    free: Sequence[Prior],
    chosen: Sequence[Score],
    limits: Limits,
    *,
    thorough: bool = False,
) -> tuple[Candidate, ...]:
    """Refit effects beside what a model has, judged on the held-out recordings.

    Args:
        thorough: Whether refits on short recordings begin from more places: where nothing was found
            yet, whose parameters would lead the way.
    """
    return refit_candidates(
        base,
        chosen,
        free,
        task.started(task.fitting, base.model),
        task.started(task.judging, base.model),
        limits=limits,
        jobs=task.jobs,
        progress=task.say,
        thorough=thorough,
    )


def _with_candidate(task: Task, state: Selected, found: Candidate, beside: Round) -> Selected:
    """Add an effect to the model, refitted to the end.

    Args:
        beside: The round in which it was found.
    """
    assert found.fit is not None
    free = (*state.free, *entry_priors(found.entry)[0])
    # What is no more than this law with more parameters may have come further.
    more = next((c.fit for c in beside.candidates if degenerates_to(c, found)), None)
    extended = _polished(found.fit, task.started(task.fitting, found.fit.model), free, more)
    alike = _alike(found, beside.candidates, beside.scores)
    return replace(
        state,
        began=state.began or found.name,
        accepted=(*state.accepted, Accepted(found, alike)),
        free=free,
        extended=extended,
        fits=(*state.fits, extended),
    )


def _with_pair(task: Task, state: Selected, limits: Limits) -> Selected:
    """Add effects of which none passes alone, but two or three together do.

    Laws may hide each other: with the wrong outflow a tank never reaches its brim, and a spring
    that hardens swings too far without the friction. What gains much alone, and is refused only
    because it does not explain enough or not everywhere, or spoils free runs, opens; the others are
    searched for beside it; all are judged as one.
    """
    current, round_ = state.extended, state.rounds[-1]
    complete = limits.near_noise or current.noise_scale <= IMPERFECT.value
    if complete or len(state.rounds) >= MOST_FINDINGS:
        return state
    openings = _openings(round_.candidates, limits, beside=bool(state.accepted))
    if not openings or not _most_is_left(task, state):
        return state
    alone = _Alone(
        current,
        blocks_of_cost(current, task.started(task.judging, current.model)),
        run_errors(task.closest(current), task.nominal, task.judging),
        limits,
    )
    found = []
    for opening in openings:
        first = _only_together(opening)
        kept = tuple(first if c is opening else c for c in round_.candidates)
        rounds = (*state.rounds[:-1], Round(round_.scores, kept))
        begun = _with_candidate(task, replace(state, rounds=rounds), first, round_)
        state, both = _completed(task, state, begun, alone)
        found += [both] if both else []
    if not found:
        return state
    best = replace(min(found, key=lambda s: s.extended.cost), compared=state.compared)
    new = best.accepted[len(state.accepted) :]
    task.say("found " + " and ".join(a.candidate.name for a in new))
    return best


class _Alone(NamedTuple):
    """The model without the effects that are searched for together, and what is asked of them.

    Args:
        blocks: Its cost on the held-out recordings by block of time, shape (n_blocks,).
        runs: Errors of its free runs on them.
        limits: What is asked of a single one.
    """

    fit: ProcessNoiseFit
    blocks: Vector
    runs: RunErrors
    limits: Limits


def _only_together(candidate: Candidate) -> Candidate:
    told = f"{_TOGETHER}: {candidate.refused}"
    return replace(candidate, refused="", rule="", doubts=(told,))


def _told(found: Accepted, fit: ProcessNoiseFit, *, together: bool) -> Accepted:
    """Doubt an effect as it is in the fit that is told.

    Args:
        together: Whether all that was found takes most of the error of free runs: what one of them
            lacks without the others is then no doubt.
    """
    candidate = doubted_in(found.candidate, fit)
    if together and any(d.startswith(_TOGETHER) for d in candidate.doubts):
        left = tuple(d for d in candidate.doubts if not d.startswith(_TOGETHER))
        candidate = replace(candidate, doubts=left)
    return found._replace(candidate=candidate)


def _completed(
    task: Task, state: Selected, begun: Selected, alone: _Alone
) -> tuple[Selected, Selected | None]:
    """Search for what completes effects that do not pass yet; all are judged as one.

    Args:
        state: The search, which remembers what was compared.
        begun: The search with these effects added.

    Returns:
        The search, and the one with all that completes them; None if nothing does.
    """
    model = begun.extended.model
    task.say(f"searching for what {begun.accepted[-1].candidate.name} hides")
    scores = score_library(
        model,
        task.started(task.fitting, model),
        begun.free,
        task.tried(model),
        noise_scale=begun.extended.noise_scale,
    )
    chosen, _ = _to_refit(task, scores, _MOST_AGAIN, model, quiet=False)
    try:
        refitted = _refits(task, begun.extended, begun.free, chosen, alone.limits)
    except NumericalError:
        # What begins cannot be followed along the held-out recordings.
        return state, None
    state = _remembered(task, state, refitted)
    together = tuple(
        replace(
            c,
            gain=alone.fit.cost - c.fit.cost,
            held_out=gain_interval(alone.blocks, c.blocks[1]),
            refused="",
            rule="",
            doubts=(),
        )
        for c in refitted
        if c.followed and c.fit and len(c.blocks) > 1 and c.gain >= alone.limits.penalty
    )
    count = len(begun.accepted) - len(state.accepted) + 1
    limits = replace(alone.limits, penalty=count * alone.limits.penalty)
    judged = decided(together, alone.runs, limits)
    begun = replace(begun, rounds=(*begun.rounds, Round(scores, refitted)))
    beside = Round(scores, judged)
    found = next((c for c in judged if not c.refused), None)
    best = _with_candidate(task, begun, found, beside) if found and found.fit else None
    # What is far likelier but spoils the runs may hide a third.
    least = alone.limits.penalty + (found.gain if found else 0.0)
    hiding = [c for c in judged if c.rule == FREE_RUN and c.gain > least]
    hiding = [c for c in hiding if not found or c.held_out[0] > found.held_out[0]]
    if hiding and len(begun.accepted) + 1 < MOST_FINDINGS:
        likeliest = _only_together(max(hiding, key=lambda c: c.gain))
        further = _with_candidate(task, begun, likeliest, beside)
        state, more = _completed(task, state, further, alone)
        if more and (best is None or more.extended.cost < best.extended.cost):
            best = more
    return state, best


def _most_is_left(task: Task, state: Selected) -> bool:
    """Whether free runs on held-out recordings keep most of their error with what was found."""
    return not state.accepted or run_freely(task, state)[1] <= 1.0 - LEAST_LEFT.value


def _openings(
    candidates: Sequence[Candidate], limits: Limits, *, beside: bool = False
) -> list[Candidate]:
    """Return what may open a pair: what gains much, each with another explanation.

    What a sensor does colours the noise, and so predicts the next sample of anything: it opens only
    beside what was found, and if it explains enough of the rest.
    """
    found: list[Candidate] = []
    for c in candidates:
        worthy = c.followed and min(c.gain, c.held_out[0]) >= limits.penalty
        if not worthy or c.rule not in (SHARE.name, HELD_OUT.name, FREE_RUN):
            continue
        if is_sensor(c) and not (beside and c.gain >= limits.least_gain):
            continue
        if len(found) < _OPENINGS and all(told_apart(c.blocks, o.blocks) for o in found):
            found.append(c)
    return found


def _near_noise(task: Task, state: Selected) -> bool:
    """Whether the extended model runs nearly to the noise along the held-out recordings."""
    try:
        floor = over_floor(state.extended, task.nominal, task.judging, jobs=task.jobs)
    except (NumericalError, np.linalg.LinAlgError):
        return False
    return max(floor.values()) <= NEAR_NOISE.value


def _least(scored: Scored, current: ProcessNoiseFit, number: int) -> float:
    """Return the log likelihood that an effect must gain: a share of what is left out.

    Args:
        current: The model without it, fitted.
        number: How many effects were found before it.
    """
    if not number:
        return LEAST_AT_FIRST.value * scored.excess
    rest = max(current.cost - scored.perfect, 0.0)
    return max(LEAST_OF_REST.value * rest, LEAST_OF_ALL.value * scored.excess)


def _passed(candidate: Candidate) -> bool:
    """Whether an effect passed every rule, even if another explained more."""
    return candidate.followed and candidate.fit is not None and candidate.refused in ("", SURPASSED)


def _polished(
    fit: ProcessNoiseFit,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    beside: ProcessNoiseFit | None = None,
) -> ProcessNoiseFit:
    """Refit once more, to the end: comparing hypotheses needs less.

    Args:
        beside: A fit with another effect instead of the last one, from whose values of all others
            the refit begins too.
    """
    own = {e.name: e.value for e in fit.refit.estimates}
    starts = [(own, False)]
    if beside is not None:
        shared = {e.name: e.value for e in beside.refit.estimates if e.name in own}
        starts.append((own | shared, True))
    best = fit
    for start, follow in starts:
        try:
            final = fit_with_process_noise(
                fit.model, recordings, priors, start=start, noise_scale=fit.noise_scale,
                follow=follow,
            )  # fmt: skip
        except Exception:  # noqa: BLE001
            # The fit that was compared stands, whatever a law does when it is refined.
            continue
        if final.cost <= best.cost + (INDIFFERENT if final.noise_scale < best.noise_scale else 0.0):
            best = replace(final, passed=fit.passed)
    return best


def _withdrawn(task: Task, state: Selected, excess: float) -> Selected:
    """Take back the last effects while all together explain too little."""
    while state.accepted:
        count = len(state.accepted)
        # What is likely only is reported with the doubt, and not asked for more.
        doubted = bool(state.accepted[-1].candidate.doubts)
        least = (LEAST_SHARE if count == 1 or doubted else LEAST_TOGETHER).value
        gain = state.fits[0].cost - state.fits[count].cost
        if gain >= least * excess:
            break
        why = (
            f"explains too little: {100 * gain / excess:.0f} % of what is missing"
            + (" together with those before" if count > 1 else "")
            + f", {100 * least:.0f} % is asked for"
        )
        if count == 1 and gain >= LEAST_PREDICTED.value * excess:
            shown = _shown_in_runs(task, state.accepted[0].candidate)
            state = _set_aside(state, why, shown=shown)
        state = replace(
            state,
            accepted=state.accepted[:-1],
            withdrawn=(*state.withdrawn, Withdrawn(state.accepted[-1].candidate, why)),
            extended=state.fits[count - 1],
            fits=state.fits[:count],
        )
    return state


def _shown_in_runs(task: Task, candidate: Candidate) -> bool:
    """Whether an effect alone takes most of the error of free runs on held-out recordings."""
    if candidate.run is None:
        return False
    without = run_errors(task.closest(task.base), task.nominal, task.judging)
    return candidate.run.closer_than(without, by=1.0 - math.sqrt(1.0 - LEAST_SHOWN.value))


def all_withdrawn(task: Task, state: Selected, why: str) -> Selected:
    """Take back everything that was found: the improved model does not run freely any better."""
    state = _set_aside(state, why)
    return replace(
        state,
        withdrawn=(*state.withdrawn, *(Withdrawn(c, why) for c, _ in state.accepted)),
        accepted=(),
        extended=task.base,
        fits=(task.base,),
        closest={k: v for k, v in state.closest.items() if k == "refitted"},
        runs={k: v for k, v in state.runs.items() if k == "refitted"},
    )


def _set_aside(state: Selected, why: str, *, shown: bool = False) -> Selected:
    """Remember the first effect that was found, with the model that has no other.

    Args:
        shown: Whether it takes most of the error of free runs.
    """
    candidate, alike = state.accepted[0]
    extended = state.fits[1] if len(state.fits) > 1 else state.extended
    return replace(state, aside=(*state.aside, Aside(candidate, alike, extended, why, shown)))


def _exchanged(task: Task, scored: Scored, state: Selected) -> Selected:
    """Choose each effect again, beside all others that were found.

    Two effects that hide each other are found with the wrong one first, or as a class that only
    the second resolves.
    """
    changed = False
    for number, found in enumerate(state.accepted):
        if found is state.accepted[-1] and not changed:
            # It has been chosen beside all others just now.
            break
        without = _without(task, state, found)
        if without is None:
            continue
        base, free = without
        task.say(f"choosing again beside what was found since {found.candidate.name}")
        begun = task.started(task.fitting, base.model)
        scores = score_library(
            base.model, begun, free, task.tried(base.model), noise_scale=base.noise_scale
        )
        known = by_name(scores)
        # One that acts at one of several places is found again by way of all of them.
        known |= {a.name: s for s in scores.scores for a in s.entry.alone if a.name not in known}
        followed = [c.name for c in state.rounds[number].candidates if c.followed and c.fit]
        rivals = [name for name in followed if name != found.candidate.name][:_RIVALS]
        tried = [known[name] for name in (found.candidate.name, *rivals) if name in known]
        if found is not state.accepted[-1]:
            tried += shortlist(scores, most=_NEWCOMERS)
            alike = look_alikes(found.candidate.entry, [s.entry for s in scores.scores])
            tried += _within([known[e.name] for e in alike], _room(task, _NEWCOMERS, base.model))
        asked = Limits(state.penalty, _least(scored, base, number), scored.near_noise(task.base))
        chosen = tuple({s.entry.name: s for s in tried}.values())
        try:
            candidates = _refits(task, base, free, chosen, asked)
        except NumericalError:
            # Without the effect the recordings cannot be followed: it is needed as it is.
            continue
        state = _remembered(task, state, candidates)
        best = next((c for c in candidates if not c.refused), None)
        if best is None or best.fit is None:
            continue
        if best.name != found.candidate.name:
            own = entry_priors(best.entry)[0]
            free = (*free, *own)
            started = task.started(task.fitting, best.fit.model)
            extended = _polished(best.fit, started, free, beside=state.extended)
            if extended.cost >= state.extended.cost:
                continue
            state, changed = replace(state, free=free, extended=extended), True
        renewed = Accepted(best, _alike(best, candidates, scores))
        accepted = tuple(renewed if a is found else a for a in state.accepted)
        state = replace(state, accepted=accepted)
    return _with_fits(task, state) if changed else state


def _with_fits(task: Task, state: Selected) -> Selected:
    """Refit the models with the first of what was found, after some of it was exchanged."""
    fits, shorter = [state.extended], state
    for found in reversed(state.accepted[1:]):
        without = _without(task, shorter, found)
        if without is None:
            return replace(state, fits=(state.fits[0], *[state.extended] * len(state.accepted)))
        shorter = replace(shorter, extended=without[0], free=without[1])
        fits.append(without[0])
    return replace(state, fits=(state.fits[0], *reversed(fits)))


def _left_out(task: Task, state: Selected, least: float) -> Selected:
    """Take out effects that the later ones made needless."""
    for found in state.accepted[:-1]:
        without = _without(task, state, found)
        if without is not None and without[0].cost - state.extended.cost < least:
            needless = Withdrawn(found.candidate, "a later one makes it needless")
            state = replace(
                state,
                accepted=tuple(a for a in state.accepted if a is not found),
                withdrawn=(*state.withdrawn, needless),
                extended=without[0],
            )
    return state


def _simplified(task: Task, state: Selected) -> Selected:
    """Take a simpler law instead of an effect whose shape ended where it is that law."""
    for found in state.accepted:
        entry, full = found.candidate.entry, state.extended
        name, size = entry.effect.name, f"{entry.effect.name}.{entry.size_parameter}"
        own = {e.name: e for e in full.refit.estimates if e.name.startswith(f"{name}.")}
        ended = any(e.on_bound for e in own.values() if e.name != size)
        without = _without(task, state, found) if ended and size in own else None
        if without is None:
            continue
        base, free = without
        values = {e.name: e.value for e in full.refit.estimates if e.name not in own}
        alike = look_alikes(entry, [e for e in task.tried(base.model) if e.ports == entry.ports])
        for simpler in alike:
            other = _begun(simpler, entry, own[size].value)
            priors = entry_priors(other)[0]
            if len(priors) >= len(own) or other.replaces or other.unit != entry.unit:
                continue
            model = base.model.with_effect(other.at_size(0.0))
            begin = values | {f"{other.name}.{other.size_parameter}": own[size].value}
            try:
                fit = fit_with_process_noise(
                    model, task.started(task.fitting, model), (*free, *priors), start=begin,
                    noise_scale=full.noise_scale,
                )  # fmt: skip
            except Exception:  # noqa: BLE001
                # What cannot be fitted is no simpler law.
                continue
            if fit.cost < state.extended.cost + SAME.value:
                state = _renamed(state, found, other, replace(fit, passed=None), (*free, *priors))
                break
    return state


def _begun(simpler: Hypothesis, entry: Hypothesis, value: float) -> Hypothesis:
    """Return a law with what was tuned of another one, and bounds as wide as its size asks."""
    tuned = {q.name: q.value for q in entry.effect.parameters if not q.fitted}
    own = []
    for q in simpler.effect.parameters:
        if q.name == simpler.size_parameter:
            reach = 2.0 * abs(value)
            lower = min(q.lower, -reach) if q.lower < 0.0 else q.lower
            own.append(replace(q, lower=lower, upper=max(q.upper, reach)))
        else:
            own.append(replace(q, value=tuned.get(q.name, q.value)))
    return replace(simpler, effect=replace(simpler.effect, parameters=tuple(own)))


def _renamed(
    state: Selected,
    found: Accepted,
    other: Hypothesis,
    fit: ProcessNoiseFit,
    free: tuple[Prior, ...],
) -> Selected:
    old = found.candidate.entry.name
    alike = tuple(n for n in found.alike if n not in (old, other.name))
    renewed = Accepted(replace(found.candidate, entry=other, fit=fit), (other.name, *alike))
    return replace(
        state,
        accepted=tuple(renewed if a is found else a for a in state.accepted),
        free=free,
        extended=fit,
        fits=(*state.fits[:-1], fit),
        compared=tuple(
            c._replace(effects=tuple(sorted(other.name if n == old else n for n in c.effects)))
            for c in state.compared
        ),
    )


def _without(task: Task, state: Selected, found: Accepted) -> Shorter:
    """Refit the extended model without one effect; None if it cannot be fitted without it."""
    name, full = found.candidate.entry.effect.name, state.extended
    key = id(full), name
    if key not in task.shorter:
        # The model is kept with it: its identity must not become that of another.
        task.shorter[key] = full, _refitted_without(task, full, name, state.free)
    return task.shorter[key][1]


def _refitted_without(
    task: Task, full: ProcessNoiseFit, name: str, known: Sequence[Prior]
) -> Shorter:
    begun = full.passed or full
    model = begun.model.without(name)
    values = {e.name: e.value for e in begun.refit.estimates if not e.name.startswith(f"{name}.")}
    free = tuple(p for p in known if p.name in values)
    try:
        fit = fit_with_process_noise(
            model,
            task.started(task.fitting, model),
            free,
            start=values,
            noise_scale=begun.noise_scale,
        )
    except Exception:  # noqa: BLE001
        # A model that cannot be fitted without the effect needs it.
        return None
    return fit, free


def _alike(best: Candidate, candidates: Sequence[Candidate], scores: Scores) -> tuple[str, ...]:
    """Name the accepted effect, and those that explain the recordings as well or always do.

    Another one does if it passed every rule and the recordings, fitted and held out, prefer the
    accepted one by chance only; or if nothing but a few units of log likelihood lie between them.
    """
    same = []
    for c in candidates:
        if c.name == best.name or not c.followed or c.fit is None or c.gain <= 0:
            continue
        if degenerates_to(c, best):
            continue
        apart = not c.blocks or told_apart(best.blocks, c.blocks) or closer_unseen(best, c)
        if (_passed(c) and not apart) or (
            abs(best.gain - c.gain) < SAME.value
            and not (preferred(best, c) or closer_unseen(best, c))
        ):
            same.append(c.entry.name)
    unseen = {s.entry.name for s in scores.scores if not s.testable}
    known = {s.entry.name for s in scores.scores}
    equal = [n for n in best.entry.same_as if n in known and n not in same]
    return (best.entry.name, *[n for n in same if n not in unseen], *equal)
