"""Choosing the hypotheses that are worth a full refit."""

from __future__ import annotations

from workbench.diagnosis.selection.score import Score, Scores
from workbench.physics.library import Hypothesis

LEAST_SCORE = 8.0
"""Expected gain of log likelihood below which an effect is not refitted."""

_PLAIN = 500.0
"""Expected gain beyond which even an effect that is nearly absorbed is refitted."""

_LEADERS = 2
"""How many of the best scores are refitted even if stiff."""

_SIGMA = 3.0


def shortlist(scores: Scores, *, most: int = 18, least: float = LEAST_SCORE) -> tuple[Score, ...]:
    """Choose the hypotheses that are worth a full refit.

    The best score with its look-alikes, then the best of every other group of ports.

    Args:
        scores: Scores of the library.
        most: How many at the most.
        least: Expected gain of log likelihood below which an effect is left out, dimensionless.

    Returns:
        Scores to refit, best first.

    Example:
        >>> from workbench.diagnosis.estimation.made_up import made_up, pushes
        >>> from workbench.diagnosis.estimation.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
        >>> from workbench.diagnosis.selection.score import score_library
        >>> from workbench.physics.library import library
        >>> axis = axis.without("coulomb_friction")
        >>> priors = default_priors(axis, ["mass"])
        >>> fit = fit_with_process_noise(axis, [seen], priors)
        >>> tried = [e for e in library(axis) if not e.stiff]
        >>> scores = score_library(fit.model, [seen], priors, tried, noise_scale=fit.noise_scale)
        >>> 1 <= len(shortlist(scores, most=3)) <= 3
        True
    """
    worthy = [
        s
        for s in scores.scores
        if s.gain > max(LEAST_SCORE, least) and (s.testable or (least <= LEAST_SCORE and _plain(s)))
    ]
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


def _plain(score: Score) -> bool:
    """Whether an effect shows although parameters within their priors imitate nearly all of it."""
    return abs(score.sigma) > _SIGMA and score.gain > _PLAIN


def where(entry: Hypothesis) -> tuple[str, ...]:
    """Return the components on whose ports an effect acts, which location cannot split.

    Args:
        entry: The effect in the library.

    Returns:
        Parts of the ports' names before the dot, each once.

    Example:
        >>> from workbench.physics.friction import coulomb_friction
        >>> where(Hypothesis(coulomb_friction("joint.torque", level=0.0), "level", 0.5, 0.05))
        ('joint',)
    """
    return tuple(dict.fromkeys(port.split(".")[0] for port in entry.ports))
