"""Effects of which none passes alone, but two or three together do.

What is refused alone, for it spoils free runs or explains too little, opens a pair: what completes
it is searched for beside it, and all are judged as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from workbench.arrays import Vector
from workbench.diagnosis.estimation.process_noise import (
    PERFECT,
    ProcessNoiseFit,
    blocks_of_cost,
    gain_interval,
)
from workbench.diagnosis.selection import rules
from workbench.diagnosis.selection.additions import remembered, scored_beside, with_candidate
from workbench.diagnosis.selection.candidate import Candidate, is_sensor
from workbench.diagnosis.selection.decision import decided
from workbench.diagnosis.selection.held_out import RunErrors, run_errors, told_apart
from workbench.diagnosis.selection.race import refit_candidates
from workbench.diagnosis.selection.selected import Accepted, Round, Selected
from workbench.diagnosis.selection.shortlist import MOST_AGAIN, to_refit
from workbench.diagnosis.selection.task import MOST_FINDINGS, Task
from workbench.diagnosis.selection.withdrawal import run_freely
from workbench.errors import NumericalError

_OPENINGS = 2
"""Effects beside which another is searched for where none passes alone."""

_TOGETHER = "only together with another effect"


def with_pair(task: Task, state: Selected, limits: rules.Limits, left: float = 0.0) -> Selected:
    """Add effects of which none passes alone, but two or three together do.

    Laws may hide each other: with the wrong outflow a tank never reaches its brim, and a spring
    that hardens swings too far without the friction. What gains much alone, and is refused only
    because it does not explain enough or not everywhere, or spoils free runs, opens; the others are
    searched for beside it; all are judged as one.

    Args:
        left: Share of the excess that is left beside what was found, dimensionless.
    """
    current, round_ = state.extended, state.rounds[-1]
    complete = limits.near_noise or current.noise_scale <= rules.IMPERFECT
    if complete or len(state.rounds) >= MOST_FINDINGS:
        return state
    openings = _openings(round_.candidates, limits, beside=bool(state.accepted))
    if not openings:
        return state
    told = bool(state.accepted) and left < rules.LEAST_SHARE
    if told and not run_freely(task, state)[1] <= 1.0 - rules.LEAST_LEFT:
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
        begun = with_candidate(task, replace(state, rounds=rounds), first, round_)
        state, both = _completed(task, state, begun, alone)
        found += [both] if both else []
        if both and both.extended.noise_scale <= PERFECT < current.noise_scale:
            # Beside what leaves nothing out nobody waits for another way there.
            break
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
    limits: rules.Limits


def _only_together(candidate: Candidate) -> Candidate:
    told = f"{_TOGETHER}: {candidate.refused}"
    return replace(candidate, refused="", rule="", doubts=(told,))


def as_told(found: Accepted, fit: ProcessNoiseFit, *, together: bool) -> Accepted:
    """Doubt an effect as it is in the fit that is told.

    Args:
        together: Whether all that was found takes most of the error of free runs: what one of them
            lacks without the others is then no doubt.
    """
    candidate = rules.doubted_in(found.candidate, fit)
    if together:
        alone = (_TOGETHER, rules.TOO_LITTLE)
        left = tuple(d for d in candidate.doubts if not d.startswith(alone))
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
    task.say(f"searching for what {begun.accepted[-1].candidate.name} hides")
    scores = scored_beside(task, begun.extended, begun.free)
    chosen, _ = to_refit(task, scores, MOST_AGAIN, begun.extended.model, quiet=False)
    try:
        refitted = refit_candidates(task, begun.extended, begun.free, chosen, alone.limits)
    except NumericalError:
        # What begins cannot be followed along the held-out recordings.
        return state, None
    state = remembered(task, state, refitted)
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
    best = with_candidate(task, begun, found, beside) if found and found.fit else None
    # What is far likelier but spoils the runs may hide a third.
    least = alone.limits.penalty + (found.gain if found else 0.0)
    hiding = [c for c in judged if c.rule == rules.FREE_RUN and c.gain > least]
    hiding = [c for c in hiding if not found or c.held_out[0] > found.held_out[0]]
    if hiding and len(begun.accepted) + 1 < MOST_FINDINGS:
        likeliest = _only_together(max(hiding, key=lambda c: c.gain))
        further = with_candidate(task, begun, likeliest, beside)
        state, more = _completed(task, state, further, alone)
        if more and (best is None or more.extended.cost < best.extended.cost):
            best = more
    return state, best


def _openings(
    candidates: Sequence[Candidate], limits: rules.Limits, *, beside: bool = False
) -> list[Candidate]:
    """Return what may open a pair: what gains much, each with another explanation.

    What a sensor does colours the noise, and so predicts the next sample of anything: it opens only
    beside what was found, and if it explains enough of the rest.
    """
    found: list[Candidate] = []
    for c in candidates:
        worthy = c.followed and min(c.gain, c.held_out[0]) >= limits.penalty
        if not worthy or c.rule not in (rules.SHARE.name, rules.HELD_OUT.name, rules.FREE_RUN):
            continue
        if is_sensor(c) and not (beside and c.gain >= limits.least_gain):
            continue
        if len(found) < _OPENINGS and all(told_apart(c.blocks, o.blocks) for o in found):
            found.append(c)
    return found
