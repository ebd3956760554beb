"""Choosing the hypotheses that are worth a full refit."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.diagnosis.selection.score import Score, Scores
from workbench.diagnosis.selection.task import Task
from workbench.model import Model
from workbench.physics.library import Hypothesis

LEAST_SCORE = 8.0
"""Expected gain of log likelihood below which an effect is not refitted."""

_LEADERS, _LEADS = 2, 0.5
"""How many of the best scores are refitted even if stiff, and the score over the best one from
which on others are too."""

_NEARLY = 0.8
"""Score over the best one at a place from which on a law with fewer parameters may be as good:
scores are derivatives at size zero (a bent angle 1,780, one that is off 1,681; refitted the second
gains more)."""

MOST_AT_FIRST, MOST_AGAIN = 18, 8
"""Laws that are refitted for their score, before and after the first one was found."""

_STIFF = 5
"""Laws that are refitted in the time of a stiff one."""

_BUDGET = 6000
"""Work that laws beyond the best scores may take together: each costs the square of the number of
states times that of free parameters. A plant of two states has room for all, the arm for nine."""


def shortlist(scores: Scores, *, most: int) -> tuple[Score, ...]:
    """Choose the hypotheses that are worth a full refit.

    The best score with its look-alikes, then the best of every other group of ports, then what is
    simpler than that and scores nearly as well; the best law of one parameter at each sensor, which
    is located nowhere; and what is the same in all recordings of those that have one level in each.
    """
    worthy = [s for s in scores.scores if s.gain > LEAST_SCORE and s.testable]
    if not worthy:
        return ()
    chosen = [worthy[0]]
    alike = scores.look_alikes(worthy[0].entry.name, above=0.9)
    others = [s for s in worthy[1:] if s.entry.name in alike]
    best = {where(score.entry): score for score in reversed(worthy)}
    others += [score for score in worthy[1:] if best[where(score.entry)] is score]
    others += [score for score in worthy[1:] if _simpler(score, best[where(score.entry)])]
    others += worthy[1:]
    for score in others:
        # A stiff effect takes the time of several others: only a leader is worth it.
        leads = score in worthy[:_LEADERS] or score.gain >= _LEADS * worthy[0].gain
        slow = score.entry.stiff and not leads
        if score not in chosen and not slow and len(chosen) < most:
            chosen.append(score)
    single = {
        where(s.entry): s for s in reversed(worthy) if s.entry.group == "sensor" and _is_single(s)
    }
    chosen += [s for s in single.values() if s not in chosen]
    return (*chosen, *(s for s in worthy if s not in chosen and any(_plain(s, c) for c in chosen)))


def _is_single(score: Score) -> bool:
    """Whether the size of a law is all that is refitted of it, and it remembers nothing."""
    return _own(score) == 1 and not score.entry.effect.states


def _plain(score: Score, other: Score) -> bool:
    """Whether a law is the same in all recordings as another is with one level in each.

    Levels that differ score higher, and are refused where they turn out to be the same.
    """
    one, by_recording = score.entry.effect, other.entry.effect
    told = by_recording.about.level and score.entry.law in by_recording.about.look_alikes
    return told and one.ports == by_recording.ports and not one.states


def _simpler(score: Score, best: Score) -> bool:
    return _own(score) < _own(best) and score.gain >= _NEARLY * best.gain


def _own(score: Score) -> int:
    return sum(q.fitted for q in score.entry.effect.parameters)


def where(entry: Hypothesis) -> tuple[str, ...]:
    """Return the components on whose ports an effect acts, which location cannot split.

    Returns:
        Parts of the ports' names before the dot, each once.
    """
    return tuple(dict.fromkeys(port.split(".")[0] for port in entry.ports))


def to_refit(
    task: Task, scores: Scores, most: int, model: Model, *, quiet: bool
) -> tuple[tuple[Score, ...], tuple[Score, ...]]:
    """Choose what is refitted first: the best scores, and the laws of the located groups.

    The score is a derivative at size zero. It orders, but of a law whose derivative vanishes
    there, or whose effect the refitted parameters have taken over, it tells nothing.

    Args:
        model: The model beside which they are refitted.
        quiet: Whether the model without an effect runs to the noise. What its parameters took over
            is then not missing: only what scores is refitted, at the located groups half as much as
            the best, and that of which a score cannot tell.

    Returns:
        What to refit, first what the recordings themselves show, and what is left for the case
        that nothing of it explains the recordings.
    """
    evident = [s for s in scores.scores if s.entry.evident]
    chosen = [*evident, *(s for s in shortlist(scores, most=most) if s not in evident)]
    leading = [s for s in scores.scores if s.entry.name in scores.leading and s not in chosen]
    chosen += [s for s in leading if not s.entry.stiff and s.gain > LEAST_SCORE]
    groups = {port.name: port.group for port in task.base.model.ports}
    alone = task.location.alone if task.location else {}
    most_alone = max(alone.values(), default=0.0)
    located = {group for group, gain in alone.items() if gain > 0.0 and gain >= 0.5 * most_alone}
    room = room_for(task, most, model)
    rest = [s for s in scores.scores if s not in chosen]
    moved = _moved(task.base.model)
    reach = {state for port, own in moved.items() if groups[port] in located for state in own}

    def acts_here(port: str) -> bool:
        # At a command no unknown input was tried: it is where what it drives at once is.
        group = groups.get(port)
        return group in located or (group not in alone and bool(moved.get(port, set()) & reach))

    here = [s for s in rest if any(map(acts_here, s.entry.ports))]
    # A law whose derivative at size zero tells nothing is tried wherever it may be; that a sensor
    # is late is located nowhere.
    far = [s for s in rest if s.entry.far and (s in here or s.entry.group == "sensor")]
    best = max((s.gain for s in scores.scores), default=0.0)
    least = max(LEAST_SCORE, _LEADS * best) if quiet else 0.0
    taken = [*far, *within([s for s in here if s not in far and s.gain >= least], room)]
    if quiet:
        return (*chosen, *taken), ()
    elsewhere = [s for s in rest if s not in here and s not in far]
    # A small plant has room for the whole library, wherever the mismatch was located.
    later = tuple(elsewhere) if within(rest, room) == rest else ()
    return (*chosen, *taken), later


def _moved(model: Model) -> dict[str, set[int]]:
    """Return the numbers of the states whose rates each port enters at once."""
    raised = model.exact.rates_by_port
    return {
        port.name: {i for i in range(raised.size1()) if not raised[i, k].is_zero()}
        for k, port in enumerate(model.ports)
    }


def room_for(task: Task, most: int, model: Model) -> float:
    """Return for how many laws, dimensionless, there is room beside so many of the best scores.

    Args:
        model: The model with what was found: stiff laws in it make every refit longer.
    """
    cost = max(len(task.base.model.states), 1) ** 2 * (len(task.priors) + 1)
    return _BUDGET * most / MOST_AT_FIRST / cost / task.longer(model)


def within(scores: Sequence[Score], room: float) -> list[Score]:
    """Return the first scores that there is room for; a stiff law takes that of several.

    Args:
        room: For how many laws there is room, dimensionless.
    """
    taken = []
    for score in scores:
        needed = _STIFF if score.entry.stiff else 1
        if needed <= room:
            taken.append(score)
            room -= needed
    return taken
