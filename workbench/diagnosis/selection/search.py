"""The search for what is missing: forward over the library, then backward.

Forward: the library is scored on what is left, the best hypotheses are refitted, and the one that
gains the most among those that pass every rule is added. Backward: effects that together explain
too little are taken back, and so are those that a later one made needless. What gains the most at
first may lead nowhere: then the next best begins. Each step is a function from one `Selected` to
the next, so that a search can be written down and continued.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from workbench.diagnosis.estimation.priors import entry_priors
from workbench.diagnosis.estimation.process_noise import (
    PERFECT,
    ProcessNoiseFit,
    blocks_as_trusted,
    perfect_cost,
)
from workbench.diagnosis.selection import rules
from workbench.diagnosis.selection.additions import (
    explain_as_well,
    passed_all,
    polished,
    remembered,
    retimed,
    scored_beside,
    with_candidate,
)
from workbench.diagnosis.selection.candidate import is_sensor, leaves_nothing
from workbench.diagnosis.selection.decision import degenerates_to
from workbench.diagnosis.selection.first_refit import untried
from workbench.diagnosis.selection.held_out import over_floor
from workbench.diagnosis.selection.pairs import as_told, with_pair
from workbench.diagnosis.selection.race import refit_candidates
from workbench.diagnosis.selection.score import MOST_TOGETHER, by_name, score_library
from workbench.diagnosis.selection.selected import Accepted, Round, Scored, Selected
from workbench.diagnosis.selection.shortlist import (
    LEAST_SCORE,
    MOST_AGAIN,
    MOST_AT_FIRST,
    room_for,
    shortlist,
    to_refit,
    within,
)
from workbench.diagnosis.selection.simplification import simplified
from workbench.diagnosis.selection.task import MOST_FINDINGS, Task
from workbench.diagnosis.selection.weights import Compared
from workbench.diagnosis.selection.withdrawal import (
    left_out,
    run_as_found,
    taken_up_again,
    too_little_withdrawn,
)
from workbench.errors import NumericalError
from workbench.physics.library import look_alikes

MOST_SEARCHES = 3
"""How many effects may be tried as the first one found."""

_RIVALS, _NEWCOMERS = 4, 3
"""Rivals of an effect, and laws that score best then, among which is chosen again after the next
one was found."""


def score(task: Task) -> Scored:
    """Score the library at the refitted nominal model, with parameters off their bounds."""
    base = task.base
    perfect = perfect_cost(base.model, task.fitting)
    tried = task.tried(base.model)
    task.say(f"scoring {len(tried)} effects")
    scores = score_library(
        task.off_bounds, task.fitting, task.priors, tried, noise_scale=base.noise_scale
    )
    held = {e.name for e in base.refit.estimates if e.on_bound}
    if held:
        # What a parameter reproduces off its bound it does not beyond it.
        free = [p for p in task.priors if p.name not in held]
        hidden = [s.entry for s in scores.scores if not s.testable]
        shown = [s.entry for s in scores.scores if s.testable and s.gain > LEAST_SCORE]
        some = [*hidden, *shown[: max(0, MOST_TOGETHER - len(hidden))]]
        at_bounds = score_library(
            base.model, task.fitting, free, some, noise_scale=base.noise_scale
        )
        scores = scores.beside(at_bounds)
    task.say("running the refitted model on the held-out recordings")
    try:
        floor = over_floor(base, task.nominal, task.judging, jobs=task.jobs)
    except (NumericalError, np.linalg.LinAlgError):
        # A model that cannot be run is not near the noise.
        floor = dict.fromkeys(task.judging[0].used, math.inf)
    return Scored(scores, perfect, max(base.cost - perfect, 0.0), floor)


def search(task: Task, scored: Scored, begun: Selected | None = None) -> Iterator[Selected]:
    """Add one effect after the other as long as one is accepted.

    Args:
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
        blocks = tuple(blocks_as_trusted(task.base, x) for x in (task.fitting, task.judging))
    except NumericalError:
        return ()
    return (Compared((), blocks),)


def _advanced(task: Task, scored: Scored, state: Selected) -> Selected:
    """Do one round, and what follows the last one."""
    state, goes_on = _round(task, scored, state)
    if goes_on and len(state.rounds) < MOST_FINDINGS:
        return state
    state = too_little_withdrawn(task, state, scored.excess)
    if len(state.accepted) > 1:
        task.say("leaving out one effect at a time")
        state = left_out(task, state, max(state.penalty, rules.LEAST_OF_ALL * scored.excess))
    state, share = run_as_found(task, simplified(task, retimed(task, state)))
    failed = (*state.failed, state.began)
    shown = any(a.shown for a in state.aside)
    again = not state.accepted and state.began and len(failed) < (2 if shown else MOST_SEARCHES)
    if again and task.one_place is None:
        # The next search begins with the next best of the first round.
        return replace(state, failed=failed, began="", rounds=state.rounds[:1], free=task.priors)
    if not state.accepted:
        state = taken_up_again(task, replace(state, failed=failed if state.began else state.failed))
        state, share = run_as_found(task, state)
    return replace(as_it_is_told(state, share), finished=True)


def as_it_is_told(state: Selected, share: float) -> Selected:
    """Doubt effects as they are in the model that runs closest, whose values are told.

    Args:
        share: Share of the error of free runs that goes with all of them, dimensionless.
    """
    together = len(state.accepted) > 1 and share >= rules.LEAST_SHOWN
    fit = state.closest.get("extended", state.extended) if math.isfinite(share) else state.extended
    return replace(
        state, accepted=tuple(as_told(a, fit, together=together) for a in state.accepted)
    )


def _round(task: Task, scored: Scored, state: Selected) -> tuple[Selected, bool]:
    """Do one round of a search; returns whether another may follow."""
    again = bool(state.failed) and not state.began
    number = 0 if again else len(state.rounds)
    current = state.extended
    least = _least(scored, current, number)
    if number and _left(task, scored, state, least) < least:
        return state, False
    if again:
        scores, candidates = state.rounds[0]
        # What recordings cannot tell from a beginning that led nowhere leaves the same rest.
        began = [c for c in candidates if c.entry.name in state.failed]
        led = {name for c in began for name in explain_as_well(c, candidates, scores)}
        led |= {c.entry.name for c in candidates if any(degenerates_to(c, b) for b in began)}
        passing = [c for c in candidates if passed_all(c) and c.entry.name not in led]
        if any(a.shown for a in state.aside):
            # A sensor colours the noise: it is no better beginning than what shows in free runs.
            passing = [c for c in passing if not is_sensor(c)]
    else:
        scores = scored.scores
        if number:
            tried = task.tried(current.model)
            if not tried:
                return state, False
            task.say(f"scoring {len(tried)} effects on what is left")
            scores = scored_beside(task, current, state.free, tried)
        first = not number
        # Nothing can gain what is not left out, whatever chance makes of the held-out runs.
        within = rules.OFF_NOISE if scored.excess < rules.LEAST_GAIN else rules.AT_NOISE
        quiet = first and scored.near_noise(task.base, within)
        most = MOST_AT_FIRST if first else MOST_AGAIN
        chosen, later = to_refit(task, scores, most, current.model, quiet=quiet)
        samples = sum(len(r.outputs) for r in task.fitting)
        penalty = rules.selection_penalty(len(scores.scores), samples, 2)
        limits = rules.Limits(
            penalty,
            least,
            rules.LEAST_TOGETHER * scored.excess * first,
            scored.near_noise(task.base),
            perfect=current.noise_scale <= PERFECT and bool(number),
        )

        refits = partial(
            refit_candidates, task, current, state.free,
            limits=limits, thorough=first, alike=scores.look_alikes,
        )  # fmt: skip
        evident = [s for s in chosen if s.entry.evident]
        candidates = refits(evident) if evident else ()
        if not any(leaves_nothing(current, c) and not c.refused for c in candidates):
            candidates = refits(chosen)
        if later and all(c.refused for c in candidates):
            more = refits(later)
            candidates = tuple(sorted((*more, *candidates), key=lambda c: -c.gain))
        scored_names = {s.entry.name for s in scores.scores}
        candidates += tuple(
            untried(entry, why)
            for entry in task.tried(current.model)
            for name, why in scores.failed
            if entry.name == name and name not in scored_names
        )
        state = remembered(task, state, candidates)
        state = replace(state, rounds=(*state.rounds, Round(scores, candidates)), penalty=penalty)
        passing = [c for c in candidates if not c.refused]
        if not passing:
            left = (current.cost - scored.perfect) / max(scored.excess, 1.0)
            state = with_pair(task, state, limits, left)
    if passing:
        task.say(f"found {passing[0].entry.name}")
        rivals = [c for c in candidates if c.entry.name not in state.failed]
        state = with_candidate(task, state, passing[0], Round(scores, tuple(rivals)))
    if state.extended is current:
        return state, False
    if len(state.accepted) > 1:
        state = _exchanged(task, scored, state)
    return state, goes_on(task, scored, current, state)


def goes_on(task: Task, scored: Scored, before: ProcessNoiseFit, state: Selected) -> bool:
    """Whether another effect is searched for after one was found.

    As much as a single effect has to explain may be one, however near the noise the runs are.

    Args:
        before: The model without what was found last, fitted.
    """
    became_perfect = state.extended.noise_scale <= PERFECT < before.noise_scale
    left = state.extended.cost - scored.perfect
    done = became_perfect and left < rules.LEAST_SHARE * scored.excess
    return not (done and _near_noise(task, state))


def _near_noise(task: Task, state: Selected) -> bool:
    """Whether the extended model runs nearly to the noise along the held-out recordings."""
    try:
        floor = over_floor(state.extended, task.nominal, task.judging, jobs=task.jobs)
    except (NumericalError, np.linalg.LinAlgError):
        return False
    return max(floor.values()) <= rules.NEAR_NOISE


def _left(task: Task, scored: Scored, state: Selected, least: float) -> float:
    """Return the log likelihood that what is still left out may be worth, if it may be the least.

    Where sensors are less noisy than they are said to be, a perfect model is likelier than is
    expected of it, by as much as prediction errors are smaller; noise of the process hides that.
    """
    fit = state.extended
    left = fit.cost - scored.perfect
    if left >= least or _near_noise(task, state):
        return left
    samples = {
        name: sum(int(np.isfinite(r.outputs[:, k]).sum()) for r in task.fitting)
        for k, name in enumerate(task.fitting[0].used)
    }
    return left + sum(
        0.5 * n * max(1.0 - fit.refit.whiteness[name], 0.0) for name, n in samples.items()
    )


def _least(scored: Scored, current: ProcessNoiseFit, number: int) -> float:
    """Return the log likelihood that an effect must gain: a share of what is left out.

    Args:
        current: The model without it, fitted.
        number: How many effects were found before it.
    """
    if not number:
        return rules.LEAST_AT_FIRST * scored.excess
    rest = max(current.cost - scored.perfect, 0.0)
    return max(rules.LEAST_OF_REST * rest, rules.LEAST_OF_ALL * scored.excess)


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
        without = task.without(state, found)
        if without is None:
            continue
        base, free = without
        if base.cost - state.extended.cost < rules.SAME:
            # The others leave nothing to it: it goes, and nothing comes in its place.
            continue
        task.say(f"choosing again beside what was found since {found.candidate.name}")
        scores = scored_beside(task, base, free)
        known = by_name(scores)
        # One that acts at one of several places is found again by way of all of them.
        known |= {a.name: s for s in scores.scores for a in s.entry.alone if a.name not in known}
        followed = [c for c in state.rounds[number].candidates if c.followed and c.fit]
        rivals = [c for c in followed if c.name != found.candidate.name][:_RIVALS]
        # They go on from where they were, and it from where it is.
        begun = {c.name: c for c in (replace(found.candidate, fit=state.extended), *rivals)}
        tried = [known[name] for name in begun if name in known]
        if found is not state.accepted[-1]:
            tried += shortlist(scores, most=_NEWCOMERS)
            alike = look_alikes(found.candidate.entry, [s.entry for s in scores.scores])
            tried += within([known[e.name] for e in alike], room_for(task, _NEWCOMERS, base.model))
        near = scored.near_noise(task.base)
        asked = rules.Limits(state.penalty, _least(scored, base, number), near_noise=near)
        chosen = tuple({s.entry.name: s for s in tried}.values())
        try:
            candidates = refit_candidates(
                task, base, free, chosen, asked, begun=begun, alike=scores.look_alikes
            )
        except NumericalError:
            # Without the effect the recordings cannot be followed: it is needed as it is.
            continue
        state = remembered(task, state, candidates)
        best = next((c for c in candidates if not c.refused), None)
        if best is None or best.fit is None:
            continue
        if best.name != found.candidate.name:
            own = entry_priors(best.entry)
            free = (*free, *own)
            started = task.started(task.fitting, best.fit.model)
            extended = polished(best.fit, started, free, beside=state.extended)
            # Stops that meet in the middle are a spring: it takes more than their parameters.
            more = best.own_parameters > found.candidate.own_parameters
            if extended.cost >= state.extended.cost - rules.SAME * more:
                continue
            state, changed = replace(state, free=free, extended=extended), True
        renewed = Accepted(best, explain_as_well(best, candidates, scores))
        accepted = tuple(renewed if a is found else a for a in state.accepted)
        state = replace(state, accepted=accepted)
    return _with_fits(task, state) if changed else state


def _with_fits(task: Task, state: Selected) -> Selected:
    """Refit the models with the first of what was found, after some of it was exchanged."""
    fits, shorter = [state.extended], state
    for found in reversed(state.accepted[1:]):
        without = task.without(shorter, found)
        if without is None:
            return replace(state, fits=(state.fits[0], *[state.extended] * len(state.accepted)))
        shorter = replace(shorter, extended=without[0], free=without[1])
        fits.append(without[0])
    return replace(state, fits=(state.fits[0], *reversed(fits)))
