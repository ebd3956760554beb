"""Selecting effects: full refits of the best-scored hypotheses, accepted on held-out recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import joblib
import numpy as np

from workbench.diagnosis.likely import (
    LikelyFit,
    blocks_of_cost,
    extended_start,
    fit_likely,
    gain_interval,
    start_values,
)
from workbench.diagnosis.prediction_error import Observed
from workbench.diagnosis.priors import Prior
from workbench.diagnosis.refit_result import Estimate
from workbench.diagnosis.score import Score, Scores
from workbench.errors import NumericalError
from workbench.physics.library import Entry

LEAST_SCORE = 8.0
"""Expected gain of log likelihood below which an effect is not refitted."""

LEAST_GAIN = 15.0
"""Gain of log likelihood per effect that is asked for beyond the charge for the library."""

SIGMA = 3.0
"""Standard deviations by which a size must differ from zero."""

_FINALISTS = 2

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Candidate:
    """An effect refitted together with the free parameters.

    Args:
        entry: The effect in the library.
        fit: The refit; None if it failed.
        gain: Gain of log likelihood on the fitting recordings, dimensionless.
        held_out: Gain on the held-out recordings with its 99 % interval, dimensionless.
        refused: Why it was not accepted; empty if it was.
    """

    entry: Entry
    fit: LikelyFit | None
    gain: float
    held_out: tuple[float, float, float]
    refused: str = ""

    @property
    def size(self) -> Estimate | None:
        """Estimate of the size parameter; None if the refit failed or the size was held."""
        if self.fit is None or self.entry.replaces:
            return None
        return self.fit.refit.estimate(f"{self.entry.effect.name}.{self.entry.size_parameter}")

    def __str__(self) -> str:
        """Return one aligned line."""
        size = self.size
        text = "" if size is None else f"{size.value:.4g} +- {size.std:.2g} {size.unit}"
        return (
            f"{self.entry.name:<34} gain {self.gain:>10.1f}  held out"
            f" {self.held_out[0]:>10.1f} [{self.held_out[1]:.0f}, {self.held_out[2]:.0f}]"
            f"  {text}  {self.refused or 'accepted'}"
        )


def shortlist(scores: Scores, *, most: int = 6, least: float = LEAST_SCORE) -> tuple[Score, ...]:
    """Choose the hypotheses that are worth a full refit.

    The best score with its look-alikes, then the best of every other group of ports.

    Args:
        scores: Scores of the library.
        most: How many at the most.
        least: Expected gain of log likelihood below which an effect is left out, dimensionless.

    Returns:
        Scores to refit, best first.

    Example:
        >>> from workbench.diagnosis.example import made_up, pushes
        >>> from workbench.diagnosis.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> from workbench.diagnosis.score import score_library
        >>> from workbench.physics.library import library
        >>> axis = axis.without("coulomb_friction")
        >>> priors = default_priors(axis, ["mass"])
        >>> fit = fit_likely(axis, [seen], priors)
        >>> tried = [e for e in library(axis) if not e.stiff]
        >>> scores = score_library(fit.model, [seen], priors, tried, share=fit.share)
        >>> 1 <= len(shortlist(scores, most=3)) <= 3
        True
    """
    worthy = [s for s in scores.scores if s.gain > max(LEAST_SCORE, least) and s.testable]
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
        if score not in chosen and len(chosen) < most:
            chosen.append(score)
    return tuple(chosen)


def where(entry: Entry) -> tuple[str, ...]:
    """Return the components on whose ports an effect acts, which location cannot split.

    Args:
        entry: The effect in the library.

    Returns:
        Parts of the ports' names before the dot, each once.

    Example:
        >>> from workbench.physics.friction import coulomb_friction
        >>> where(Entry(coulomb_friction(level=0.0), "level", 0.5, 0.05))
        ('joint',)
    """
    return tuple(dict.fromkeys(port.split(".")[0] for port in entry.ports))


def refit_candidates(
    base: LikelyFit,
    chosen: Sequence[Score],
    priors: Sequence[Prior],
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
    *,
    charge: float,
    least_gain: float = 0.0,
    jobs: int = 2,
    progress: Progress | None = None,
) -> tuple[Candidate, ...]:
    """Refit each hypothesis together with the free parameters.

    Args:
        base: The fitted model without the effects.
        chosen: Scores of the effects to refit.
        priors: Priors of the free parameters of ``base``.
        fit_on: Fitting recordings, with a start for the model of ``base``.
        hold_out: Held-out recordings, likewise.
        charge: Log likelihood that an effect must gain for its parameters and for the size of
            the library, dimensionless.
        least_gain: Log likelihood that it must gain to explain enough of the excess, dimensionless.
        jobs: Number of processes.
        progress: Called with a line of text.

    Returns:
        Candidates by falling gain, each accepted or refused with the reason.

    Example:
        >>> from workbench.diagnosis.example import made_up, pushes
        >>> from workbench.diagnosis.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> from workbench.diagnosis.score import score_library
        >>> from workbench.physics.library import library
        >>> axis = axis.without("coulomb_friction")
        >>> priors = default_priors(axis, ["mass"])
        >>> fit = fit_likely(axis, [seen], priors)
        >>> tried = [e for e in library(axis) if not e.stiff]
        >>> scores = score_library(fit.model, [seen], priors, tried, share=fit.share)
        >>> best = refit_candidates(
        ...     fit, shortlist(scores, most=1), priors, [seen], [seen], charge=20.0, jobs=1
        ... )[0]
        >>> best.entry.name == scores.scores[0].entry.name, best.gain > 20.0
        (True, True)
    """
    if progress and chosen:
        progress("refitting with " + ", ".join(s.entry.name for s in chosen))
    with joblib.Parallel(n_jobs=jobs if len(chosen) > 1 else 1) as parallel:
        shared = (tuple(priors), tuple(fit_on), tuple(hold_out))
        first = parallel(
            joblib.delayed(_candidate)(base, score, *shared, False) for score in chosen
        )
        # Only the leaders are followed down the ladder: a hypothesis that cannot compete with the
        # equations as imperfect as they were does not overtake with more trust in them.
        order = sorted(range(len(chosen)), key=lambda i: -first[i].gain)[:_FINALISTS]
        if progress and order:
            progress("comparing " + " and ".join(chosen[i].entry.name for i in order))
        finals = parallel(
            joblib.delayed(_candidate)(base, chosen[i], *shared, True, first[i].fit) for i in order
        )
    for i, final in zip(order, finals, strict=True):
        first[i] = final
    judged = [replace(c, refused=_refusal(c, charge, least_gain)) for c in first]
    return tuple(sorted(judged, key=lambda c: -c.gain))


def entry_priors(score: Score) -> tuple[tuple[Prior, ...], dict[str, float]]:
    """Return the priors of an effect's own parameters and where to start them.

    Args:
        score: Score of the effect.

    Returns:
        Priors of the size and of the shape parameters that a refit may change, and starting
        values by name, in SI: the expected size, and the library's shape. The size of a law that
        is either there or not is held.

    Example:
        >>> from workbench.diagnosis.example import made_up, pushes
        >>> from workbench.diagnosis.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> from workbench.diagnosis.score import score_library
        >>> from workbench.physics.library import library
        >>> axis = axis.without("coulomb_friction")
        >>> priors = default_priors(axis, ["mass"])
        >>> fit = fit_likely(axis, [seen], priors)
        >>> tried = [e for e in library(axis) if not e.stiff]
        >>> scores = score_library(fit.model, [seen], priors, tried, share=fit.share)
        >>> own, start = entry_priors(scores.scores[0])
        >>> {prior.name for prior in own} == set(start)
        True
    """
    entry = score.entry
    priors, start = [], {}
    for q in entry.effect.parameters:
        name = f"{entry.name}.{q.name}"
        if q.name == entry.size_parameter and not entry.replaces:
            # A wide prior about zero: absence is as plausible as any size.
            priors.append(Prior(name, 0.0, entry.largest_size, q.lower, q.upper))
            start[name] = float(np.clip(score.size, q.lower, q.upper))
        elif q.fitted and math.isfinite(q.lower) and math.isfinite(q.upper):
            priors.append(Prior(name, q.value, (q.upper - q.lower) / 4, q.lower, q.upper))
            start[name] = q.value
    return tuple(priors), start


def _candidate(
    base: LikelyFit,
    score: Score,
    priors: tuple[Prior, ...],
    fit_on: tuple[Observed, ...],
    hold_out: tuple[Observed, ...],
    follow: bool,
    earlier: LikelyFit | None = None,
) -> Candidate:
    entry = score.entry
    model = base.model.with_effect(entry.at_size(1.0) if entry.replaces else entry.effect)
    own, start = entry_priors(score)
    fit_on_ = [extended_start(r, base.model, model) for r in fit_on]
    held_out = (0.0, -math.inf, math.inf)
    if earlier is not None:
        begins = [start | {e.name: e.value for e in earlier.refit.estimates}]
    else:
        # The size of a law that is either there or not says nothing of its shape: try several.
        start |= start_values(base.refit, priors)
        shapes = entry.shapes if entry.replaces else entry.shapes[:1]
        begins = [start | {f"{entry.name}.{k}": v for k, v in s.items()} for s in shapes]
    try:
        fit = min(
            (
                fit_likely(
                    model, fit_on_, (*priors, *own), start=begin, share=base.share, follow=follow
                )
                for begin in begins
            ),
            key=lambda found: found.cost,
        )
        if follow and hold_out:
            hold_out_ = [extended_start(r, base.model, model) for r in hold_out]
            held_out = gain_interval(blocks_of_cost(base, hold_out), blocks_of_cost(fit, hold_out_))
    except NumericalError as error:
        return Candidate(entry, None, -math.inf, held_out, str(error))
    refused = "" if follow else "another effect explains the recordings better"
    return Candidate(entry, fit, base.cost - fit.cost, held_out, refused)


def _refusal(candidate: Candidate, charge: float, least_gain: float) -> str:
    """Say which rule an effect breaks; empty if none."""
    entry, size = candidate.entry, candidate.size
    if candidate.refused or candidate.fit is None:
        return candidate.refused or "the refit failed"
    if not candidate.fit.refit.converged:
        return "the refit did not converge"
    if size is not None:
        if abs(size.value) < SIGMA * size.std:
            return f"its size is within {SIGMA:g} standard deviations of zero"
        if abs(size.value) < entry.least_size:
            return f"its size is below the smallest worth naming, {entry.least_size:g} {size.unit}"
        if abs(size.value) > 0.999 * entry.largest_size:
            return "its size is on its bound"
    if candidate.gain < charge:
        return f"it gains less than the charge for the library, {charge:.1f}"
    if candidate.gain < least_gain:
        return "it explains too little of what the model leaves out"
    if candidate.held_out[1] <= 0.0:
        return "it does not reliably improve the held-out recordings"
    return ""


def charge_for(library: int, samples: int, parameters: int) -> float:
    """Return the log likelihood that an effect must gain: parameters and size of the library.

    ``LEAST_GAIN + parameters log(samples) / 2 + log(library)``, after the extended Bayesian
    information criterion of Chen and Chen (2008).

    Args:
        library: Number of effects that were tried.
        samples: Number of independent samples.
        parameters: Own parameters of the effect.

    Returns:
        The charge, in units of log likelihood, dimensionless.

    Example:
        >>> round(charge_for(40, 1000, 1), 1)
        22.1
    """
    return LEAST_GAIN + 0.5 * parameters * math.log(samples) + math.log(library)
