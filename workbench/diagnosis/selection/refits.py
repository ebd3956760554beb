"""Selecting effects: full refits of the best-scored hypotheses, accepted on held-out recordings."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import as_recorded, free_run
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.priors import Prior, is_guess
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    PERFECT,
    ProcessNoiseFit,
    blocks_as_trusted,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    start_values,
)
from workbench.diagnosis.estimation.windows import windows
from workbench.diagnosis.selection.candidate import Candidate, colours_noise
from workbench.diagnosis.selection.decision import decided
from workbench.diagnosis.selection.held_out import NO_RUNS, RunErrors, held_out_gain, run_errors
from workbench.diagnosis.selection.moments import (
    changed_values,
    is_event,
    least_between,
    level_everywhere,
    with_own_starts,
)
from workbench.diagnosis.selection.rules import SAME_LEVELS, SURPASSED, TWIN, UNTRIED, Limits
from workbench.diagnosis.selection.score import COLLINEAR, Score, reason_of
from workbench.diagnosis.selection.shortlist import LEAST_SCORE
from workbench.diagnosis.selection.simulation_error import closest_runs
from workbench.errors import NumericalError
from workbench.model import Model, Parameter
from workbench.physics.library import Hypothesis
from workbench.work.processes import Call, in_order

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

_NEARER = 1.0
"""The same for the refit of those that are followed."""

_STEEP = (3.0, 0.3, 0.03)
"""Process-noise scales of a refit that begins far from where the last one ended."""

_SIZES = (0.3, 1.0, 3.0)
"""Multiples of the usual size from which a refit may start."""

_PARTS = (0.1, 0.3)
"""Parts of the largest size from which a refit starts of which small sizes tell nothing."""

_STEP, _STEPS = 3.0, 6
"""Factor between sizes that are tried from there on as long as the recordings become likelier, and
how many: the usual size may be wrong by a hundred."""

_FINE, _FINEST = 0.02, 8
"""Logarithm within which what was found in steps is searched between them, and in how many runs."""

_SCANNED, _SCANS = 13, 3
"""Values that are tried between steps where the cost jumps, ever closer, and how often."""

_CRAWL = 0.25
"""Change of the logarithm of an event's width below which another one would follow at once."""

_LEAP = 100.0
"""Factor of a step from a guess that small steps do not improve: where a reversal is far sharper or
rounder than what was sampled, they change nothing."""

_SPARE, _LITTLE = 4, 0.1
"""Samples of a delay that its equations have again where it may be shorter than was moved; part of
one that they may have more or less than a whole one."""

_WIDER, _WIDENINGS = 5.0, 4
"""Factor by which a bound is widened that a solution sits on, and how often."""

Progress = Callable[[str], None]

Alike = Callable[..., Sequence[str]]
"""Gives the names of effects whose signature resembles that of one, above a cosine; see
`Scores.look_alikes`."""


class Race(NamedTuple):
    """What all hypotheses begin with.

    Args:
        base: The fitted model without the effects.
        fit_on: Fitting recordings, with a start for the model of ``base``.
        known: Minus the logarithm of the priors, which the cost of a refit has too, dimensionless.
        thorough: Whether refits on short recordings begin from more places.
    """

    base: ProcessNoiseFit
    priors: tuple[Prior, ...]
    fit_on: Sequence[Observed]
    hold_out: Sequence[Observed] = ()
    known: float = 0.0
    jobs: int = 1
    thorough: bool = True


def refit_candidates(
    base: ProcessNoiseFit,
    chosen: Sequence[Score],
    priors: Sequence[Prior],
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
    *,
    limits: Limits,
    jobs: int = 1,
    progress: Progress | None = None,
    thorough: bool = True,
    alike: Alike | None = None,
    begun: Mapping[str, Candidate] | None = None,
) -> tuple[Candidate, ...]:
    """Refit each hypothesis together with the free parameters.

    Args:
        base, fit_on, thorough: As for `Race`.
        begun: Refits beside another base by name of the hypothesis, each from where that one goes
            on.
        alike: Gives the hypotheses whose signature resembles that of one; nobody asks for them by
            default.

    Returns:
        Candidates by falling gain, each accepted or refused with the reason.
    """
    field, lost = list(chosen), []
    lengths = [len(r.outputs) for r in fit_on]
    known = base.cost - float(blocks_of_cost(base, fit_on).sum()) if field else 0.0
    fit_on, hold_out = tuple(fit_on), tuple(hold_out)
    race = Race(base, tuple(priors), fit_on, (), known, jobs, thorough)
    earlier = {name: _beside(base, c) for name, c in (begun or {}).items()}
    racing = [s for s in chosen if s.entry.name not in earlier]
    if racing and (max(lengths) > _RACED * _HEADS[0] or sum(lengths) > _RACED * _HEADS[1]):
        if progress:
            progress(f"racing {len(racing)} effects on the beginning of the recordings")
        raced = dict(zip([s.entry.name for s in racing], _raced(race, racing), strict=True))

        def place(i: int) -> tuple[bool, float]:
            found = raced.get(chosen[i].entry.name)
            return found is not None and i >= _BY_SCORE, -found.gain if found else -math.inf

        order = sorted(range(len(field)), key=place)
        field = [chosen[i] for i in order[:_FIELD]]
        earlier |= raced
        lost = [earlier[chosen[i].entry.name] for i in order[_FIELD:]]
    if progress and field:
        names = [s.entry.name for s in field]
        said, more = ", ".join(names[:_SAID]), len(names) - _SAID
        progress(f"refitting with {said}{f' and {more} more' if more > 0 else ''}")
    first = _first_refits(race, field, _HEADS[1], _NEAR, earlier)
    leaders = _leaders(first, field.index(chosen[0]) if field else 0, several=len(fit_on) > 1)
    weaker: list[int] = []
    if len(leaders) > 1:
        trusted = _trusted(race, [field[i] for i in leaders], [first[i] for i in leaders])
        top = max(trusted, key=lambda c: c.gain)
        if _explains(top):
            # What explains clearly less is no rival, unless what explains more is refused.
            least = _RIVALS * top.gain
            weaker = [i for i, c in zip(leaders, trusted, strict=True) if not c.gain > least]
            leaders = [i for i in leaders if i not in weaker]
    before = blocks_as_trusted(base, hold_out) if leaders and hold_out else None
    race = race._replace(hold_out=hold_out)
    plain: list[Call[Any]] = [(_closest_errors, (base, base.model, fit_on, hold_out))]
    runs, at_first = NO_RUNS, tuple(first)
    first += lost
    found = decided(first, NO_RUNS, limits)
    best: Candidate | None = None
    waiting = [leaders, weaker]
    while waiting:
        some = waiting.pop(0)
        if not some:
            continue
        if progress:
            progress("comparing " + " and ".join(first[i].entry.name for i in some))
        finals: list[Call[Any]] = [(_followed, (race, first[i], before)) for i in some]
        done: list[Any] = in_order([*finals, *plain], jobs=jobs)
        for i, final in zip(some, done, strict=False):
            first[i] = final
        if plain:
            runs, plain = done[-1], []
        found = decided(first, runs, limits)
        early = best is None
        best = next((c for c in found if not c.refused), None)
        if best is not None:
            waiting = []
            if early:
                came = _came_too(at_first, first, best) if len(fit_on) > 1 else []
                waiting = [came, _twins(alike, first, best) if alike else []]
    if best is None or not best.entry.alone:
        return found
    # What acts at several places alike may act at one of them.
    # It begins with the parameters as they were widened and tuned.
    shape = best.entry.effect.parameters
    at_one = [
        replace(best, entry=replace(entry, effect=replace(entry.effect, parameters=shape)))
        for entry in best.entry.alone
    ]
    alone = in_order([(_followed, (race, c, before)) for c in at_one], jobs=jobs)
    return decided((*first, *alone), runs, limits)


def _raced(race: Race, field: Sequence[Score]) -> list[Candidate]:
    """Refit hypotheses on the beginning of two recordings, or on more if they are short.

    The one that shows a hypothesis best is among them.
    """
    fit_on = race.fit_on
    groups: dict[tuple[int, ...], list[int]] = {}
    for i, score in enumerate(field):
        order = sorted(range(len(fit_on)), key=lambda k: k != score.clearest)
        sizes = np.cumsum([min(len(fit_on[k].outputs), _HEADS[0]) for k in order])
        enough = int(np.searchsorted(sizes, 2 * _HEADS[0])) + 1
        groups.setdefault(tuple(sorted(order[:enough])), []).append(i)
    found: dict[int, Candidate] = {}
    for chosen, own in groups.items():
        here = [replace(field[i], clearest=chosen.index(field[i].clearest)) for i in own]
        some = race._replace(fit_on=[fit_on[k] for k in chosen])
        done = _first_refits(some, here, _HEADS[0], _FAR)
        found |= dict(zip(own, done, strict=True))
    return [found[i] for i in range(len(field))]


def _first_refits(
    race: Race,
    field: Sequence[Score],
    samples: int,
    enough: float,
    begun: Mapping[str, Candidate] | None = None,
) -> list[Candidate]:
    """Refit hypotheses on the beginning of each recording, from where earlier refits ended.

    What happens later than that is refitted on as much as shows it.

    Args:
        begun: The earlier refits by name.
    """
    begun = begun or {}
    if not field:
        return []
    short = race.thorough and sum(len(r.outputs) for r in race.fit_on) <= _SHORT
    heads = _heads(race, field, samples)
    seen = [sum(len(r.outputs) for r in head) for head, _ in heads]
    order = sorted(range(len(field)), key=lambda i: -field[i].gain)
    found: dict[int, Candidate] = {}
    # The best scores first, then ever more at a time.
    ends = [_BY_SCORE * (2**k - 1) for k in range(len(order).bit_length() + 1)]
    for some in (order[i:j] for i, j in pairwise(ends) if i < len(order)):
        # Beside what leaves nothing out nobody waits for the others to be tried in every way.
        complete = {k: c.gain for k, c in found.items() if leaves_nothing(race.base, c)}
        ways = short and not complete
        # Nor for what explains much less, by sample: what comes late is refitted on more of them.
        clear = max((gain / seen[k] for k, gain in complete.items()), default=0.0)
        calls: list[Call[Candidate]] = []
        for i in some:
            (head, cost), least = heads[i], _CONTENDS * clear * seen[i]
            own, earlier = race._replace(fit_on=head, thorough=ways), begun.get(field[i].entry.name)
            calls.append((_first, (own, cost, field[i], enough, earlier, least)))
        found |= dict(zip(some, in_order(calls, jobs=race.jobs), strict=True))
    return [found[i] for i in range(len(field))]


def _heads(race: Race, field: Sequence[Score], samples: int) -> list[tuple[list[Observed], float]]:
    """Return the beginnings that show each hypothesis, and their cost without it, dimensionless."""
    lengths = [samples if score.late < samples else 2 * score.late for score in field]
    heads = {n: [r.part(slice(n)) for r in race.fit_on] for n in {*lengths}}
    costs = {n: float(blocks_of_cost(race.base, head).sum()) for n, head in heads.items()}
    return [(heads[n], race.known + costs[n]) for n in lengths]


def _trusted(race: Race, field: Sequence[Score], first: Sequence[Candidate]) -> list[Candidate]:
    """Refit hypotheses that contend with as much trust in the equations as each of them earns.

    Where the equations are as imperfect as without it, the right law gains little more than a wrong
    one that bends the same way: the noise that is expected makes up for the rest.
    """
    best = max(first, key=lambda c: c.gain)
    least = max(_CONTENDS * best.gain, LEAST_SCORE)
    chosen = [i for i, c in enumerate(first) if c.gain > least or _trusts_less(c, best)]
    heads = _heads(race, [field[i] for i in chosen], _HEADS[1])
    calls = [
        (_with_trust, (race._replace(fit_on=head), cost, first[i]))
        for i, (head, cost) in zip(chosen, heads, strict=True)
    ]
    found = list(first)
    for i, candidate in zip(chosen, in_order(calls, jobs=race.jobs), strict=True):
        found[i] = candidate
    return found


def _trusts_less(candidate: Candidate, best: Candidate) -> bool:
    """Whether a refit trusts the equations less than another, so that the gains do not compare."""
    fit, other = candidate.fit, best.fit
    return fit is not None and other is not None and fit.noise_scale > other.noise_scale


def _explains(candidate: Candidate) -> bool:
    """Whether the equations with an effect explain nearly all."""
    return candidate.fit is not None and candidate.fit.noise_scale <= PERFECT


def _with_trust(race: Race, cost: float, first: Candidate) -> Candidate:
    assert first.fit is not None
    model = first.fit.model
    try:
        fit = fit_with_process_noise(
            model,
            [extended_start(r, race.base.model, model) for r in race.fit_on],
            (*race.priors, *entry_priors(first.entry)[0]),
            start=first.fit.refit.values,
            noise_scale=first.fit.noise_scale,
            enough=_NEAR,
        )
    except Exception:  # noqa: BLE001
        # Whatever a law does, its failure must not end the diagnosis.
        return first
    return replace(first, fit=fit, gain=cost - fit.cost)


def _beside(base: ProcessNoiseFit, candidate: Candidate) -> Candidate:
    """Return a refit beside another base as one from which a refit beside this one may go on."""
    assert candidate.fit is not None
    fit, own = candidate.fit, f"{candidate.entry.name}."
    estimates = tuple(
        e for e in fit.refit.estimates if e.name in base.refit.values or e.name.startswith(own)
    )
    refit = replace(fit.refit, estimates=estimates)
    return replace(candidate, fit=replace(fit, refit=refit, noise_scale=base.noise_scale))


def leaves_nothing(base: ProcessNoiseFit, candidate: Candidate) -> bool:
    """Whether the equations that left something out are complete with an effect."""
    return base.noise_scale > PERFECT and _explains(candidate) and not colours_noise(candidate)


def untried(entry: Hypothesis, why: Exception | str) -> Candidate:
    """Return a candidate that could not be tried: a line, not the end of a diagnosis."""
    text = f"it could not be tried, because {why if isinstance(why, str) else reason_of(why)}"
    return Candidate(entry, None, -math.inf, refused=text, followed=False, rule=UNTRIED)


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
    order = sorted(range(len(first)), key=lambda i: -first[i].gain)
    worthy = [i for i in order if first[i].fit is not None and first[i].gain > LEAST_SCORE]
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
    if not is_event(event.entry.effect) or is_event(one.entry.effect) or _trusts_less(one, event):
        return False
    ports = one.entry.effect.ports == event.entry.effect.ports
    return ports and one.own_parameters < event.own_parameters and one.gain >= event.gain


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


def _twins(alike: Alike, now: Sequence[Candidate], best: Candidate) -> list[int]:
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
        if c.name in same or (c.name in nearly and _trusts_less(c, best))
    ]
    return sorted(twins, key=lambda i: -now[i].gain)[:_FINALISTS]


def entry_priors(
    entry: Hypothesis, size: float = 0.0
) -> tuple[tuple[Prior, ...], dict[str, float]]:
    """Return the priors of an effect's own parameters and where to start them.

    Args:
        size: Its expected size, in its unit.

    Returns:
        Priors of the size and of the shape parameters that a refit may change, and starting
        values by name, in SI: the expected size, and the library's shape. The size of a law that
        is either there or not is fixed.
    """
    priors, start = [], {}
    for q in entry.effect.parameters:
        name = f"{entry.name}.{q.name}"
        if q.name == entry.size_parameter and not entry.replaces:
            # A wide prior about zero: absence is as plausible as any size. What recordings were
            # moved ahead by leaves no less.
            low = q.lower + sum(entry.advanced.values())
            priors.append(Prior(name, 0.0, entry.largest_size, low, q.upper))
            start[name] = float(np.clip(size, low, q.upper))
        elif q.fitted and math.isfinite(q.lower) and math.isfinite(q.upper):
            priors.append(Prior(name, q.value, (q.upper - q.lower) / 4, q.lower, q.upper))
            start[name] = q.value
    return tuple(priors), start


def widened(entry: Hypothesis, fit: ProcessNoiseFit, interval: float) -> Hypothesis | None:
    """Return an effect with wider bounds where a refit ended on them; None if it did on none.

    What is bounded by nature keeps its bound: zero, all of a whole. A time does not go below the
    sampling interval, where nothing tells it from another law.

    Args:
        interval: Sampling interval of the recordings, in s.
    """
    effect = entry.effect
    values = {e.name: e for e in fit.refit.estimates}
    wider = []
    for q in effect.parameters:
        estimate = values.get(f"{effect.name}.{q.name}")
        if estimate is not None and estimate.on_bound and not entry.whole:
            at_upper = q.upper - estimate.value < estimate.value - q.lower
            if at_upper and not (q.unit == "1" and q.upper == 1.0):
                upper = q.upper * _WIDER if q.upper > 0.0 else q.upper / _WIDER
                q = replace(q, upper=upper)  # noqa: PLW2901
            elif not at_upper and q.lower != 0.0 and not (q.unit == "1" and q.lower == -1.0):
                lower = q.lower * _WIDER if q.lower < 0.0 else q.lower / _WIDER
                lower = max(lower, min(interval, q.lower)) if q.unit == "s" else lower
                q = replace(q, lower=lower)  # noqa: PLW2901
        wider.append(q)
    if tuple(wider) == effect.parameters:
        return None
    return replace(entry, effect=replace(effect, parameters=tuple(wider)))


def _started(race: Race, entry: Hypothesis) -> tuple[Model, list[Observed]]:
    """Return the model with an effect, at size zero, and the fitting recordings with its start."""
    model = race.base.model.with_effect(entry.at_size(1.0 if entry.replaces else 0.0))
    return model, [extended_start(r, race.base.model, model) for r in race.fit_on]


def in_step(entry: Hypothesis, values: Mapping[str, float], interval: float) -> Hypothesis:
    """Return an effect with the whole samples of its delay taken by the recordings.

    Its equations have what is left, less than a sample. Where that leads the way it goes on below.

    Args:
        values: Values with which a refit begins or ended, by name, in SI.
        interval: Sampling interval of the recordings, in s.
    """
    size, late = entry.size, values.get(f"{entry.name}.{entry.size_parameter}")
    if not entry.advanced or late is None:
        return entry
    (now,) = entry.advanced.values()
    shortest = late <= now + size.lower
    if not shortest and late < now + (1.0 + _LITTLE) * interval:
        return entry
    # On its lower bound it may be shorter by far: the equations have some samples again.
    spare = _SPARE if shortest else 0.0
    moved = max(math.floor(late / interval - spare + _LITTLE), 0) * interval
    return entry if moved == now else _valued(entry, {entry.effect.about.advance: moved})


class _Way(NamedTuple):
    """From where a refit begins, and how much it trusts the equations.

    Args:
        known: Values of the free parameters of the model without the effect, in SI.
        ladder: Process-noise scales, falling.
        starts: Starts to choose from; several sizes of the effect if empty.
        shapes: Whether several of its shapes are tried too.
    """

    known: Mapping[str, float]
    ladder: tuple[float, ...]
    starts: tuple[dict[str, float], ...] = ()
    shapes: bool = False


def _refitted(race: Race, score: Score, way: _Way, enough: float) -> tuple[Score, ProcessNoiseFit]:
    """Refit one hypothesis from one start, widening the bounds that it ends on."""
    known, ladder = way.known, way.ladder
    fitted = {q.name for q in score.entry.effect.parameters if q.fitted}
    shape = {name: value for name, value in score.shape.items() if name in fitted}
    score = replace(score, entry=_valued(score.entry, score.shape), shape=shape)
    entry = score.entry
    model, started = _started(race, entry)
    own, start = entry_priors(entry, score.size)
    starts = way.starts or _starts(score, {**start, **known}, shapes=way.shapes)
    names, found = [p.name for p in (*race.priors, *own)], bool(way.starts)
    begin = _best_start(race, score, model, started, names, starts, ladder[0], found=found)
    entry = in_step(entry, begin, started[0].sample_time)
    entry, fit, _ = in_turn(race, entry, begin, ladder[0], ladder=ladder, enough=enough)
    return replace(score, entry=entry), fit


def _first(
    race: Race,
    cost: float,
    score: Score,
    enough: float,
    begun: Candidate | None = None,
    least: float = 0.0,
) -> Candidate:
    """Refit a hypothesis, the equations trusted as much as without it.

    Args:
        cost: That of the base on the fitting recordings, dimensionless.
        least: Gain of the first way up to which no other is tried, beside what explains nearly all.
    """
    base, thorough = race.base, race.thorough
    usual = start_values(base.refit, race.priors)
    ways = [_Way(usual, (base.noise_scale,))]
    # What is either there or not has no small size at which anything could be told of it.
    far = score.entry.far or score.entry.replaces
    if begun is not None and begun.fit is not None:
        ended = begun.fit.refit.values
        ways = [_Way({}, (begun.fit.noise_scale,), (usual | ended, ended | usual))]
        score = replace(score, entry=begun.entry, shape={})
    else:
        # Without the effect, the free parameters have gone where they reproduce it best, from where
        # one that is far may not be found; where recordings are short, nobody waits for more ways.
        means = {q.name: q.mean for q in race.priors}
        if thorough or far or any(e.on_bound for e in base.refit.estimates):
            ways.append(_Way(means, _STEEP, shapes=True))
        if thorough:
            ways.append(_Way(means, (base.noise_scale,), shapes=True))
        if score.entry.far and score.collinearity >= COLLINEAR:
            ways += _far_ways(score, means)
    fits: list[tuple[Score, ProcessNoiseFit]] = []
    failed: Exception | None = None

    def go(way: _Way, tried: Score) -> None:
        nonlocal failed
        try:
            fits.append(_refitted(race, tried, way, enough))
        except Exception as error:  # noqa: BLE001
            # Whatever a law does, its failure must not end the diagnosis.
            failed = error

    def candidate(found: Score, fit: ProcessNoiseFit) -> Candidate:
        return Candidate(found.entry, fit, cost - fit.cost, refused=SURPASSED, followed=False)

    for way in ways:
        go(way, score)
        if not far and begun is None and fits and cost - fits[0][1].cost < least:
            return candidate(*fits[0])
    worse = not fits or min(fit.cost for _, fit in fits) > cost
    if worse and not score.entry.replaces:
        # All lead to what is worse than no effect at all: begin from there too.
        go(_from_nothing(base, score), score)
    if not fits:
        assert failed is not None
        return untried(score.entry, failed)
    found, fit = min(fits, key=lambda pair: pair[1].cost)
    if begun is None:
        # What no refit changes was chosen at size zero, which tells little of it.
        ended = fit.refit.values
        onward = _Way({}, (fit.noise_scale,), (ended, ended | usual))
        for entry in _variants(found.entry):
            go(onward, replace(found, entry=entry, shape={}))
    return candidate(*min(fits, key=lambda pair: pair[1].cost))


def _variants(entry: Hypothesis) -> list[Hypothesis]:
    """Return an effect with the other shapes that no refit changes, such as a sampled filter."""
    fitted = {q.name for q in entry.effect.parameters if q.fitted}
    now = {q.name: q.value for q in entry.effect.parameters}
    found: list[dict[str, float]] = []
    for shape in entry.shapes:
        fixed = {k: v for k, v in shape.items() if k not in fitted}
        if any(now[k] != v for k, v in fixed.items()) and fixed not in found:
            found.append(fixed)
    return [_valued(entry, fixed) for fixed in found]


def _from_nothing(base: ProcessNoiseFit, score: Score) -> _Way:
    """Return the way of a refit that begins at the model without the effect."""
    own = entry_priors(score.entry, score.size)[1] | base.refit.values
    size = f"{score.entry.name}.{score.entry.size_parameter}"
    return _Way({}, (base.noise_scale,), (own, own | {size: 0.0}))


def _far_ways(score: Score, means: Mapping[str, float]) -> list[_Way]:
    """Return ways that begin at large sizes, where other parameters are a law at small ones."""
    entry, own = score.entry, entry_priors(score.entry)[1]
    size = f"{entry.name}.{entry.size_parameter}"
    if entry.replaces or not math.isfinite(entry.size.upper):
        return []
    return [_Way({}, _STEEP, ({**own, **means, size: part * entry.size.upper},)) for part in _PARTS]


def _starts(score: Score, start: Mapping[str, float], *, shapes: bool) -> list[dict[str, float]]:
    """From where to refit: the size that the score expects, and usual ones; or several shapes.

    The score is a derivative at size zero, which for a large effect tells little of its size.
    """
    entry = score.entry
    if entry.replaces:
        # The size of a law that is either there or not says nothing of its shape.
        ordered = sorted(entry.shapes, key=lambda shape: shape != score.shape)
        return [dict(start) | {f"{entry.name}.{k}": v for k, v in s.items()} for s in ordered]
    name = f"{entry.name}.{entry.size_parameter}"
    signs: tuple[float, ...] = (1.0,)
    if start[name]:
        signs = (math.copysign(1.0, start[name]),)
    elif entry.signed:
        signs = (1.0, -1.0)
    sizes = [start[name], *(s * k * entry.typical_size for s in signs for k in _SIZES)]
    low, high = entry.size.lower, entry.size.upper
    usual = {f"{entry.name}.{k}": v for k, v in score.shape.items()}
    tried = [usual]
    if shapes:
        others = [{f"{entry.name}.{k}": v for k, v in shape.items()} for shape in entry.shapes]
        # A shape that no refit may change stays as it was scored.
        tried += [shape for shape in others if shape != usual and shape.keys() <= start.keys()]
    return [
        {**start, **shape, name: float(np.clip(s, low, high))} for shape in tried for s in sizes
    ]


def _best_start(
    race: Race,
    score: Score,
    model: Model,
    started: Sequence[Observed],
    free: Sequence[str],
    starts: Sequence[dict[str, float]],
    noise_scale: float,
    *,
    found: bool,
) -> dict[str, float]:
    """Return the start under which a recording, the one that shows the effect, is most likely.

    From the best of the given starts the size goes on in steps as long as that gains, unless it was
    found by an earlier refit.
    """
    entry, observed, begun = score.entry, race.fit_on[score.clearest], started[score.clearest]
    filter_ = filter_of(model, begun, noise_scale, free)

    def cost(start: Mapping[str, float]) -> float:
        valued, seen = model.with_parameters(start), begun
        timed = in_step(entry, start, observed.sample_time)
        if timed is not entry:
            valued = valued.with_parameters(timed.advanced)
            seen = extended_start(observed, race.base.model, valued)
        try:
            return filter_.run(seen, valued.values).cost
        except NumericalError:
            return math.inf

    least, best = min(((cost(start), start) for start in starts), key=lambda pair: pair[0])
    if entry.replaces or found or best[f"{entry.name}.{entry.size_parameter}"] == 0.0:
        return dict(best)
    name, q = f"{entry.name}.{entry.size_parameter}", entry.size
    value = _stepped(lambda v: cost(dict(best) | {name: v}), best[name], q, least)
    return dict(best) | {name: value}


def _stepped(
    cost: Callable[[float], float], here: float, q: Parameter, least: float, step: float = _STEP
) -> float:
    """Go on from a value in steps, up or down, as long as that gains."""
    for factor in (step, 1.0 / step):
        moved = False
        for _ in range(_STEPS):
            value = float(np.clip(factor * here, q.lower, q.upper))
            now = cost(value) if value != here else math.inf
            if not now < least:
                break
            least, here, moved = now, value, True
        if moved:
            break
    return here


def _between(cost: Callable[[float], float], here: float, q: Parameter, enough: float) -> float:
    """Return the best value within a step of one, if it promises to gain enough."""
    for step in (_STEP, math.sqrt(_STEP)):
        points = [
            float(np.clip(v, q.lower, q.upper)) for v in (1.0 / step * here, here, step * here)
        ]
        costs = [cost(v) for v in points]
        if points[0] < here < points[2] and all(map(math.isfinite, costs)):
            break
    else:
        return here
    x = np.log(points)
    # A parabola a x^2 + b x gains b^2 / (4 a) at its lowest point.
    curvature, slope, _ = np.polyfit(x - x[1], costs, 2)
    if curvature <= 0.0 or slope**2 < 4.0 * curvature * enough:
        return here
    place, least = least_between(lambda v: cost(math.exp(v)), x[0], x[2], _FINEST, _FINE)
    return math.exp(place) if least < costs[1] else here


def _scanned(cost: Callable[[float], float], here: float, q: Parameter) -> float:
    """Return the best value within a step of one, of a cost that jumps from value to value."""
    reach = math.log(_STEP)
    for _ in range(_SCANS):
        points = here * np.exp(np.linspace(-reach, reach, _SCANNED))
        here = min((float(np.clip(v, q.lower, q.upper)) for v in points), key=cost)
        reach /= 0.5 * (_SCANNED - 1)
    return here


def tuned(
    entry: Hypothesis, fit: ProcessNoiseFit, fit_on: Sequence[Observed], enough: float = _NEARER
) -> Hypothesis:
    """Improve what no refit changes and whose usual value is a guess, such as a rounded step.

    Args:
        enough: Log likelihood (dimensionless) that a better value has to gain.

    Returns:
        The effect with better values; itself where there are none.
    """
    model = fit.model
    guessed = [q for q in entry.effect.parameters if is_guess(q) and q.name != entry.size_parameter]
    if not guessed:
        return entry
    timed = {q.unit for q in entry.effect.parameters if q.name == entry.effect.about.moment}
    better: dict[str, float] = {}

    def cost(name: str, value: float) -> float:
        valued = model.with_parameters({f"{entry.name}.{name}": value})
        try:
            # What is steeper takes shorter steps.
            filter_ = filter_of(valued, fit_on[0], fit.noise_scale)
            return sum(part.cost for part in filter_.along(fit_on, valued.values))
        except NumericalError:
            return math.inf

    for q in guessed:
        of = functools.cache(functools.partial(cost, q.name))
        here = model.parameter(f"{entry.name}.{q.name}").value
        least = of(here) - enough
        value = _stepped(of, here, q, least)
        if value == here:
            value = _stepped(of, here, q, least, _LEAP)
            if value != here:
                value = _stepped(of, value, q, of(value))
        # Only what is followed is worth so many runs.
        jagged = q.name == entry.effect.about.tells and enough <= _NEARER
        value = _scanned(of, value, q) if jagged else _between(of, value, q, enough)
        # The width of an event that changes little waits for its time, which moves with it.
        crawls = q.unit in timed and abs(math.log(value / here)) < _CRAWL
        if of(value) < least and not crawls:
            better[q.name] = value
    return _valued(entry, better) if better else entry


def _sharper(entry: Hypothesis) -> Hypothesis:
    """Narrow a transition at a fitted place, which moves while it narrows; to be refitted.

    Returns:
        The effect with transitions a third as wide; itself where none has a place that is fitted.
    """
    own = entry.effect.parameters
    placed = {q.unit for q in own if q.fitted and q.name != entry.size_parameter}
    values = {
        q.name: max(q.value / _STEP, q.lower)
        for q in own
        if is_guess(q) and q.unit in placed and q.value > q.lower
    }
    return _valued(entry, values) if values else entry


def _valued(entry: Hypothesis, values: Mapping[str, float]) -> Hypothesis:
    return replace(entry, effect=entry.effect.with_parameters(dict(values)))


def _followed(race: Race, first: Candidate, before: Vector | None) -> Candidate:
    """Go on from a first refit with more trust in the equations, and judge on held-out data."""
    assert first.fit is not None
    try:
        return _judged_on(race, first, before)
    except Exception as error:  # noqa: BLE001
        # Whatever a law does, its failure must not end the diagnosis.
        return replace(untried(first.entry, error), followed=True)


def _judged_on(race: Race, first: Candidate, before: Vector | None) -> Candidate:
    assert first.fit is not None
    base, hold_out = race.base, race.hold_out
    entry, fit = first.entry, first.fit
    # An effect may take over from another one of the same law.
    before_it = f"{fit.model.effects[-1].name}."
    ended = {
        f"{entry.name}.{k.removeprefix(before_it)}" if k.startswith(before_it) else k: v
        for k, v in fit.refit.values.items()
    }
    entry, fit, started = in_turn(race, entry, ended, fit.noise_scale, sharper=True)
    for last in (not is_event(entry.effect), True):
        (effect,) = with_own_starts((entry.effect,), fit, base.model, race.fit_on, hold_out)
        if effect is entry.effect:
            break
        ended = fit.refit.values
        ended |= changed_values(fit.model, (entry.effect,), (effect,))
        entry = replace(entry, effect=effect)
        if level_everywhere(effect) is not None:
            return replace(first, refused="it is the same in all recordings", rule=SAME_LEVELS)
        if last:
            entry, fit, started = in_turn(race, entry, ended, fit.noise_scale, times=0)
            break
        # Told one time for all recordings an event came slowly; told more, it may be sharp, and
        # what is sharp tells its times better; what gained nothing by its own times is no event.
        told_once = fit.cost
        entry, fit, started = in_turn(race, entry, ended, fit.noise_scale, sharper=True)
        if fit.cost > told_once - _NEARER:
            break
    run = _closest_errors(fit, base.model, race.fit_on, hold_out)
    blocks = (blocks_of_cost(fit, started),)
    judged = Candidate(entry, fit, base.cost - fit.cost, blocks=blocks, run=run)
    if before is None:
        return judged
    judging = [extended_start(r, base.model, fit.model) for r in hold_out]
    held_out, unseen = held_out_gain(before, fit, judging)
    shift = _shift(entry, fit, base.model, hold_out[0])
    return replace(judged, held_out=held_out, shift=shift, blocks=(*blocks, unseen))


def in_turn(
    race: Race,
    entry: Hypothesis,
    begin: Mapping[str, float],
    noise_scale: float,
    *,
    ladder: Sequence[float] = (),
    enough: float = _NEARER,
    times: int = _WIDENINGS,
    sharper: bool = False,
) -> tuple[Hypothesis, ProcessNoiseFit, list[Observed]]:
    """Refit an effect, and what no refit changes in it, in turn as long as that gains.

    Args:
        begin: Values with which it begins, by name, in SI.
        noise_scale: Process-noise scale with which it begins, dimensionless.
        ladder: Scales, dimensionless, of which every refit begins with the first; all that are no
            larger than where the one before ended if empty.
        enough: Log likelihood that a further refit has to gain, dimensionless.
        times: How often bounds are widened and guesses tuned at most.
        sharper: Whether transitions are narrowed too.
    """
    best: tuple[Hypothesis, ProcessNoiseFit, list[Observed]] | None = None
    for turn in range(times + 1):
        model, started = _started(race, entry)
        try:
            fit = fit_with_process_noise(
                model,
                started,
                (*race.priors, *entry_priors(entry)[0]),
                start=begin,
                noise_scale=noise_scale,
                ladder=ladder or LADDER,
                enough=enough,
            )
        except NumericalError:
            if best is None:
                raise
            # What was tuned or widened cannot be integrated; what was before can.
            break
        if best is not None and fit.cost > best[1].cost - enough:
            break
        best, begin = (entry, fit, started), fit.refit.values
        noise_scale = ladder[0] if ladder else fit.noise_scale
        if turn == times:
            break
        interval = started[0].sample_time
        other = in_step(entry, begin, interval)
        if other is entry:
            other = widened(entry, fit, interval) or tuned(entry, fit, started, enough)
        if other is entry and sharper:
            other = _sharper(entry)
        if other is entry and (fit.refit.converged or not sharper):
            break
        entry = other
    assert best is not None
    return best


def _closest_errors(
    fit: ProcessNoiseFit, nominal: Model, fit_on: Sequence[Observed], hold_out: Sequence[Observed]
) -> RunErrors:
    """Return the errors of the runs of a fit, each model with the values that run closest."""
    return run_errors(closest_runs(fit, nominal, fit_on, hold_out), nominal, hold_out)


def _shift(entry: Hypothesis, fit: ProcessNoiseFit, base: Model, observed: Observed) -> float:
    """Return how far the effect moves an output in free runs, over the noise."""
    if entry.replaces:
        return math.nan
    absent = fit.model.with_parameters(entry.absent)
    begun = extended_start(observed, base, fit.model)
    try:
        parts = windows(fit.model, fit.model, begun) if observed.diverges else [begun]
    except NumericalError:
        return math.inf
    runs = [
        (as_recorded(free_run(fit.model, part), part, observed), free_run(absent, part))
        for part in parts
    ]
    if not all(run.finite for pair in runs for run in pair):
        return math.inf
    apart = np.concatenate([one.simulated - other.simulated for one, other in runs])
    moved = np.sqrt(np.nanmean(apart**2, axis=0))
    return float(np.max(moved / observed.noise_rms))
