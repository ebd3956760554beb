"""A nonparametric term: what a model lacks at a place, as curves over what that place sees.

Where the library has no name for a mismatch, the smoothed unknown input tells what it depends on
and gives a first curve; the curve is then part of the equations and its ordinates are refitted
together with the free parameters of the model. The result is empirical: it has no meaning beyond
the range of the data, and it differs from the true law by what free parameters can reproduce (the
linear part of a friction goes into the damper, a constant into an offset, a common factor into an
inertia), because the data do not say which of both it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import free_run, rms_of
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.process_noise import (
    LADDER,
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
    gain_interval,
)
from workbench.diagnosis.estimation.refit_result import Refit
from workbench.diagnosis.nonparametric.curve_description import describing_terms
from workbench.diagnosis.nonparametric.dependence import (
    Evidence,
    Site,
    loop_along,
    partial,
    rate_of,
    spread,
)
from workbench.diagnosis.nonparametric.evidence import gather
from workbench.diagnosis.nonparametric.result import (
    EFFECT_NAME,
    Argument,
    Bins,
    Law,
    NonparametricTerm,
)
from workbench.diagnosis.nonparametric.shapes import matched
from workbench.diagnosis.selection.rules import LEAST_GAIN
from workbench.errors import NumericalError
from workbench.physics.nonparametric_term import Curve

KNOTS = (6, 12)
"""Knots per argument: the fewer, unless the more predict better."""

LEAST_SHARE = 0.1
"""Share of the signal that the first argument must predict across blocks of time."""

LEAST_FURTHER = 0.05
"""Share that each further argument must predict beyond those before."""

SIGNIFICANT = 0.02
"""Largest p-value of an argument."""

WORSE, BETTER = 1.02, 0.95
"""Held-out free-run error over that without the term: largest of any output, and what at least one
must fall to."""

_FEWER = 0.01
_RELATIVE = 1.1
_CLEARLY = 20.0
_REPRODUCED = 0.99
_CLASSES = 20
_DRAWS = 100


def nonparametric_term(
    base: ProcessNoiseFit,
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
    ports: Sequence[str],
    priors: Sequence[Prior],
) -> NonparametricTerm:
    """Fit a law without a name where a model lacks something.

    The unknown input at the ports is smoothed; curves over each quantity that the ports see, or
    that a pair of ports sees that acts in the same way, are compared by how much of it they
    predict, beyond what other parameter values would explain. At most two arguments, each tested
    against shifted signals, and a loop over one of them are put into the equations and refitted by
    prediction error together with the free parameters. The prior of the ordinates is normal about
    zero.

    Returns:
        The term; accepted if it gains on the held-out recordings with an interval that excludes
        zero, and their free run gets worse for no output and better for one.

    Raises:
        WorkbenchError: If a port does not exist or sees nothing.
        NumericalError: If the filter of the base model cannot follow the recordings.
    """
    evidence = gather(base.model, fit_on, ports, priors)
    shapes = _shapes(evidence)
    if isinstance(shapes, str):
        return NonparametricTerm(base, tuple(ports), reason=shapes)
    fits: list[tuple[_Shape, Law, ProcessNoiseFit]] = []
    failure = ""
    for trial in shapes:
        try:
            fits.append((trial, *_refit(base, trial, evidence, fit_on, priors)))
        except NumericalError as error:
            failure = str(error)
    if not fits:
        return NonparametricTerm(base, tuple(ports), reason=failure)
    # Another place than the located one must be clearly better: many laws there reproduce one here.
    shape, law, fit = min(
        fits, key=lambda f: f[2].cost + _CLEARLY * (f[0].site.ports != evidence.located)
    )
    found = NonparametricTerm(
        fit,
        shape.site.ports,
        "1" if shape.relative else shape.site.unit,
        shape.relative,
        {curve.argument: curve for curve in shape.curves},
        loop=shape.loop is not None,
        gain=base.cost - fit.cost,
        law=law,
    )
    found = _with_evidence(found, base, shape, evidence, priors)
    found = _judged(found, base, fit_on, hold_out)
    if not found.accepted:
        return found
    return matched(found, base, fit_on, priors, penalty=_penalty_per_ordinate(fit_on))


@dataclass(frozen=True)
class _Shape:
    """A site with curves over what it sees; the coefficients are not part of it."""

    site: Site
    relative: bool
    curves: tuple[Curve, ...]
    tests: tuple[tuple[float, float], ...]
    loop: tuple[str, float] | None = None

    def columns(self, evidence: Evidence) -> Vector:
        blocks = [
            self.site.columns(curve.functions(self.site.signals[curve.argument]), self.relative)
            for curve in self.curves
        ]
        if self.loop is not None:
            along = loop_along(self.site.signals[self.loop[0]], evidence.recording, self.loop[1])
            blocks.append(self.site.columns(along[:, :, None], self.relative))
        return np.column_stack([*blocks, evidence.nominal[:, :0]])

    @property
    def names(self) -> list[str]:
        """Names of the coefficients as parameters of the extended model."""
        own = [short for curve in self.curves for short in curve.names]
        return [f"{EFFECT_NAME}.{n}" for n in (*own, *(["loop"] if self.loop else []))]

    def law(self, typical: float, upper: float) -> Law:
        site, loop = self.site, None
        if self.loop is not None:
            name, distance = self.loop
            loop = (str(rate_of(name, site)), site.units[name], distance)
        return Law(site.ports, self.curves, site.unit, self.relative, typical, upper, loop)


def _shapes(evidence: Evidence) -> list[_Shape] | str:
    """Choose arguments and loop by what they predict of the signal; or say why not.

    The best law at the located ports, then the best one at a pair that acts in the same way if it
    predicts as much: only the equations with the one and the other can tell them apart.
    """
    none = evidence.nominal[:, :0]
    best = []
    for here in (True, False):
        trials = [
            _with(_Shape(site, relative, (), ()), name, evidence, none)
            for site in evidence.sites
            if (site.ports == evidence.located) is here
            for relative in ((False, True) if site.value.min() >= 0.0 else (False,))
            for name in site.signals
        ]
        best += sorted(trials, key=_left)[:1]
    if not best:
        return "nothing varies at the ports"
    first = min(best, key=_left)
    p_value, share = first.tests[0]
    if share < LEAST_SHARE or p_value > SIGNIFICANT:
        return (
            f"the signal depends on nothing that the ports see: most on {first.curves[0].argument},"
            f" share {share:.2f}, p {p_value:.2g}"
        )
    chosen = [shape for shape in best if shape is first or shape.site.ports == evidence.located]
    return [
        _with_loop(_second(shape, evidence), evidence)
        for shape in chosen
        if shape.tests[0][0] <= SIGNIFICANT and shape.tests[0][1] >= LEAST_SHARE
    ]


def _left(shape: _Shape) -> float:
    """Share that is left, a plain sum being the simpler law; what is not significant comes last."""
    p_value, share = shape.tests[0]
    return (_RELATIVE if shape.relative else 1.0) * (1.0 - share) + 100.0 * (p_value > SIGNIFICANT)


def _with(start: _Shape, name: str, evidence: Evidence, given: Vector) -> _Shape:
    """Add a curve over an argument, with its p-value and share beyond what is given."""
    site = start.site
    x = evidence.at_ports(site.signals[name])
    # A constant belongs to the free parameters if they have one, else to the first curve.
    one = site.columns(np.ones((*site.value.shape, 1)), start.relative)[:, 0]
    centred = bool(given.size) or evidence.reproduced(one) > _REPRODUCED
    trials = []
    for knots in KNOTS:
        curve = spread(x, name, site.units[name], knots, centred=centred)
        columns = site.columns(curve.functions(site.signals[name]), start.relative)
        trials.append((evidence.share(np.column_stack([given, columns])), curve, columns))
    fewer, more = trials
    share, curve, columns = more if more[0] > fewer[0] + _FEWER else fewer
    if given.size:
        share -= evidence.share(given)
    p_value = evidence.p_value(columns, given) if share > 0.3 * LEAST_FURTHER else 1.0
    return replace(start, curves=(*start.curves, curve), tests=(*start.tests, (p_value, share)))


def _second(first: _Shape, evidence: Evidence) -> _Shape:
    name = first.curves[0].argument
    given = first.columns(evidence)
    trials = [_with(first, other, evidence, given) for other in first.site.signals if other != name]
    good = [t for t in trials if t.tests[1][0] <= SIGNIFICANT and t.tests[1][1] >= LEAST_FURTHER]
    return max(good, key=lambda t: t.tests[1][1], default=first)


def _with_loop(shape: _Shape, evidence: Evidence) -> _Shape:
    """Add a memory if a loop is left at fixed arguments."""
    given = shape.columns(evidence)
    before = evidence.share(given)
    best, gain = shape, LEAST_FURTHER
    for name, x in shape.site.signals.items():
        if rate_of(name, shape.site) is None:
            continue
        span = float(np.subtract(*np.quantile(x, [0.99, 0.01])))
        for distance in (0.03 * span, 0.1 * span, 0.3 * span):
            trial = replace(shape, loop=(name, distance))
            columns = trial.columns(evidence)
            more = evidence.share(columns) - before
            if more > gain and evidence.p_value(columns[:, -1:], given) <= SIGNIFICANT:
                best, gain = trial, more
    return best


def _refit(
    base: ProcessNoiseFit,
    shape: _Shape,
    evidence: Evidence,
    fit_on: Sequence[Observed],
    priors: Sequence[Prior],
) -> tuple[Law, ProcessNoiseFit]:
    """Put the curves into the equations and refit their ordinates with the free parameters."""
    answer = evidence.solve(shape.columns(evidence))
    steps, ordinates = answer[: len(priors)], answer[len(priors) :]
    size = float(np.sqrt(np.mean(ordinates**2))) or 1.0
    upper = 20.0 * size
    law = shape.law(size, upper)
    model = base.model.with_effect(law.effect)
    own = [Prior(name, 0.0, 3.0 * size, -upper, upper) for name in shape.names]
    if shape.loop is not None:
        q = model.parameter(f"{EFFECT_NAME}.distance")
        own.append(Prior(q.name, q.value, q.value, q.lower, q.upper))
    begin = {
        prior.name: float(np.clip(estimate.value + step * prior.std, prior.lower, prior.upper))
        for prior, estimate, step in zip(priors, base.refit.estimates, steps, strict=True)
    }
    begin |= dict(zip(shape.names, ordinates.tolist(), strict=True))
    begin |= {prior.name: prior.mean for prior in own if prior.name not in begin}
    started = [extended_start(seen, base.model, model) for seen in fit_on]
    fit = fit_with_process_noise(
        model, started, (*priors, *own), start=begin, noise_scale=base.noise_scale
    )
    return law, fit


def _with_evidence(
    found: NonparametricTerm,
    base: ProcessNoiseFit,
    shape: _Shape,
    evidence: Evidence,
    priors: Sequence[Prior],
) -> NonparametricTerm:
    """Hold the fitted curves against the smoothed signal and describe them in simple terms."""
    fit = found.fit.refit
    before = base.refit.values
    steps = [(fit.estimate(q.name).value - before[q.name]) / q.std for q in priors]
    values = [fit.estimate(name).value for name in shape.names]
    columns = shape.columns(evidence)
    rest = evidence.signal - evidence.nominal @ np.array(steps) - columns @ np.array(values)
    known = evidence.known
    names = [estimate.name for estimate in fit.estimates]
    rng = np.random.default_rng(0)
    arguments = []
    for curve, (p_value, share) in zip(shape.curves, shape.tests, strict=True):
        x, left, weight = partial(evidence, shape.site, shape.relative, curve.argument, rest)
        own = found.curve(x, curve.argument)
        at = np.linspace(curve.knots[0], curve.knots[-1], 60)
        places = [names.index(f"{EFFECT_NAME}.{short}") for short in curve.names]
        drawn = drawn_values(fit, places, rng)
        arguments.append(
            Argument(
                curve.argument,
                curve.unit,
                p_value,
                share,
                (float(x[weight > 0].min()), float(x[weight > 0].max())),
                _bins(x, left + own, own, weight),
                describing_terms(
                    at, found.curve(at, curve.argument), drawn @ curve.functions(at).T
                ),
            )
        )
    explained = 1.0 - float(np.mean(rest[known] ** 2)) / evidence.mean_square
    return replace(found, arguments=tuple(arguments), explained=explained)


def drawn_values(fit: Refit, places: Sequence[int], rng: np.random.Generator) -> Vector:
    """Draw values of estimates, in SI, as far apart as the refit knows them.

    Args:
        places: Those of the estimates among all.

    Returns:
        Shape (n_draws, n_places).
    """
    centre = np.array([fit.estimates[i].value for i in places])
    covariance = fit.covariance[np.ix_(places, places)]
    return rng.multivariate_normal(centre, covariance, size=_DRAWS, method="svd")


def _bins(x: Vector, y: Vector, curve: Vector, weight: Vector) -> Bins:
    """Weighted means over classes of the argument: half of them even, half by the data."""
    used = weight > 0
    x, y, curve, weight = x[used], y[used], curve[used], weight[used]
    low, high = np.quantile(x, [0.002, 0.998])
    halves = np.linspace(low, high, _CLASSES), np.quantile(x, np.linspace(0, 1, _CLASSES))
    which = np.searchsorted(np.unique(np.concatenate(halves)), x)
    count = np.bincount(which)
    total = np.bincount(which, weights=weight)

    def mean(values: Vector) -> Vector:
        return np.asarray(np.bincount(which, weights=weight * values) / np.maximum(total, 1e-300))

    centre = mean(y)
    std = np.sqrt(np.maximum(mean((y - centre[which]) ** 2), 0.0))
    filled = count >= 5
    return Bins(mean(x)[filled], centre[filled], std[filled], mean(curve)[filled])


def _judged(
    found: NonparametricTerm,
    base: ProcessNoiseFit,
    fit_on: Sequence[Observed],
    hold_out: Sequence[Observed],
) -> NonparametricTerm:
    """Judge a term on recordings that it was not fitted on."""
    fit = found.fit
    started = [extended_start(seen, base.model, fit.model) for seen in hold_out]
    try:
        held_out = gain_interval(_most_likely(base, hold_out), _most_likely(fit, started))
    except NumericalError as error:
        return replace(found, reason=str(error))
    before = rms_of([free_run(base.model, seen).rmse for seen in hold_out])
    after = rms_of([free_run(fit.model, seen).rmse for seen in started])
    found = replace(
        found, held_out=held_out, rmse={name: (before[name], after[name]) for name in before}
    )
    own = len(fit.refit.estimates) - len(base.refit.estimates)
    penalty = LEAST_GAIN + own * _penalty_per_ordinate(fit_on)
    ratios = {name: after[name] / max(before[name], 1e-300) for name in before}
    worst, best = max(ratios, key=ratios.__getitem__), min(ratios, key=ratios.__getitem__)
    reason = ""
    if not fit.refit.converged:
        reason = "the refit did not converge"
    elif found.gain < penalty:
        reason = f"it gains less than the penalty for its ordinates, {penalty:.0f}"
    elif held_out[1] <= 0.0:
        reason = "it does not reliably improve the held-out recordings"
    elif not ratios[worst] <= WORSE:
        reason = f"it makes the free run of {worst} on held-out recordings worse"
    elif not ratios[best] <= BETTER:
        reason = "it improves the free run on held-out recordings for no output"
    return replace(found, reason=reason)


def _penalty_per_ordinate(fit_on: Sequence[Observed]) -> float:
    """Return what a parameter has to gain: half the logarithm of the tenths of a second."""
    samples = sum(len(r.outputs) * r.sample_time for r in fit_on) / 0.1
    return 0.5 * math.log(max(samples, 2.0))


def _most_likely(fit: ProcessNoiseFit, recordings: Sequence[Observed]) -> Vector:
    """Return the cost by block at the share, from that of the fit up, that explains most.

    A curve that was fitted well within its range is a little less right at its ends, where other
    recordings may have more data: how far to trust the equations is part of what is judged.
    """
    trials = [
        blocks_of_cost(replace(fit, noise_scale=scale), recordings)
        for scale in sorted(LADDER)
        if scale >= 0.99 * fit.noise_scale
    ]
    return min(trials, key=lambda blocks: float(blocks.sum()))
