"""Choosing the hypotheses that are worth a full refit."""

from __future__ import annotations

from workbench.diagnosis.selection.score import Score, Scores
from workbench.physics.library import Hypothesis

LEAST_SCORE = 8.0
"""Expected gain of log likelihood below which an effect is not refitted."""

_LEADERS = 2
"""How many of the best scores are refitted even if stiff."""


def shortlist(scores: Scores, *, most: int) -> tuple[Score, ...]:
    """Choose the hypotheses that are worth a full refit.

    The best score with its look-alikes, then the best of every other group of ports.

    Args:
        most: How many at the most.
    """
    worthy = [s for s in scores.scores if s.gain > LEAST_SCORE and s.testable]
    if not worthy:
        return ()
    chosen = [worthy[0]]
    alike = scores.look_alikes(worthy[0].entry.name, above=0.9)
    others = [s for s in worthy[1:] if s.entry.name in alike]
    seen = {where(worthy[0].entry)}
    for score in worthy[1:]:
        if where(score.entry) not in seen:
            seen.add(where(score.entry))
            others.append(score)
    others += worthy[1:]
    for score in others:
        # A stiff effect takes the time of several others: only a leader is worth it.
        slow = score.entry.stiff and score not in worthy[:_LEADERS]
        if score not in chosen and not slow and len(chosen) < most:
            chosen.append(score)
    return tuple(chosen)


def where(entry: Hypothesis) -> tuple[str, ...]:
    """Return the components on whose ports an effect acts, which location cannot split.

    Returns:
        Parts of the ports' names before the dot, each once.
    """
    return tuple(dict.fromkeys(port.split(".")[0] for port in entry.ports))
