"""A race of hypotheses: ever fewer are refitted on ever more of the recordings, one is taken."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from workbench.arrays import Vector
from workbench.computing.processes import Call, in_order
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior, entry_priors
from workbench.diagnosis.estimation.process_noise import (
    PERFECT,
    ProcessNoiseFit,
    blocks_as_trusted,
    blocks_of_cost,
    fit_with_process_noise,
)
from workbench.diagnosis.selection.candidate import (
    Candidate,
    explains,
    is_sensor,
    leaves_nothing,
    trusts_less,
)
from workbench.diagnosis.selection.decision import closer_unseen, decided
from workbench.diagnosis.selection.final_refit import closest_errors, followed
from workbench.diagnosis.selection.first_refit import first_refit
from workbench.diagnosis.selection.held_out import NO_RUNS, told_apart
from workbench.diagnosis.selection.moments import at_times_of, is_event, times_of
from workbench.diagnosis.selection.refit_in_turn import NEARER, Basis
from workbench.diagnosis.selection.rules import SAME, TWIN, Limits
from workbench.diagnosis.selection.score import Score
from workbench.diagnosis.selection.shortlist import LEAST_SCORE
from workbench.diagnosis.selection.task import Task
from workbench.errors import NumericalError

_FINALISTS = 4
_MOST_SENSORS = 2

_FIELD = 12
"""How many hypotheses are refitted on a longer part of the recordings."""

_RIVALS = 0.7
"""Gain over that of one that leaves little of the equations in doubt, from which on others may be
as good on all of the recordings."""

_CONTENDS = 0.3
"""Gain of a first refit over the best one, up to which more trust makes no rival of it, where both
trust the equations as much."""

_SAID = 4
"""How many of those that are refitted are told by name."""

_BY_SCORE = 4
"""How many of them are there for their score, whatever they gain in a first short refit."""

_HEADS = (1500, 5000)
"""Samples of each recording that the first refits of a hypothesis use, one after the other."""

_RACED = 1.3
"""Length of a recording over its head from which on a first refit uses the head only."""

_SHORT = 5000
"""Samples of all recordings below which a refit begins from more places."""

_FAR = 50.0
"""A step that gains less log likelihood than this ends a short refit."""

_NEAR = 10.0
"""A step that gains less log likelihood than this ends the first refit of a hypothesis."""


def refit_candidates(
    task: Task,
    base: ProcessNoiseFit,
    priors: Sequence[Prior],
    chosen: Sequence[Score],
    limits: Limits,
    *,
    thorough: bool = False,
    alike: Callable[..., Sequence[str]] | None = None,
    begun: Mapping[str, Candidate] | None = None,
) -> tuple[Candidate, ...]:
    """Refit each hypothesis beside what a model has, together with the free parameters.

    Args:
        base: The fitted model without them.
        priors: Those of its parameters that are refitted.
        thorough: Whether refits on short recordings begin from more places: where nothing was found
            yet, whose parameters would lead the way.
        alike: Gives the names of effects whose signature resembles that of one, above a cosine, as
            `Scores.look_alikes`; nobody asks for them by default.
        begun: Refits beside another base by name of the hypothesis, each from where that one goes
            on.

    Returns:
        Candidates by falling gain, each accepted or refused with the reason.
    """
    if not chosen:
        return ()
    fit_on, hold_out = (task.started(r, base.model) for r in (task.fitting, task.judging))
    known = base.cost - float(blocks_of_cost(base, fit_on).sum())
    basis = Basis(base, tuple(priors), tuple(fit_on), known, task.jobs, thorough)
    earlier = {name: _beside(base, c) for name, c in (begun or {}).items()}
    field, lost = _qualified(task, basis, chosen, earlier)
    names, more = [s.entry.name for s in field[:_SAID]], len(field) - _SAID
    task.say(f"refitting with {', '.join(names)}{f' and {more} more' if more > 0 else ''}")
    heads = _heads(basis, field, _HEADS[1])
    at_first = _with_common_gain(basis, _first_refits(heads, field, _NEAR, earlier))
    best_score, several = field.index(chosen[0]), len(fit_on) > 1
    leaders = _leaders(at_first, best_score, several=several)
    finals = _Finals(task, basis, hold_out, limits, [*at_first, *lost])
    for some in _rivals(basis, heads, at_first, leaders):
        if finals.best is None:
            finals.compare(some)
    # What gained more and is refused takes nobody's place, unless nothing is missing.
    if finals.best is None and thorough and not limits.near_noise:
        finals.compare(_leaders(finals.left_of(at_first), best_score, several=several))
    best = finals.best
    if best is None:
        return finals.found
    came = _came_too(at_first, finals.candidates, best) if several else []
    finals.compare(came or (_twins(alike, finals.candidates, best) if alike else []))
    finals.compare_at_its_times()
    finals.compare_to_the_end()
    return finals.with_single_places()


class _Finals:
    """Refits of some hypotheses on the whole recordings, and what is decided of all.

    Args:
        hold_out: Recordings that no refit sees.
        candidates: First refits of all that raced.
    """

    def __init__(
        self,
        task: Task,
        basis: Basis,
        hold_out: Sequence[Observed],
        limits: Limits,
        candidates: list[Candidate],
    ) -> None:
        self._task, self._basis, self._hold_out = task, basis, hold_out
        self._limits, self._runs = limits, NO_RUNS
        self.candidates = candidates
        self.found = decided(candidates, NO_RUNS, limits)

    @property
    def best(self) -> Candidate | None:
        """The best candidate that is accepted."""
        return next((c for c in self.found if not c.refused), None)

    def left_of(self, at_first: Sequence[Candidate]) -> list[Candidate]:
        """Return the first refits that are still to be followed, without sensors that remember."""
        return [
            replace(c, fit=None) if self.candidates[i].followed or _remembers(c) else c
            for i, c in enumerate(at_first)
        ]

    def compare(self, places: Sequence[int]) -> None:
        """Follow some of the candidates to the end, and decide of all again."""
        if places:
            self._go_on("comparing", {i: self.candidates[i] for i in places}, first=True)

    def compare_at_its_times(self) -> None:
        """Follow what may have come instead of an event, at its times.

        By itself a first refit may end at other times, where the event shows nothing of it.
        """
        best = self.best
        if best is None or not is_event(best.entry.effect):
            return
        places = [i for i, c in enumerate(self.candidates) if _may_come_instead(c, best)]
        places = [i for i in places if not self.candidates[i].followed]
        places = sorted(places, key=lambda i: -self.candidates[i].gain)[:_FINALISTS]
        if places:
            begun = {i: _at_times_of(best, self.candidates[i]) for i in places}
            self._go_on("comparing", begun)

    def compare_to_the_end(self) -> None:
        """Go on with what gains as much as the best one and is told from it all the same.

        It may have ended early, in a bent valley.
        """
        best = self.best
        near = [i for i, c in enumerate(self.candidates) if best and _ended_early(c, best)]
        if best and near:
            begun = {i: _from_where(best, self.candidates[i]) for i in near}
            self._go_on("refitting to the end", begun)

    def _go_on(self, doing: str, begun: Mapping[int, Candidate], *, first: bool = False) -> None:
        """Follow candidates, by place, and decide of all again.

        Args:
            first: Whether they were not followed yet; else what gains more is kept.
        """
        self._task.say(f"{doing} {' and '.join(c.name for c in begun.values())}")
        for i, final in zip(begun, self._followed([*begun.values()]), strict=True):
            if first or final.gain > self.candidates[i].gain:
                self.candidates[i] = final
        self.found = decided(self.candidates, self._runs, self._limits)

    def with_single_places(self) -> tuple[Candidate, ...]:
        """Return what is decided where the best one, if it acts at several places, acts at one too.

        It begins with the parameters as they were widened and tuned.
        """
        best = self.best
        if best is None or not best.entry.alone:
            return self.found
        shape = best.entry.effect.parameters
        at_one = [
            replace(best, entry=replace(entry, effect=replace(entry.effect, parameters=shape)))
            for entry in best.entry.alone
        ]
        return decided((*self.candidates, *self._followed(at_one)), self._runs, self._limits)

    def _followed(self, some: Sequence[Candidate]) -> list[Candidate]:
        basis, hold_out = self._basis, self._hold_out
        calls: list[Call[Any]] = [(followed, (basis, c, hold_out, self._before)) for c in some]
        if self._runs is NO_RUNS:
            # How far the base itself is from the recordings.
            calls.append((closest_errors, (basis.base, basis.base.model, basis.fit_on, hold_out)))
        done: list[Any] = in_order(calls, jobs=self._task.jobs)
        if self._runs is NO_RUNS:
            self._runs = done.pop()
        return done

    @cached_property
    def _before(self) -> Vector | None:
        """Cost of the base on the held-out recordings by block of time."""
        return blocks_as_trusted(self._basis.base, self._hold_out) if self._hold_out else None


def _qualified(
    task: Task, basis: Basis, chosen: Sequence[Score], earlier: dict[str, Candidate]
) -> tuple[list[Score], list[Candidate]]:
    """Return whom a race on the beginning of the recordings leaves, and refits of the others.

    Args:
        earlier: Refits by name of the hypothesis, from which later ones go on; those of the race
            are added.
    """
    racing = [s for s in chosen if s.entry.name not in earlier]
    lengths = [len(r.outputs) for r in basis.fit_on]
    long = max(lengths) > _RACED * _HEADS[0] or sum(lengths) > _RACED * _HEADS[1]
    if not racing or not long:
        return list(chosen), []
    task.say(f"racing {len(racing)} effects on the beginning of the recordings")
    ran = _with_common_gain(basis, _raced(basis, racing))
    raced = dict(zip((s.entry.name for s in racing), ran, strict=True))
    behind = [s for s in chosen[_BY_SCORE:] if s.entry.name in raced]
    places = _ranked([raced[s.entry.name] for s in behind])
    order = [*(s for s in chosen if s not in behind), *(behind[i] for i in places)]
    earlier |= raced
    return order[:_FIELD], [earlier[s.entry.name] for s in order[_FIELD:]]


def _remembers(candidate: Candidate) -> bool:
    """Tell whether it is a sensor that is slow or late, which predicts the next sample of much."""
    return is_sensor(candidate) and bool(candidate.entry.far or candidate.entry.effect.states)


def _ended_early(candidate: Candidate, best: Candidate) -> bool:
    """Tell whether a candidate explains as much as the best one, and is told from it all the same.

    As an unbalanced mass and a tilt are, of which one load shows no difference.
    """
    followed_too = candidate.followed and candidate.fit is not None
    if not followed_too or not NEARER < best.gain - candidate.gain < SAME:
        return False
    return told_apart(best.blocks, candidate.blocks) or closer_unseen(best, candidate)


def _may_come_instead(candidate: Candidate, best: Candidate) -> bool:
    """Tell whether an event is another one at its place, or it elsewhere, and ends if it does."""
    own, other = candidate.entry.effect, best.entry.effect
    near = own.ports == other.ports or candidate.entry.law == best.entry.law
    alike = is_event(own) and near and len(times_of(own)) == len(times_of(other))
    return alike and candidate.fit is not None and candidate.name != best.name


def _at_times_of(best: Candidate, candidate: Candidate) -> Candidate:
    """Return an event that goes on at the times of the best one."""
    fit, other = candidate.fit, best.fit
    assert fit is not None
    assert other is not None
    own, now = (
        [f"{f.model.effects[-1].name}.{n}" for n in times_of(c.entry.effect)]
        for f, c in ((fit, candidate), (other, best))
    )
    ended = other.refit.values
    at = {mine: ended[its] for mine, its in zip(own, now, strict=True)}
    effect = at_times_of(candidate.entry.effect, best.entry.effect)
    there = replace(candidate, entry=replace(candidate.entry, effect=effect))
    return _from_where(best, there, at)


def _from_where(
    best: Candidate, candidate: Candidate, own: Mapping[str, float] = MappingProxyType({})
) -> Candidate:
    """Return a candidate that goes on with what it shares with the best one as that has it.

    Args:
        own: Where other parameters go on from, by name, in SI.
    """
    assert candidate.fit is not None
    assert best.fit is not None
    fit, ended = candidate.fit, {**best.fit.refit.values, **own}
    estimates = tuple(replace(e, value=ended.get(e.name, e.value)) for e in fit.refit.estimates)
    return replace(candidate, fit=replace(fit, refit=replace(fit.refit, estimates=estimates)))


def _raced(basis: Basis, field: Sequence[Score]) -> list[Candidate]:
    """Refit hypotheses on the beginning of two recordings, or on more if they are short.

    The one that shows a hypothesis best is among them.
    """
    fit_on = basis.fit_on
    groups: dict[tuple[int, ...], list[int]] = {}
    for i, score in enumerate(field):
        order = sorted(range(len(fit_on)), key=lambda k: k != score.clearest)
        sizes = np.cumsum([min(len(fit_on[k].outputs), _HEADS[0]) for k in order])
        enough = int(np.searchsorted(sizes, 2 * _HEADS[0])) + 1
        groups.setdefault(tuple(sorted(order[:enough])), []).append(i)
    found: dict[int, Candidate] = {}
    for chosen, own in groups.items():
        here = [replace(field[i], clearest=chosen.index(field[i].clearest)) for i in own]
        some = basis._replace(fit_on=[fit_on[k] for k in chosen])
        done = _first_refits(_heads(some, here, _HEADS[0]), here, _FAR)
        found |= dict(zip(own, done, strict=True))
    return [found[i] for i in range(len(field))]


def _first_refits(
    heads: Sequence[Basis],
    field: Sequence[Score],
    enough: float,
    begun: Mapping[str, Candidate] | None = None,
) -> list[Candidate]:
    """Refit hypotheses on the beginning of each recording, from where earlier refits ended.

    Args:
        heads: What each is refitted on, of one base.
        begun: The earlier refits by name.
    """
    begun = begun or {}
    seen = [head.samples for head in heads]
    order = sorted(range(len(field)), key=lambda i: -field[i].gain)
    found: dict[int, Candidate] = {}
    # The best scores first, then ever more at a time.
    ends = [_BY_SCORE * (2**k - 1) for k in range(len(order).bit_length() + 1)]
    for some in (order[i:j] for i, j in pairwise(ends) if i < len(order)):
        # Beside what leaves nothing out nobody waits for the others to be tried in every way.
        complete = {k: c.gain for k, c in found.items() if leaves_nothing(heads[k].base, c)}
        # Nor for what explains much less, by sample: what comes late is refitted on more of them.
        clear = max((gain / seen[k] for k, gain in complete.items()), default=0.0)
        calls: list[Call[Candidate]] = []
        for i in some:
            own = heads[i]._replace(thorough=heads[i].thorough and not complete)
            earlier, least = begun.get(field[i].entry.name), _CONTENDS * clear * seen[i]
            calls.append((first_refit, (own, field[i], enough, earlier, least)))
        found |= dict(zip(some, in_order(calls, jobs=heads[0].jobs), strict=True))
    return [found[i] for i in range(len(field))]


def _heads(basis: Basis, field: Sequence[Score], samples: int) -> list[Basis]:
    """Return what refits begin with on the beginnings that show each hypothesis.

    What happens later than a beginning is refitted on as much as shows it.
    """
    short = basis.samples <= _SHORT
    basis = basis._replace(thorough=basis.thorough and short)
    lengths = [samples if score.late < samples else 2 * score.late for score in field]
    heads = {n: _head(basis, [r.part(slice(n)) for r in basis.fit_on]) for n in {*lengths}}
    return [heads[n] for n in lengths]


def _head(basis: Basis, head: Sequence[Observed]) -> Basis:
    """Return what refits begin with on the beginnings of recordings.

    What all of them lack may not be seen there: with more trust in the equations every hypothesis
    would gain, whatever it says.
    """
    base = basis.base
    least = usual = basis.known + float(blocks_of_cost(base, head).sum())
    whole = sum(len(r.outputs) for r in head) == basis.samples
    for start in () if whole or base.noise_scale <= PERFECT else ({}, base.refit.values):
        with contextlib.suppress(NumericalError):
            fit = fit_with_process_noise(
                base.model, head, basis.priors, start=start, noise_scale=base.noise_scale,
                enough=_NEAR,
            )  # fmt: skip
            least = min(fit.cost, least)
    return basis._replace(fit_on=head, costs=(usual, least))


def _rivals(
    basis: Basis, heads: Sequence[Basis], first: Sequence[Candidate], leaders: list[int]
) -> tuple[list[int], list[int]]:
    """Part leaders from those that explain clearly less than what explains nearly all.

    They are no rivals, unless what explains more is refused.
    """
    if len(leaders) < 2:
        return leaders, []
    trusted = _with_common_gain(
        basis, _trusted([heads[i] for i in leaders], [first[i] for i in leaders])
    )
    near = set[int]()
    for gains in _gains(trusted):
        top = int(np.argmax(gains))
        if not explains(trusted[top]):
            return leaders, []
        near |= {i for i, gain in zip(leaders, gains, strict=True) if gain > _RIVALS * gains[top]}
    return [i for i in leaders if i in near], [i for i in leaders if i not in near]


def _gains(found: Sequence[Candidate]) -> tuple[list[float], ...]:
    """Return gains, dimensionless, of first refits, and on beginnings that are as long for all.

    What comes late is refitted on more samples than the rest, and gains more for that. What is not
    refitted on all that it is compared on gains less.
    """
    return [c.gain for c in found], [
        c.gain if math.isnan(c.common_gain) else c.common_gain for c in found
    ]


def _with_common_gain(basis: Basis, found: Sequence[Candidate]) -> list[Candidate]:
    """Return first refits with what each gains, as it ended, on the longest of their beginnings."""
    lengths = {c.length for c in found if c.fit is not None}
    if len(lengths) < 2:
        return [replace(c, common_gain=math.nan) for c in found]
    parts = [r.part(slice(max(lengths))) for r in basis.fit_on]
    before = float(blocks_of_cost(basis.base, parts).sum())
    gains = in_order([(_gain_along, (basis, parts, before, c)) for c in found], jobs=basis.jobs)
    return [replace(c, common_gain=gain) for c, gain in zip(found, gains, strict=True)]


def _gain_along(
    basis: Basis, parts: Sequence[Observed], before: float, candidate: Candidate
) -> float:
    fit = candidate.fit
    if fit is None:
        return -math.inf
    try:
        return before - float(blocks_of_cost(fit, basis.started(parts, fit.model)).sum())
    except NumericalError:
        return -math.inf


def _ranked(found: Sequence[Candidate]) -> list[int]:
    """Return places of first refits, best first by whichever gain puts one higher."""
    ranks = [len(found)] * len(found)
    for gains in _gains(found):
        for rank, i in enumerate(sorted(range(len(found)), key=lambda i: -gains[i])):
            ranks[i] = min(ranks[i], rank)
    return sorted(range(len(found)), key=lambda i: (ranks[i], -found[i].gain))


def _trusted(heads: Sequence[Basis], first: Sequence[Candidate]) -> list[Candidate]:
    """Refit hypotheses that contend with as much trust in the equations as each of them earns.

    Where the equations are as imperfect as without it, the right law gains little more than a wrong
    one that bends the same way: the noise that is expected makes up for the rest.
    """
    best = max(first, key=lambda c: c.gain)
    least = max(_CONTENDS * best.gain, LEAST_SCORE)
    chosen = [i for i, c in enumerate(first) if c.gain > least or trusts_less(c, best)]
    calls = [(_with_trust, (heads[i], first[i])) for i in chosen]
    found = list(first)
    for i, candidate in zip(chosen, in_order(calls, jobs=heads[0].jobs), strict=True):
        found[i] = candidate
    return found


def _with_trust(basis: Basis, first: Candidate) -> Candidate:
    assert first.fit is not None
    model = first.fit.model
    try:
        fit = fit_with_process_noise(
            model,
            basis.started(basis.fit_on, model),
            (*basis.priors, *entry_priors(first.entry)),
            start=first.fit.refit.values,
            noise_scale=first.fit.noise_scale,
            enough=_NEAR,
        )
    except Exception:  # noqa: BLE001
        # Whatever a law does, its failure must not end the diagnosis.
        return first
    return replace(first, fit=fit, gain=basis.gain(fit))


def _beside(base: ProcessNoiseFit, candidate: Candidate) -> Candidate:
    """Return a refit beside another base as one from which a refit beside this one may go on."""
    assert candidate.fit is not None
    fit, own = candidate.fit, f"{candidate.entry.name}."
    estimates = tuple(
        e for e in fit.refit.estimates if e.name in base.refit.values or e.name.startswith(own)
    )
    refit = replace(fit.refit, estimates=estimates)
    return replace(candidate, fit=replace(fit, refit=refit, noise_scale=base.noise_scale))


def _leaders(first: Sequence[Candidate], best: int, *, several: bool = False) -> list[int]:
    """Choose which hypotheses to follow, by their gain in the first refit.

    A lag or delay of a sensor reproduces many a slow or springy part of the process, and does so at
    several sensors: of each such law one is followed, and two at the most. The best score is
    followed too, whatever its first refit gained, and takes nobody's place; so is the best event of
    several recordings, which may come to each at a time of its own. An event is not followed where
    what acts there all the time explains as much.

    Args:
        best: Place of the best score.
    """
    worthy = [i for i in _ranked(first) if first[i].fit is not None and first[i].gain > LEAST_SCORE]
    worthy = [i for i in worthy if not any(_always(first[k], first[i]) for k in worthy)]
    leaders: list[int] = []
    laws: set[str] = set()
    for i in worthy:
        entry = first[i].entry
        if entry.group == "sensor":
            if entry.law in laws or len(laws) >= _MOST_SENSORS:
                continue
            laws.add(entry.law)
        if len(leaders) < _FINALISTS:
            leaders.append(i)
    if first and first[best].fit is not None and best not in leaders:
        leaders.append(best)
    events = [i for i in worthy if is_event(first[i].entry.effect)]
    if several and events and not set(events) & set(leaders):
        leaders += [i for i in events[:1] if first[i].gain > _RIVALS * first[worthy[0]].gain]
    return leaders


def _always(one: Candidate, event: Candidate) -> bool:
    """Whether a law without a time explains as much, with no less trust, as what comes at one."""
    if not is_event(event.entry.effect) or is_event(one.entry.effect) or trusts_less(one, event):
        return False
    ports = one.entry.effect.ports == event.entry.effect.ports
    as_much = one.gain >= event.gain or one.common_gain >= event.common_gain
    return ports and one.own_parameters < event.own_parameters and as_much


def _came_too(
    at_first: Sequence[Candidate], now: Sequence[Candidate], best: Candidate
) -> list[int]:
    """Return what may have come instead of an event that was found, and was not followed yet.

    Told one time for all recordings it gained about as much, which of several times says little.
    """
    if not is_event(best.entry.effect):
        return []
    least = _RIVALS * max((c.gain for c in at_first if c.name == best.name), default=math.inf)
    events = [i for i, c in enumerate(now) if is_event(c.entry.effect) and not c.followed]
    events = [i for i in events if now[i].fit is not None and now[i].gain > least]
    return sorted(events, key=lambda i: -now[i].gain)[: _FINALISTS - 1]


def _twins(
    alike: Callable[..., Sequence[str]], now: Sequence[Candidate], best: Candidate
) -> list[int]:
    """Return what was not followed yet and does the same to these recordings as what was found.

    A friction of what turns one way only is a constant torque: which of them a short refit brings
    further is chance. So it is which of two laws that do nearly the same comes to trust the
    equations: until then neither gains much.
    """
    same, nearly = alike(best.name, above=TWIN), alike(best.name)
    twins = [
        i
        for i, c in enumerate(now)
        if c.fit is not None and not c.followed
        if c.name in same or (c.name in nearly and trusts_less(c, best))
    ]
    return sorted(twins, key=lambda i: -now[i].gain)[:_FINALISTS]
