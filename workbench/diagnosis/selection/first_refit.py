"""The first refit of a hypothesis: from several places, kept from where it came furthest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.diagnosis.estimation.prediction_error import filter_of
from workbench.diagnosis.estimation.priors import entry_priors, entry_start, is_guess
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    ProcessNoiseFit,
    extended_start,
    start_values,
)
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.refit_in_turn import Basis, in_step, in_turn, valued
from workbench.diagnosis.selection.rules import SURPASSED, UNTRIED
from workbench.diagnosis.selection.scalar_search import stepped, walked
from workbench.diagnosis.selection.score import COLLINEAR, Score, reason_of
from workbench.errors import NumericalError
from workbench.physics.library import Hypothesis

STEEP = (3.0, 0.3, 0.03)
"""Process-noise scales of a refit that begins far from where the last one ended."""

_SIZES = (0.3, 1.0, 3.0)
"""Multiples of the usual size from which a refit may start."""

_PARTS = (0.1, 0.3)
"""Parts of the largest size from which a refit starts of which small sizes tell nothing."""


class _Way(NamedTuple):
    """From where a refit begins, and how much it trusts the equations.

    Args:
        ladder: Process-noise scales, falling.
        known: Values of the free parameters of the model without the effect, in SI.
        starts: Starts to choose from; several sizes of the effect if empty.
        shapes: Whether several shapes of the effect are tried too.
    """

    ladder: tuple[float, ...]
    known: dict[str, float]
    starts: tuple[dict[str, float], ...] = ()
    shapes: bool = False


def first_refit(
    basis: Basis,
    score: Score,
    enough: float,
    begun: Candidate | None = None,
    least: float = 0.0,
) -> Candidate:
    """Refit a hypothesis, the equations trusted as much as without it.

    Args:
        enough: A step that gains less log likelihood than this ends it, dimensionless.
        begun: An earlier refit, from where it goes on.
        least: Gain of the first way, dimensionless, up to which no other is tried, beside what
            explains nearly all.
    """
    base, entry = basis.base, score.entry
    usual = start_values(base.refit, basis.priors)
    ways = [_Way((base.noise_scale,), usual)]
    # What is either there or not has no small size at which anything could be told of it.
    far = entry.far or entry.replaces
    if begun is not None and begun.fit is not None:
        ended = begun.fit.refit.values
        ways = [_Way((begun.fit.noise_scale,), {}, (usual | ended, ended | usual))]
        score = replace(score, entry=begun.entry, shape={})
    else:
        # Without the effect, the free parameters have gone where they reproduce it best, from where
        # one that is far may not be found; where recordings are short, nobody waits for more ways.
        means = {q.name: q.mean for q in basis.priors}
        if basis.thorough or far or any(e.on_bound for e in base.refit.estimates):
            ways.append(_Way(STEEP, means, shapes=True))
        if basis.thorough:
            ways.append(_Way((base.noise_scale,), means, shapes=True))
        if entry.far and score.collinearity >= COLLINEAR and not entry.replaces:
            # Other parameters are such a law at small sizes: begin at large ones.
            own, largest = entry_start(entry) | means, entry.size.upper
            if math.isfinite(largest):
                ways += [_Way(STEEP, {}, (own | {entry.size_name: k * largest},)) for k in _PARTS]
    length = max((len(r.outputs) for r in basis.fit_on), default=0)
    found: list[Candidate] = []
    failed: Exception | None = None

    def go(way: _Way, tried: Score) -> None:
        nonlocal failed
        try:
            entry, fit = _refitted(basis, tried, way, enough)
        except Exception as error:  # noqa: BLE001
            # Whatever a law does, its failure must not end the diagnosis.
            failed = error
        else:
            gain = basis.gain(fit)
            found.append(
                Candidate(entry, fit, gain, refused=SURPASSED, followed=False, length=length)
            )

    for way in ways:
        go(way, score)
        if not far and begun is None and found and found[0].gain < least:
            return found[0]
    if all(c.gain < 0.0 for c in found) and not score.entry.replaces:
        # All lead to what is worse than no effect at all: begin from there too.
        own = entry_start(score.entry, score.size) | base.refit.values
        go(_Way((base.noise_scale,), {}, (own, own | {score.entry.size_name: 0.0})), score)
    if not found:
        assert failed is not None
        return untried(score.entry, failed)
    best = max(found, key=lambda c: c.gain)
    if begun is None and best.fit is not None:
        # What no refit changes was chosen at size zero, which tells little of it; so does a refit
        # under which the equations stay as imperfect as without the effect.
        ended, trusted = best.fit.refit.values, best.fit.noise_scale
        further = (trusted, *(s for s in LADDER if s < trusted))
        onward = _Way(further, {}, (ended, ended | usual))
        for other in variants(best.entry):
            go(onward, replace(score, entry=other, shape={}))
        if max(c.gain for c in found) > best.gain:
            # Trusted as much, it may be the better one.
            go(onward, replace(score, entry=best.entry, shape={}))
    return max(found, key=lambda c: c.gain)


def untried(entry: Hypothesis, why: Exception | str) -> Candidate:
    """Return a candidate that could not be tried: a line, not the end of a diagnosis."""
    text = f"it could not be tried, because {why if isinstance(why, str) else reason_of(why)}"
    return Candidate(entry, None, -math.inf, refused=text, followed=False, rule=UNTRIED)


def _refitted(
    basis: Basis, score: Score, way: _Way, enough: float
) -> tuple[Hypothesis, ProcessNoiseFit]:
    """Refit one hypothesis from one start, widening the bounds that it ends on."""
    fitted = {q.name for q in score.entry.effect.parameters if q.fitted}
    shape = {name: value for name, value in score.shape.items() if name in fitted}
    entry = valued(score.entry, score.shape)
    begin = _likeliest_start(basis, replace(score, entry=entry, shape=shape), way)
    entry = in_step(entry, begin, basis.fit_on[0].sample_time)
    return in_turn(basis, entry, begin, way.ladder[0], ladder=way.ladder, enough=enough)[:2]


def _likeliest_start(basis: Basis, score: Score, way: _Way) -> dict[str, float]:
    """Return the start under which a recording, the one that shows the effect, is most likely.

    From the best of several sizes it goes on in steps as long as that gains.
    """
    entry, observed = score.entry, basis.fit_on[score.clearest]
    model, started = basis.with_effect(entry)
    free = [p.name for p in (*basis.priors, *entry_priors(entry))]
    filter_ = filter_of(model, started[score.clearest], way.ladder[0], free)

    def cost(start: Mapping[str, float]) -> float:
        trial, seen = model.with_parameters(start), started[score.clearest]
        timed = in_step(entry, start, observed.sample_time)
        if timed is not entry:
            trial = trial.with_parameters(timed.advanced)
            seen = extended_start(observed, basis.base.model, trial)
        try:
            return filter_.run(seen, trial.values).cost
        except NumericalError:
            return math.inf

    own = entry_start(entry, score.size) | way.known
    starts = way.starts or _starts(score, own, shapes=way.shapes)
    least, best = min(((cost(start), start) for start in starts), key=lambda pair: pair[0])
    name = entry.size_name
    if entry.replaces or way.starts or best[name] == 0.0:
        return best

    def sized(value: float) -> float:
        return cost(best | {name: value})

    size = stepped(sized, best[name], entry.size, least)
    if entry.advanced:
        # Of a delay only a sample or two are seen from where it begins.
        size = walked(sized, size, entry.size, 0.5 * observed.sample_time)
    return best | {name: size}


def _starts(score: Score, start: dict[str, float], *, shapes: bool) -> list[dict[str, float]]:
    """From where to refit: the size that the score expects, and usual ones; or several shapes.

    The score is a derivative at size zero, which for a large effect tells little of its size.
    """
    entry, name = score.entry, score.entry.size_name
    if entry.replaces:
        # The size of a law that is either there or not says nothing of its shape.
        ordered = sorted(entry.shapes, key=lambda shape: shape != score.shape)
        return [start | _named(entry, shape) for shape in ordered]
    signs: tuple[float, ...] = (1.0,)
    if start[name]:
        signs = (math.copysign(1.0, start[name]),)
    elif entry.signed:
        signs = (1.0, -1.0)
    sizes = [start[name], *(s * k * entry.typical_size for s in signs for k in _SIZES)]
    low, high = entry.size.lower, entry.size.upper
    tried = [_named(entry, score.shape)]
    if shapes:
        for each in entry.shapes:
            # What no refit may change of a shape stays as it was scored.
            other = {k: v for k, v in _named(entry, each).items() if k in start}
            if other not in tried:
                tried.append(other)
    return [start | shape | {name: float(np.clip(s, low, high))} for shape in tried for s in sizes]


def _named(entry: Hypothesis, shape: Mapping[str, float]) -> dict[str, float]:
    return {f"{entry.name}.{name}": value for name, value in shape.items()}


def variants(entry: Hypothesis, *, guessed: bool = True) -> list[Hypothesis]:
    """Return an effect with the other shapes that no refit changes, such as a sampled filter.

    Args:
        guessed: Whether with those, too, that are guesses, which may be tuned.
    """
    own = entry.effect.parameters
    fixed = {q.name: q.value for q in own if not q.fitted and (guessed or not is_guess(q))}
    found: list[dict[str, float]] = []
    for shape in entry.shapes:
        other = {k: v for k, v in shape.items() if k in fixed}
        if any(fixed[k] != v for k, v in other.items()) and other not in found:
            found.append(other)
    return [valued(entry, other) for other in found]
