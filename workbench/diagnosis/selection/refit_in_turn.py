"""Refitting an effect with the free parameters, and in turn what no refit changes in it."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.priors import Prior, entry_priors, is_guess
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    ProcessNoiseFit,
    extended_start,
    fit_with_process_noise,
)
from workbench.diagnosis.selection.rules import WIDER
from workbench.diagnosis.selection.scalar_search import STEP, between, scanned, stepped
from workbench.errors import NumericalError
from workbench.model import Model, Parameter
from workbench.physics.library import Hypothesis

NEARER = 1.0
"""A step that gains less log likelihood than this ends the refit of what is followed."""

_CRAWL = 0.25
"""Change of the logarithm of an event's width below which another one would follow at once."""

_LEAP = 100.0
"""Factor of a step from a guess that small steps do not improve: where a reversal is far sharper or
rounder than what was sampled, they change nothing."""

_SPARE, _LITTLE = 4, 0.1
"""Samples of a delay that its equations have again where it may be shorter than was moved; part of
one that they may have more or less than a whole one."""

WIDENINGS = 4
"""How often a bound is widened that a solution sits on."""


class Basis(NamedTuple):
    """What every refit of an effect begins with.

    Args:
        base: The fitted model without the effect.
        fit_on: Fitting recordings, with a start for the model of ``base``.
        known: Minus the logarithm of the priors, which the cost of a refit has too, dimensionless.
        thorough: Whether refits on short recordings begin from more places.
        costs: Cost of the base on these recordings, dimensionless: as it is, and refitted to them
            with more trust in its equations, where they bear that.
    """

    base: ProcessNoiseFit
    priors: tuple[Prior, ...]
    fit_on: Sequence[Observed]
    known: float = 0.0
    jobs: int = 1
    thorough: bool = True
    costs: tuple[float, float] = (0.0, 0.0)

    @property
    def samples(self) -> int:
        """Samples of all its recordings."""
        return sum(len(r.outputs) for r in self.fit_on)

    def gain(self, fit: ProcessNoiseFit) -> float:
        """Return what a fit gains over the base trusted as much, dimensionless."""
        return self.costs[fit.noise_scale < self.base.noise_scale] - fit.cost

    def with_effect(self, entry: Hypothesis) -> tuple[Model, list[Observed]]:
        """Return the model with an effect, at size zero, and fitting recordings with its start."""
        model = self.base.model.with_effect(entry.at_size(1.0 if entry.replaces else 0.0))
        return model, self.started(self.fit_on, model)

    def started(self, recordings: Sequence[Observed], model: Model) -> list[Observed]:
        """Return recordings with a start for a model with an effect attached."""
        return [extended_start(r, self.base.model, model) for r in recordings]


def valued(entry: Hypothesis, values: Mapping[str, float]) -> Hypothesis:
    """Return an effect with other values of its parameters by short name, in their units."""
    return replace(entry, effect=entry.effect.with_parameters(dict(values))) if values else entry


def in_turn(
    basis: Basis,
    entry: Hypothesis,
    begin: Mapping[str, float],
    noise_scale: float,
    *,
    ladder: Sequence[float] = (),
    enough: float = NEARER,
    times: int = WIDENINGS,
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
        model, started = basis.with_effect(entry)
        try:
            fit = fit_with_process_noise(
                model,
                started,
                (*basis.priors, *entry_priors(entry)),
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
            other = widened(entry, fit, interval)
        if other is entry:
            other = tuned(entry, fit, started, enough)
        if other is entry and sharper:
            other = _sharper(entry)
        if other is entry and (fit.refit.converged or not sharper):
            break
        entry = other
    assert best is not None
    return best


def in_step(entry: Hypothesis, values: Mapping[str, float], interval: float) -> Hypothesis:
    """Return an effect with the whole samples of its delay taken by the recordings.

    Its equations have what is left, less than a sample. Where that leads the way it goes on below.

    Args:
        values: Values with which a refit begins or ended, by name, in SI.
        interval: Sampling interval of the recordings, in s.
    """
    late = values.get(entry.size_name)
    if not entry.advanced or late is None:
        return entry
    (now,) = entry.advanced.values()
    shortest = late <= now + entry.size.lower
    if not shortest and late < now + (1.0 + _LITTLE) * interval:
        return entry
    # On its lower bound it may be shorter by far: the equations have some samples again.
    spare = _SPARE if shortest else 0.0
    moved = max(math.floor(late / interval - spare + _LITTLE), 0) * interval
    return entry if moved == now else valued(entry, {entry.effect.about.advance: moved})


def widened(entry: Hypothesis, fit: ProcessNoiseFit, interval: float) -> Hypothesis:
    """Return an effect with wider bounds where a refit ended on them; itself if it did on none.

    What is bounded by nature keeps its bound: zero, all of a whole, what is strict. A time does not
    go below the sampling interval, where nothing tells it from another law.

    Args:
        interval: Sampling interval of the recordings, in s.
    """
    effect = entry.effect
    ended = {} if entry.whole else {e.name: e.value for e in fit.refit.estimates if e.on_bound}
    own = [(q, ended.get(f"{effect.name}.{q.name}")) for q in effect.parameters]
    wider = tuple(
        q if value is None or q.strict else _wider(q, value, interval) for q, value in own
    )
    if wider == effect.parameters:
        return entry
    return replace(entry, effect=replace(effect, parameters=wider))


def _wider(q: Parameter, value: float, interval: float) -> Parameter:
    """Return a parameter with the bound widened on which a value is."""
    if q.upper - value < value - q.lower:
        upper = q.upper * WIDER if q.upper > 0.0 else q.upper / WIDER
        return q if q.unit == "1" and q.upper == 1.0 else replace(q, upper=upper)
    lower = q.lower * WIDER if q.lower < 0.0 else q.lower / WIDER
    lower = max(lower, min(interval, q.lower)) if q.unit == "s" else lower
    return q if q.lower == 0.0 or (q.unit == "1" and q.lower == -1.0) else replace(q, lower=lower)


def tuned(
    entry: Hypothesis, fit: ProcessNoiseFit, fit_on: Sequence[Observed], enough: float = NEARER
) -> Hypothesis:
    """Improve what no refit changes and whose usual value is a guess, such as a rounded step.

    Args:
        enough: Log likelihood (dimensionless) that a better value has to gain.

    Returns:
        The effect with better values; itself where there are none.
    """
    effect = entry.effect
    better: dict[str, float] = {}
    timed = {q.unit for q in effect.parameters if q.name == effect.about.moment}

    def cost(name: str, value: float) -> float:
        trial = fit.model.with_parameters({name: value})
        try:
            # What is steeper takes shorter steps.
            filter_ = filter_of(trial, fit_on[0], fit.noise_scale)
            return sum(part.cost for part in filter_.along(fit_on, trial.values))
        except NumericalError:
            return math.inf

    for q in effect.parameters:
        if not is_guess(q) or q.name == entry.size_parameter:
            continue
        name = f"{entry.name}.{q.name}"
        of = functools.cache(functools.partial(cost, name))
        here = fit.model.parameter(name).value
        least = of(here) - enough
        value = stepped(of, here, q, least)
        if value == here:
            value = stepped(of, here, q, least, _LEAP)
            if value != here:
                value = stepped(of, value, q, of(value))
        # Only what is followed is worth so many runs.
        jagged = q.name == effect.about.tells and enough <= NEARER
        value = scanned(of, value, q) if jagged else between(of, value, q, enough)
        # The width of an event that changes little waits for its time, which moves with it.
        crawls = q.unit in timed and abs(math.log(value / here)) < _CRAWL
        if of(value) < least and not crawls:
            better[q.name] = value
    return valued(entry, better)


def _sharper(entry: Hypothesis) -> Hypothesis:
    """Narrow a transition at a fitted place, which moves while it narrows; to be refitted.

    Returns:
        The effect with transitions a third as wide; itself where none has a place that is fitted.
    """
    own = entry.effect.parameters
    placed = {q.unit for q in own if q.fitted and q.name != entry.size_parameter}
    narrow = [q for q in own if is_guess(q) and q.unit in placed and q.value > q.lower]
    return valued(entry, {q.name: max(q.value / STEP, q.lower) for q in narrow})
