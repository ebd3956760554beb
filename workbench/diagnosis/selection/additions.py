"""Refitting effects beside what was found, and adding one to the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import (
    Prior,
    default_priors,
    entry_priors,
    is_guess,
)
from workbench.diagnosis.estimation.process_noise import (
    INDIFFERENT,
    ProcessNoiseFit,
    blocks_of_cost,
    fit_with_process_noise,
)
from workbench.diagnosis.selection import rules
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.decision import closer_unseen, degenerates_to, preferred
from workbench.diagnosis.selection.held_out import held_out_gain, told_apart
from workbench.diagnosis.selection.moments import changed_values, is_event, with_own_starts
from workbench.diagnosis.selection.score import Scores, score_library
from workbench.diagnosis.selection.selected import Accepted, Round, Selected
from workbench.diagnosis.selection.task import Task
from workbench.diagnosis.selection.weights import Compared
from workbench.errors import NumericalError
from workbench.physics.library import Hypothesis

_PASSES = 4
"""Further refits from where one ended that did not converge."""


def scored_beside(
    task: Task,
    fit: ProcessNoiseFit,
    free: Sequence[Prior],
    tried: Sequence[Hypothesis] | None = None,
) -> Scores:
    """Score what may be missing from a model that has more than the nominal one.

    Args:
        free: Priors of its parameters that are refitted.
        tried: What may be missing, if that is known.
    """
    tried = task.tried(fit.model) if tried is None else tried
    seen = task.started(task.fitting, fit.model)
    return score_library(fit.model, seen, free, tried, noise_scale=fit.noise_scale)


def with_candidate(task: Task, state: Selected, found: Candidate, beside: Round) -> Selected:
    """Add an effect to the model, refitted to the end.

    Args:
        beside: The round in which it was found.
    """
    assert found.fit is not None
    free = (*state.free, *entry_priors(found.entry))
    # What is no more than this law with more parameters may have come further.
    more = next((c.fit for c in beside.candidates if degenerates_to(c, found)), None)
    started = task.started(task.fitting, found.fit.model)
    extended = polished(found.fit, started, free, more, _ends(found))
    extended, free = shaped(task, extended, found.entry, started, free)
    alike = explain_as_well(found, beside.candidates, beside.scores)
    return replace(
        state,
        began=state.began or found.name,
        accepted=(*state.accepted, Accepted(found, alike)),
        free=free,
        extended=extended,
        fits=(*state.fits, extended),
    )


def shaped(
    task: Task,
    fit: ProcessNoiseFit,
    entry: Hypothesis,
    recordings: Sequence[Observed],
    free: tuple[Prior, ...],
) -> tuple[ProcessNoiseFit, tuple[Prior, ...]]:
    """Refit the details of a law's shape too, and what was a guess, if that explains more.

    Args:
        recordings: Fitting recordings, with starts for the model.

    Returns:
        The fit and its priors: the given ones, unless the recordings tell the details, and both the
        fitting and the held-out ones are more likely for what more parameters cost.
    """
    own = [q for q in entry.effect.parameters if q.name != entry.size_parameter]
    names = [f"{entry.name}.{q.name}" for q in own if q.refined or is_guess(q)]
    if not names:
        return fit, free
    more = (*free, *default_priors(fit.model, names))
    begin = fit.refit.values
    begin |= {f"{entry.name}.{name}": value for name, value in entry.details.items()}
    samples = sum(len(r.outputs) for r in recordings)
    try:
        trial = _converged(fit, recordings, more, begin)
        judging = task.started(task.judging, fit.model)
        before = blocks_of_cost(fit, judging)
        held_out, _ = held_out_gain(before, trial, judging)
    except Exception:  # noqa: BLE001
        # The fit that was compared stands, whatever a law does when it is refined.
        return fit, free
    # Where more is left out, a shape bends towards that, and is not told by the recordings.
    told = all(e.std < e.prior.std for e in trial.refit.estimates if e.name in names)
    pays = fit.cost - trial.cost >= rules.selection_penalty(1, samples, len(names))
    if not (told and pays and held_out[0] > 0.0):
        return fit, free
    return replace(trial, passed=fit.passed), more


def polished(
    fit: ProcessNoiseFit,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    beside: ProcessNoiseFit | None = None,
    ends: Sequence[Mapping[str, float]] = (),
) -> ProcessNoiseFit:
    """Refit once more, to the end: comparing hypotheses needs less.

    Args:
        ends: Values of some parameters by name, in SI, from which it begins too.
        beside: A fit with another effect instead of the last one, from whose values of all others
            the refit begins too.
    """
    own = fit.refit.values
    starts = [(own, False), *((own | dict(end), True) for end in ends)]
    if beside is not None:
        shared = {k: v for k, v in beside.refit.values.items() if k in own}
        starts.append((own | shared, True))
    best = fit
    for start, follow in starts:
        try:
            final = _converged(fit, recordings, priors, start, follow=follow)
        except Exception:  # noqa: BLE001
            # The fit that was compared stands, whatever a law does when it is refined.
            continue
        if final.cost <= best.cost + (INDIFFERENT if final.noise_scale < best.noise_scale else 0.0):
            best = replace(final, passed=fit.passed)
    return best


def _converged(
    fit: ProcessNoiseFit,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    start: Mapping[str, float],
    *,
    follow: bool = True,
) -> ProcessNoiseFit:
    """Refit the model of a fit until that converges: along a bent valley one pass is not enough."""
    found = fit_with_process_noise(
        fit.model, recordings, priors, start=start, noise_scale=fit.noise_scale, follow=follow
    )
    for _ in range(_PASSES):
        if found.refit.converged:
            break
        found = fit_with_process_noise(
            fit.model, recordings, priors, start=found.refit.values,
            noise_scale=found.noise_scale, follow=False,
        )  # fmt: skip
    return found


def _ends(found: Candidate) -> list[dict[str, float]]:
    """Return the ends of what is a part of a whole in an effect: there its law is a simpler one.

    Between them two memories may stand in for one, in a valley that no step leaves.
    """
    entry = found.entry
    parts = [q for q in entry.effect.parameters if q.fitted and (q.lower, q.upper) == (0.0, 1.0)]
    names = [f"{entry.name}.{q.name}" for q in parts if q.name != entry.size_parameter]
    return [{name: end} for name in names for end in (0.0, 1.0)]


def retimed(task: Task, state: Selected) -> Selected:
    """Look once more when the events came, now that all they are is part of the model.

    What was found of their shape, or beside them, may show their times better. Events that came
    together may hold each other where only one of them would move.
    """
    names = [a.candidate.entry.name for a in state.accepted]
    found = [state.extended.model.effect(n) for n in names]
    once = [e.name for e in found if is_event(e) and not e.about.period]
    groups = [once] * (len(once) > 1)
    groups += [[e.name] for e in found if is_event(e) or e.about.begins]
    for group in groups:
        task.say(f"looking again when {' and '.join(group)} came")
        state = _moved(task, state, group)
    return state


def _moved(task: Task, state: Selected, events: Sequence[str]) -> Selected:
    full = state.extended
    before = tuple(map(full.model.effect, events))
    after = with_own_starts(before, full, task.nominal, task.fitting, task.judging)
    if all(new is old for new, old in zip(after, before, strict=True)):
        return state
    model = full.model.without(*events).with_effect(*after)
    begin = full.refit.values
    begin |= changed_values(full.model, before, after)
    recordings = task.started(task.fitting, model)
    try:
        fit = fit_with_process_noise(
            model, recordings, state.free, start=begin, noise_scale=full.noise_scale
        )
    except NumericalError:
        return state
    states, accepted = {e.name: e.states for e in after}, []
    for found in state.accepted:
        candidate = found.candidate
        own = states.get(candidate.entry.name, candidate.entry.effect.states)
        entry = replace(candidate.entry, effect=replace(candidate.entry.effect, states=own))
        accepted.append(Accepted(replace(candidate, entry=entry), found.alike))
    extended = replace(fit, passed=full.passed)
    return replace(
        state, accepted=tuple(accepted), extended=extended, fits=(*state.fits[:-1], extended)
    )


def explain_as_well(
    best: Candidate, candidates: Sequence[Candidate], scores: Scores
) -> tuple[str, ...]:
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
        if (passed_all(c) and not apart) or (
            abs(best.gain - c.gain) < rules.SAME
            and not (preferred(best, c) or closer_unseen(best, c))
        ):
            same.append(c.entry.name)
    unseen = {s.entry.name for s in scores.scores if not s.testable}
    known = {s.entry.name for s in scores.scores}
    equal = [n for n in best.entry.same_as if n in known and n not in same]
    return (best.entry.name, *[n for n in same if n not in unseen], *equal)


def passed_all(candidate: Candidate) -> bool:
    """Whether an effect passed every rule, even if another explained more."""
    return (
        candidate.followed
        and candidate.fit is not None
        and candidate.refused in ("", rules.SURPASSED)
    )


def remembered(task: Task, state: Selected, candidates: Sequence[Candidate]) -> Selected:
    """Remember the sets of effects that were judged on all recordings.

    What failed, or does not show in free runs as it should, is none; nor is what is no more than
    the one that was taken.
    """
    taken = next((c for c in candidates if not c.refused), None)
    own = {effect.name for effect in task.nominal.effects}
    sets = tuple(
        Compared(tuple(sorted(e.name for e in c.fit.model.effects if e.name not in own)), c.blocks)
        for c in candidates
        if c.followed
        and c.fit
        and len(c.blocks) > 1
        and c.rule not in (rules.REFIT.name, rules.NO_EVENT, rules.FREE_RUN)
        if not (taken and degenerates_to(c, taken))
    )
    return replace(state, compared=(*state.compared, *sets))
