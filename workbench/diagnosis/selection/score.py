"""Scoring a library of effects: one pass of the filter with all of them attached at size zero.

The derivative of the whitened prediction errors with respect to the size of an effect, less what
the free parameters can reproduce, tells how much the effect would gain, how large it would be, how
much of it is collinear with them, which effects look alike, and the smallest size to be seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.filter import Innovations
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import extended_start, summed_over_blocks
from workbench.diagnosis.selection.moments import absent_from, may_be_absent
from workbench.diagnosis.selection.rules import WIDER
from workbench.model import Effect, Model
from workbench.physics.library import Hypothesis

COLLINEAR = 0.99
"""Collinearity above which an effect is told from other parameter values only where it is seen."""

_SIGMA = 4.0
"""Multiple of the standard deviation of its size from which an effect is clear."""

_SEEN = 2.0
"""The same from which it is worth a refit, whatever else would reproduce it."""

_HIGH = 100.0
"""Gain of log likelihood from which an effect is clear too: one that acts in few blocks of time
scatters about its mean over all."""

_DIFFERS = 3.0
"""Gain of log likelihood by which one size in each recording has to beat one in all of them."""

_ELSEWHERE, _CLEARLY = 0.8, 10.0
"""Part of what an event gains in some recordings that it gains in all at most, and log likelihood
that this has to cost, where it does not come to the others."""

_MOST_LEVELS = 3
"""How many effects that differ by recording are offered: beside a large misfit nearly all do."""

_LEADING = 3
"""How many of those that score best where parameters are held on their bounds are told."""

MOST_TOGETHER = 48
"""Effects that one filter carries at the most: a step is as fine as that of the fastest of them."""

_DUE = 0.1
"""Part of what an effect does to the predictions after which it counts as seen."""


@dataclass(frozen=True)
class Score:
    """What one pass says of an effect.

    Args:
        gain: Expected gain of log likelihood, dimensionless.
        sigma: Expected size over its standard deviation, errors taken as correlated over blocks
            of time; dimensionless.
        size: Expected size, in the SI unit of the size parameter.
        std: Standard deviation of the size, in the same unit.
        collinearity: Share of the effect's signature that other parameters can reproduce, 0 to 1,
            dimensionless.
        smallest: Smallest size to be seen on these data, in the same unit.
        shape: Values of the effect's other parameters at which it scores best, in their SI units,
            by short name.
        due: Samples of each recording that hold a tenth of what it does to the predictions, a
            number: of what happens at a time nothing is to be seen before.
        clearest: Number of the recording that shows most of it, from 0.
    """

    entry: Hypothesis
    gain: float
    sigma: float
    size: float
    std: float
    collinearity: float
    smallest: float
    shape: Mapping[str, float] = field(default_factory=dict)
    due: int = 0
    clearest: int = 0

    @property
    def late(self) -> int:
        """Samples of each recording without which nothing of it is seen; 0 if it is in doubt."""
        return self.due if abs(self.sigma) > _SIGMA or self.gain > _HIGH else 0

    @property
    def testable(self) -> bool:
        """Whether these data can show the effect at all.

        What parameters reproduce but for a hundredth may still be seen by that hundredth. The
        largest size is a guess, unless it is all of a whole: a refit that ends on it widens it.
        """
        largest = self.entry.largest_size * (1.0 if self.entry.whole else WIDER)
        possible = self.smallest < largest and self.collinearity < COLLINEAR
        return possible or abs(self.sigma) > _SEEN


@dataclass(frozen=True)
class Scores:
    """Scores of a library, best first.

    Args:
        scores: One per effect, by falling gain.
        confusion: Absolute cosine between the projected signatures, shape (n, n), in the order of
            ``scores``.
        failed: Effects that could not be scored, each with the reason.
        leading: Names of effects that lead where parameters are held on their bounds.
    """

    scores: tuple[Score, ...]
    confusion: Vector
    failed: tuple[tuple[str, str], ...] = ()
    leading: tuple[str, ...] = ()

    def beside(self, held: Scores) -> Scores:
        """Return the scores with what those with parameters held on their bounds tell.

        Of what these data cannot show otherwise their scores stand; what leads there does what a
        parameter would do beyond its bound, as the viscosity of a muscle does for a damper.
        """
        shown = {s.entry.name: s for s in held.scores if s.testable}
        found = [s if s.testable else shown.get(s.entry.name, s) for s in self.scores]
        order = sorted(range(len(found)), key=lambda i: -found[i].gain)
        return replace(
            self,
            scores=tuple(found[i] for i in order),
            confusion=self.confusion[np.ix_(order, order)],
            leading=tuple(s.entry.name for s in held.scores[:_LEADING] if s.testable),
        )

    def look_alikes(self, name: str, *, above: float = 0.95) -> tuple[str, ...]:
        """Return the effects whose signature resembles that of one effect.

        Args:
            above: Least absolute cosine, 0 to 1, dimensionless.
        """
        names = [score.entry.name for score in self.scores]
        if name not in names:
            return ()
        row = self.confusion[names.index(name)]
        order = [i for i in np.argsort(-row) if names[i] != name and row[i] > above]
        return tuple(names[i] for i in order)

    def __str__(self) -> str:
        lines = [f"{'effect':<34} {'gain':>10} {'sigma':>8} {'size':>12} {'collinear':>9}"]
        lines += [
            f"{s.entry.name:<34} {s.gain:>10.1f} {s.sigma:>8.1f} {s.size:>12.4g}"
            f" {s.collinearity:>9.3f}"
            for s in self.scores[:15]
        ]
        return "\n".join(lines)


def score_library(
    model: Model,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    entries: Sequence[Hypothesis],
    *,
    noise_scale: float,
) -> Scores:
    """Score effects that are not in the model.

    Args:
        priors: Priors of the free parameters, which may reproduce an effect.
        noise_scale: Process-noise scale that the filter allows, dimensionless.

    Example:
        >>> from workbench.diagnosis.estimation.simulated_recordings import simulated, pushes
        >>> from workbench.diagnosis.estimation.priors import default_priors
        >>> from workbench.plants.servo_axis import servo_axis
        >>> axis = servo_axis()
        >>> seen = simulated(axis, pushes(200, largest=200.0), sample_time=0.01)
        >>> from workbench.diagnosis.estimation.process_noise import fit_with_process_noise
        >>> from workbench.physics.library import library
        >>> axis = axis.without("coulomb_friction")
        >>> priors = default_priors(axis, ["mass"])
        >>> fit = fit_with_process_noise(axis, [seen], priors)
        >>> tried = [e for e in library(axis) if not e.stiff]
        >>> scores = score_library(fit.model, [seen], priors, tried, noise_scale=fit.noise_scale)
        >>> scores.scores[0].entry.law
        'coulomb_friction'
    """
    failed: dict[str, str] = {}
    variants = []
    for entry in entries:
        try:
            variants += _variants(entry)
        except Exception as error:  # noqa: BLE001
            # One law that cannot be built must not end the scoring of all others.
            failed[entry.name] = reason_of(error)
    names = tuple(p.name for p in priors)
    attached: list[_Attached] = []
    # Stiff effects would force short steps on all others, so they have a filter of their own.
    for stiff in (False, True):
        group = [v for v in variants if v.entry.stiff is stiff]
        for begin in range(0, len(group), MOST_TOGETHER):
            some = group[begin : begin + MOST_TOGETHER]
            attached += _attached(model, recordings, names, some, noise_scale, failed)
    if not attached:
        return Scores((), np.zeros((0, 0)), tuple(failed.items()))
    ordered = [variant for one in attached for variant in one.variants]
    totals = _Totals(len(names), len(ordered))
    for number in range(len(recordings)):
        totals.add([one.parts[number] for one in attached])
    n = len(names)
    scale = np.concatenate([attached[0].scale[:n], *(one.scale[n:] for one in attached)])
    std = np.array([p.std for p in priors])
    found = _scores(totals, ordered, scale, std, recordings)
    return replace(found, failed=tuple(failed.items()))


def _attached(
    model: Model,
    recordings: Sequence[Observed],
    names: tuple[str, ...],
    variants: Sequence[_Variant],
    noise_scale: float,
    failed: dict[str, str],
) -> list[_Attached]:
    """Run the filter with effects attached; where that fails, look for the one that is to blame."""
    try:
        extended = model.with_effect(*(variant.effect for variant in variants))
        sizes = [f"{v.effect.name}.{v.entry.size_parameter}" for v in variants]
        absent = [name for name in sizes if extended.parameter(name).value == 0.0]
        free = (*names, *sizes)
        filter_ = filter_of(extended, recordings[0], noise_scale, free, beside=model, absent=absent)
        started = [extended_start(r, model, extended) for r in recordings]
        parts = filter_.along(started, extended.values)
        return [_Attached(variants, filter_.free_scale, parts)]
    except Exception as error:  # noqa: BLE001
        if len(variants) == 1:
            failed.setdefault(variants[0].entry.name, reason_of(error))
            return []
    half = len(variants) // 2
    return [
        one
        for part in (variants[:half], variants[half:])
        for one in _attached(model, recordings, names, part, noise_scale, failed)
    ]


def reason_of(error: Exception) -> str:
    """Return the first line of an error, or its kind."""
    return str(error).strip().split("\n")[0] or type(error).__name__


@dataclass(frozen=True)
class _Variant:
    """An effect at size zero with one choice of its other parameters."""

    entry: Hypothesis
    shape: Mapping[str, float]
    effect: Effect


def _variants(entry: Hypothesis) -> list[_Variant]:
    made = []
    for number, shape in enumerate(entry.shapes):
        effect = entry.at_size(0.0, shape)
        name = entry.name if number == 0 else f"{entry.name}_as_{number}"
        made.append(_Variant(entry, shape, replace(effect, name=name)))
    return made


class _Attached(NamedTuple):
    """What a filter with effects attached at size zero predicts along recordings.

    Args:
        scale: Scales of the free parameters, then of the sizes.
    """

    variants: Sequence[_Variant]
    scale: Vector
    parts: Sequence[Innovations]


class _Totals:
    """Sums over recordings, and the score by blocks of time."""

    def __init__(self, n_parameters: int, n_effects: int) -> None:
        n = n_parameters + n_effects
        self.split = n_parameters
        self.information, self.gradient = np.zeros((n, n)), np.zeros(n)
        self.each: list[tuple[Vector, Vector]] = []
        self.blocks: list[Vector] = []
        self.begins: list[Vector] = []
        self.shown: list[Vector] = []

    # Derivatives of a law beyond the range of numbers leave it without a score, and no other.
    @np.errstate(over="ignore", invalid="ignore")
    def add(self, parts: Sequence[Innovations]) -> None:
        errors = np.nan_to_num(parts[0].whitened)
        # At size zero all filters predict the same; the free parameters stand in each of them.
        others = [part.jacobian[:, :, self.split :] for part in parts[1:]]
        jacobian = np.concatenate([parts[0].jacobian, *others], axis=2)
        rows = jacobian.reshape(-1, jacobian.shape[2])
        products = np.einsum("kyf,ky->kf", jacobian, errors)
        self.each.append((rows.T @ rows, products.sum(axis=0)))
        self.information += self.each[-1][0]
        self.gradient += self.each[-1][1]
        blocks = summed_over_blocks(products)
        self.blocks.append(blocks)
        self.begins.append(np.linspace(0.0, len(errors), len(blocks), endpoint=False))
        own = jacobian[:, :, self.split :]
        self.shown.append(summed_over_blocks(np.einsum("kyf,kyf->kf", own, own)))

    @np.errstate(over="ignore", invalid="ignore")
    def by_recording(
        self, variants: Sequence[_Variant], prior: Vector
    ) -> tuple[list[int], dict[int, Vector]]:
        """Give each recording the size that some effects score best with, which the totals hold.

        Levels have one of their own in each, in multiples of their root mean square; events are
        there or not.

        Args:
            prior: Information of the priors of the free parameters, shape (n_free, n_free).

        Returns:
            Numbers of the levels that do not differ from recording to recording; and of events,
            what each recording gains by them, shape (n,), minus infinity where they do not come.
        """
        n, same, gains = self.split, [], {}
        shared = self.information[:n, :n] + prior
        settled = np.linalg.solve(shared, self.gradient[:n])
        weights = np.ones((len(self.each), len(self.gradient)))
        for k, variant in enumerate(variants):
            about = variant.effect.about
            once = len(self.each) > 1 and may_be_absent(variant.effect)
            if not (about.level or once):
                continue
            cross = np.array([i[:n, n + k] for i, _ in self.each])
            slopes = np.array([g[n + k] for _, g in self.each])
            slopes -= cross @ settled
            curvature = np.diag([i[n + k, n + k] for i, _ in self.each])
            curvature -= cross @ np.linalg.solve(shared, cross.T)
            if once:
                weights[:, n + k] = own = _shown_in(slopes, curvature)
                size = -(own @ slopes) / max(own @ curvature @ own, 1e-30)
                gain = -size * slopes - 0.5 * size**2 * np.diag(curvature)
                gains[k] = np.where(own > 0.0, gain, -np.inf)
            elif (levels := _levels(slopes, curvature)) is not None:
                weights[:, n + k] = levels
            else:
                same.append(k)
        pairs = [(np.outer(w, w) * i, w * g) for w, (i, g) in zip(weights, self.each, strict=True)]
        self.information = np.sum([i for i, _ in pairs], axis=0)
        self.gradient = np.sum([g for _, g in pairs], axis=0)
        self.blocks = [w * b for w, b in zip(weights, self.blocks, strict=True)]
        self.shown = [w[n:] ** 2 * b for w, b in zip(weights, self.shown, strict=True)]
        return same, gains


def _levels(slopes: Vector, curvature: Vector) -> Vector | None:
    """Return the sizes of recordings over their root mean square; None where one will do.

    Args:
        slopes: Of the cost by the size in each recording, shape (n,), dimensionless.
        curvature: Shape (n, n), dimensionless.
    """
    if not np.isfinite(curvature).all():
        return None
    sizes = -np.linalg.pinv(curvature, rcond=1e-6, hermitian=True) @ slopes
    alike = 0.5 * slopes.sum() ** 2 / max(curvature.sum(), 1e-6 * np.trace(curvature))
    if not -0.5 * slopes @ sizes - alike > _DIFFERS:
        return None
    return np.asarray(sizes / np.sqrt(np.mean(sizes**2)))


def _shown_in(slopes: Vector, curvature: Vector) -> Vector:
    """Return 1 for each recording to which an event comes, 0 for the others.

    It comes to those that want most of it, of one sign.
    """
    own = np.diag(curvature)
    if not (np.isfinite(curvature).all() and (own > 0.0).all()):
        return np.ones(len(own))
    order = np.argsort(slopes / own)
    ends = [some for k in range(1, len(order)) for some in (order[:k], order[k:])]
    tried = [np.ones(len(order)), *(np.isin(np.arange(len(order)), some) * 1.0 for some in ends)]
    least = 1e-6 * np.trace(curvature)
    gains = [0.5 * (w @ slopes) ** 2 / max(w @ curvature @ w, least) for w in tried]
    best = int(np.argmax(gains))
    elsewhere = gains[0] < min(_ELSEWHERE * gains[best], gains[best] - _CLEARLY)
    return np.asarray(tried[best if elsewhere else 0])


@np.errstate(over="ignore", invalid="ignore")
def _scores(
    totals: _Totals,
    variants: Sequence[_Variant],
    scale: Vector,
    std: Vector,
    recordings: Sequence[Observed],
) -> Scores:
    n = totals.split
    prior = np.diag((scale[:n] / std) ** 2)
    same, gains = totals.by_recording(variants, prior)
    information, gradient = totals.information, totals.gradient
    blocks = np.concatenate(totals.blocks)
    collinear = np.linalg.solve(information[:n, :n] + prior, information[:n, n:])
    projected = information[n:, n:] - information[n:, :n] @ collinear
    slopes = gradient[n:] - collinear.T @ gradient[:n]
    projected_blocks = blocks[:, n:] - blocks[:, :n] @ collinear
    # The mean over blocks is the signal; what scatters about it is the uncertainty.
    scatter = np.sum((projected_blocks - projected_blocks.mean(axis=0)) ** 2, axis=0)
    full = np.maximum(np.diag(information)[n:], 1e-300)
    kept = np.maximum(np.diag(projected), np.maximum(1e-12 * full, 1e-30))
    size = -slopes / kept
    deviation = np.sqrt(np.maximum(scatter, kept)) / kept
    either = np.array([variant.entry.signed for variant in variants])
    # An effect that only has one sign cannot gain by the other.
    signed = np.where(either, size, np.maximum(size, 0.0))
    gain = 0.5 * signed**2 * kept
    collinearity = np.clip(1.0 - np.diag(projected) / full, 0.0, 1.0)
    confusion = np.abs(projected) / np.sqrt(np.outer(kept, kept))
    # Of each effect the shape that gains the most, best effect first.
    best: dict[str, int] = {}
    for i in np.argsort(-gain):
        if i not in same:
            best.setdefault(variants[i].entry.name, int(i))
    order = list(best.values())
    differing = [i for i in order if variants[i].entry.effect.about.level]
    order = [i for i in order if i not in differing[_MOST_LEVELS:]]
    due = _due(np.concatenate(totals.shown), np.concatenate(totals.begins))
    clearest = np.argmax([blocks.sum(axis=0) for blocks in totals.shown], axis=0)
    # A recording to which an event does not come shows by how much it does not.
    clearest[list(gains)] = [np.argmax(own) for own in gains.values()]
    units = scale[n:]
    scores = tuple(
        Score(
            absent_from(
                variants[i].entry,
                [r for r, g in zip(recordings, gains.get(i, ()), strict=False) if g == -np.inf],
            ),
            float(gain[i]),
            float(signed[i] / deviation[i]),
            float(signed[i] * units[i]),
            float(deviation[i] * units[i]),
            float(collinearity[i]),
            float(_SIGMA * deviation[i] * units[i]),
            dict(variants[i].shape),
            round(float(due[i])),
            int(clearest[i]),
        )
        for i in order
    )
    return Scores(scores, confusion[np.ix_(order, order)])


def _due(blocks: Vector, begins: Vector) -> Vector:
    """Return after how many samples a tenth of what each effect does has been seen.

    Args:
        blocks: Squared slopes by block of time, shape (n_blocks, n_effects), dimensionless.
        begins: First sample of each block, shape (n_blocks,), a number.
    """
    order = np.argsort(begins, kind="stable")
    gathered = np.cumsum(blocks[order], axis=0)
    first = np.argmax(gathered >= _DUE * gathered[-1], axis=0)
    return np.asarray(begins[order][first])


def by_name(scores: Scores) -> dict[str, Score]:
    """Return scores by the name of the effect."""
    return {score.entry.name: score for score in scores.scores}
