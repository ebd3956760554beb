"""Selecting effects: full refits of the best-scored hypotheses, accepted on held-out recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import joblib
import numpy as np
import numpy.typing as npt

from workbench.diagnosis.estimation.prediction_error import Observed, PredictionError, disturbances
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import (
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    start_values,
)
from workbench.diagnosis.selection.candidate import Candidate
from workbench.diagnosis.selection.held_out import held_out_gain, runs_closer
from workbench.diagnosis.selection.rules import HELD_OUT, SURPASSED, Limits, broken_rule
from workbench.diagnosis.selection.score import Score
from workbench.diagnosis.selection.shortlist import LEAST_SCORE
from workbench.errors import NumericalError
from workbench.model import Model

Vector = npt.NDArray[np.float64]

_FINALISTS = 4
_MOST_SENSORS = 2

_HEAD_S = 10.0
"""Length of each recording that the first refit of a hypothesis uses, s."""

_NEAR = 10.0
"""A step that gains less log likelihood than this ends the first refit of a hypothesis."""

_NEARER = 1.0
"""The same for the refit of those that are followed."""

_STEEP = (3.0, 0.3, 0.03)
"""Process-noise scales of a refit that begins far from where the last one ended."""

_SIZES = (0.3, 1.0, 3.0)
"""Multiples of the usual size from which a refit may start."""

Progress = Callable[[str], None]


def refit_candidates(
    base: ProcessNoiseFit,
    chosen: Sequence[Score],
    priors: Sequence[Prior],
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
    *,
    limits: Limits,
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
        limits: What an effect must gain.
        jobs: Number of processes.
        progress: Called with a line of text.

    Returns:
        Candidates by falling gain, each accepted or refused with the reason.

    Example:
        >>> from workbench.diagnosis.estimation.made_up import made_up, pushes
        >>> from workbench.diagnosis.estimation.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> from workbench.diagnosis.selection.score import score_library
        >>> from workbench.physics.library import library
        >>> axis = axis.without("coulomb_friction")
        >>> priors = default_priors(axis, ["mass"])
        >>> fit = fit_with_process_noise(axis, [seen], priors)
        >>> tried = [e for e in library(axis) if not e.stiff]
        >>> scores = score_library(fit.model, [seen], priors, tried, noise_scale=fit.noise_scale)
        >>> from workbench.diagnosis.selection.shortlist import shortlist
        >>> best = refit_candidates(
        ...     fit, shortlist(scores, most=1), priors, [seen], [seen], limits=Limits(20.0), jobs=1
        ... )[0]
        >>> best.entry.name == scores.scores[0].entry.name, best.gain > 20.0
        (True, True)
    """
    if progress and chosen:
        progress("refitting with " + ", ".join(s.entry.name for s in chosen))
    given = (tuple(priors), tuple(fit_on))
    heads = [_head(r) for r in fit_on]
    # Minus the logarithm of the priors is in the cost of a refit too.
    known = base.cost - float(blocks_of_cost(base, fit_on).sum()) if chosen else 0.0
    cost = known + float(blocks_of_cost(base, heads).sum()) if chosen else 0.0
    with joblib.Parallel(n_jobs=jobs if len(chosen) > 1 else 1) as parallel:
        first = parallel(
            joblib.delayed(_first)(base, cost, score, tuple(priors), heads) for score in chosen
        )
        # Only the leaders are followed down the ladder: a hypothesis that cannot compete with the
        # equations as imperfect as they were does not overtake with more trust in them.
        leaders = _leaders(first)
        if progress and leaders:
            progress("comparing " + " and ".join(chosen[i].entry.name for i in leaders))
        before = blocks_of_cost(base, hold_out) if leaders and hold_out else None
        finals = parallel(
            joblib.delayed(_followed)(base, first[i], chosen[i], *given, tuple(hold_out), before)
            for i in leaders
        )
    for i, final in zip(leaders, finals, strict=True):
        first[i] = final
    judged = sorted((_judged(c, limits) for c in first), key=lambda c: -c.gain)
    for i, candidate in enumerate(judged):
        if not candidate.refused:
            break
        if _runs_closer(base, candidate, hold_out):
            judged[i] = replace(candidate, refused="", rule="")
            break
    best = next((c for c in judged if not c.refused), None)
    return tuple(c if c is best or c.refused else replace(c, refused=SURPASSED) for c in judged)


def _judged(candidate: Candidate, limits: Limits) -> Candidate:
    if candidate.refused:
        return candidate
    rule, said = broken_rule(candidate, limits)
    return replace(candidate, refused=said, rule=rule)


def _runs_closer(base: ProcessNoiseFit, candidate: Candidate, hold_out: Sequence[Observed]) -> bool:
    """Whether free runs show what single predictions leave open on the held-out recordings."""
    if candidate.rule != HELD_OUT.name or candidate.fit is None or candidate.held_out[0] <= 0.0:
        return False
    return runs_closer(base, candidate.fit, hold_out)


def _leaders(first: Sequence[Candidate]) -> list[int]:
    """Choose which hypotheses to follow, by their gain in the first refit.

    A lag or delay of a sensor imitates many a slow or springy part of the process, and does so at
    several sensors: of each such law one is followed, and two at the most. The best score is
    followed whatever its first refit gained.
    """
    order = sorted(range(len(first)), key=lambda i: -first[i].gain)
    worthy = [i for i in order if first[i].fit is not None and first[i].gain > LEAST_SCORE]
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
    if 0 in worthy and 0 not in leaders:
        leaders[-1] = 0
    return leaders


def entry_priors(score: Score) -> tuple[tuple[Prior, ...], dict[str, float]]:
    """Return the priors of an effect's own parameters and where to start them.

    Args:
        score: Score of the effect.

    Returns:
        Priors of the size and of the shape parameters that a refit may change, and starting
        values by name, in SI: the expected size, and the library's shape. The size of a law that
        is either there or not is held.

    Example:
        >>> from workbench.diagnosis.estimation.made_up import made_up, pushes
        >>> from workbench.diagnosis.estimation.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = made_up(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> from workbench.diagnosis.selection.score import score_library
        >>> from workbench.physics.library import library
        >>> axis = axis.without("coulomb_friction")
        >>> priors = default_priors(axis, ["mass"])
        >>> fit = fit_with_process_noise(axis, [seen], priors)
        >>> tried = [e for e in library(axis) if not e.stiff]
        >>> scores = score_library(fit.model, [seen], priors, tried, noise_scale=fit.noise_scale)
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


def _head(observed: Observed) -> Observed:
    count = max(1, round(_HEAD_S / observed.sample_time))
    return replace(observed, inputs=observed.inputs[:count], outputs=observed.outputs[:count])


def _first(
    base: ProcessNoiseFit,
    cost: float,
    score: Score,
    priors: tuple[Prior, ...],
    fit_on: Sequence[Observed],
) -> Candidate:
    """Refit a hypothesis, the equations trusted as much as without it."""
    entry = score.entry
    effect = entry.at_size(1.0) if entry.replaces else entry.at_size(0.0, score.shape)
    model = base.model.with_effect(effect)
    own, start = entry_priors(score)
    all_priors = (*priors, *own)
    fit_on_ = [extended_start(r, base.model, model) for r in fit_on]
    fits: list[ProcessNoiseFit] = []
    why = ""
    ways: list[tuple[dict[str, float], tuple[float, ...]]] = [
        (start_values(base.refit, priors), (base.noise_scale,))
    ]
    if entry.far:
        # Without the effect, the free parameters have gone where they imitate it best, from where
        # one that is far may not be found.
        ways.append(({q.name: q.mean for q in priors}, _STEEP))
    for known, ladder in ways:
        try:
            fits.append(
                fit_with_process_noise(
                    model,
                    fit_on_,
                    all_priors,
                    start=_best_start(
                        model,
                        fit_on_,
                        all_priors,
                        _starts(score, {**start, **known}, shapes=ladder is _STEEP),
                        ladder[0],
                    ),
                    noise_scale=ladder[0],
                    ladder=ladder,
                    enough=_NEAR,
                )
            )
        except NumericalError as error:
            why = str(error)
    unknown = (0.0, -math.inf, math.inf)
    if not fits:
        return Candidate(entry, None, -math.inf, unknown, why, followed=False)
    fit = min(fits, key=lambda one: one.cost)
    return Candidate(entry, fit, cost - fit.cost, unknown, SURPASSED, followed=False)


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
    sign = math.copysign(1.0, start[name]) if start[name] else 1.0
    sizes = [start[name], *(sign * k * entry.typical_size for k in _SIZES)]
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
    model: Model,
    fit_on: Sequence[Observed],
    priors: Sequence[Prior],
    starts: Sequence[dict[str, float]],
    noise_scale: float,
) -> dict[str, float]:
    """Return the start under which the first recording is most likely."""
    filter_ = PredictionError(
        model,
        fit_on[0].sample_time,
        fit_on[0].used,
        tuple(p.name for p in priors),
        disturbances(model, noise_scale),
    )

    def cost(start: Mapping[str, float]) -> float:
        try:
            return filter_.run(fit_on[0], model.with_parameters(start).values).cost
        except NumericalError:
            return math.inf

    return min(starts, key=cost) if len(starts) > 1 else starts[0]


def _followed(
    base: ProcessNoiseFit,
    first: Candidate,
    score: Score,
    priors: tuple[Prior, ...],
    fit_on: tuple[Observed, ...],
    hold_out: tuple[Observed, ...],
    before: Vector | None,
) -> Candidate:
    """Go on from a first refit with more trust in the equations, and judge on held-out data."""
    assert first.fit is not None
    entry, model = first.entry, first.fit.model
    own, _ = entry_priors(score)
    held_out = (0.0, -math.inf, math.inf)
    try:
        fit = fit_with_process_noise(
            model,
            [extended_start(r, base.model, model) for r in fit_on],
            (*priors, *own),
            start={e.name: e.value for e in first.fit.refit.estimates},
            noise_scale=first.fit.noise_scale,
            enough=_NEARER,
        )
        if before is not None:
            judged = [extended_start(r, base.model, model) for r in hold_out]
            held_out = held_out_gain(before, fit, judged)
    except NumericalError as error:
        return Candidate(entry, None, -math.inf, held_out, str(error))
    return Candidate(entry, fit, base.cost - fit.cost, held_out)
