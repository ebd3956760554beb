"""The likelihood of recordings under a model whose equations may be imperfect.

How much the equations leave out is itself estimated: the scale of the noise expected at the
ports is lowered step by step, with a refit at each, as long as the recordings become more likely.
A model that lacks physics stops early, the right one goes down to the noise of the sensors.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.priors import Prior
from workbench.diagnosis.estimation.refit import ENOUGH, refit
from workbench.diagnosis.estimation.refit_result import Refit
from workbench.errors import NumericalError
from workbench.model import Effect, Model
from workbench.model.expressions import cofactor, terms
from workbench.physics.recorded_facts import argument_of, end_of, term_of
from workbench.physics.survey import Survey
from workbench.recordings.checks.clipping import clipped_samples

LADDER = (3000.0, 300.0, 30.0, 3.0, 1.0, 0.3, 0.03, 0.003)
"""Process-noise scales that are tried, from a poor model to a perfect one."""

PERFECT = 0.03
"""Process-noise scale at which the equations leave nothing out; the ladder goes on, lest a law is
believed for making that noise smaller, as a wrong gain of a sensor does."""

INDIFFERENT = 3.0
"""Log likelihood that more trust in the equations may cost: where nothing is left out, noise alone
makes one machine of ten gain 1 and one of a hundred 3 (a variance on its bound, S. Self and K.-Y.
Liang 1987)."""

_USUAL = 3.0
_LOOKS, _ENDS = 2000, (0.005, 0.995)
_UNKNOWN_START = 0.3
"""Uncertainty of the start of an effect's state that says nothing of it, over its scale."""

_BLOCKS, _LEAST_BLOCK = 40, 20
"""Blocks that a recording is cut into, and the least number of samples of one."""


@dataclass(frozen=True)
class ProcessNoiseFit:
    """A refit at the most likely process-noise scale.

    Args:
        noise_scale: The noise_scale, dimensionless: small where the model explains the recordings.
        passed: The fit one step higher on the ladder, from which this one was reached; None at the
            step where it began.
    """

    refit: Refit
    noise_scale: float
    passed: ProcessNoiseFit | None = None

    @property
    def model(self) -> Model:
        """The model with the estimated parameter values."""
        return self.refit.model

    def with_values(self, values: Mapping[str, float]) -> ProcessNoiseFit:
        """Return the fit with a model of other parameter values, by name, in SI."""
        return replace(self, refit=replace(self.refit, model=self.model.with_parameters(values)))

    @property
    def cost(self) -> float:
        """Minus the log likelihood of the recordings, with the priors; dimensionless."""
        return self.refit.cost


def extended_start(observed: Observed, model: Model, extended: Model) -> Observed:
    """Return a recording as attached effects have it: its start covers their states.

    These are where the effects put them. A measurement that one reads late is moved ahead. A state
    that was known from a sensor that the effects may shift is known no better than the model says,
    and what a slow sensor reads no better than what that remembers. ``model`` is that for which the
    recording was brought into shape.
    """
    if len(extended.effects) == len(model.effects):
        return observed
    given = dict(zip((q.name for q in model.states), observed.start.tolist(), strict=True))
    own = {q.name: dict(q.start_in) for q in extended.states}
    given |= {name: at[observed.name] for name, at in own.items() if observed.name in at}
    start = extended.initial_state(given, u=observed.inputs[0])
    attached = {effect.name for effect in model.effects}
    new = [effect for effect in extended.effects if effect.name not in attached]
    reopened = _misread(new, extended, observed, start)
    apart = _remembered(new, model, observed)
    known = {
        q.name: max(r, q.start_rms or q.scale) if q.name in reopened else math.hypot(r, away)
        for q, r, away in zip(model.states, observed.start_rms, apart, strict=True)
    }
    rms = np.array(
        [known.get(q.name, q.start_rms or _UNKNOWN_START * q.scale) for q in extended.states]
    )
    moved = _read_late(new, extended, observed.sample_time)
    return replace(observed.moved_ahead(moved) if moved else observed, start=start, start_rms=rms)


def as_it_reads(model: Model) -> Model:
    """Return a model whose sensors are late by themselves: no recording is moved ahead for it."""
    moved = (f"{e.name}.{e.about.advance}" for e in model.effects if e.about.advance)
    return model.with_parameters(dict.fromkeys(moved, 0.0))


def _read_late(new: Sequence[Effect], extended: Model, interval: float) -> dict[str, int]:
    """Return by how many samples attached effects move measurements ahead, by output."""
    return {
        effect.ports[0].removesuffix(".reading"): round(ahead / interval)
        for effect in new
        if effect.about.advance
        if (ahead := extended.parameter(f"{effect.name}.{effect.about.advance}").value) > 0.0
    }


def _misread(new: Sequence[Effect], extended: Model, observed: Observed, start: Vector) -> set[str]:
    """Return the states whose first measurements attached effects may shift beyond the noise."""
    mine = {f"{e.name}.{q.name}" for e in new for q in e.parameters if q.fitted}
    columns = [i for i, q in enumerate(extended.parameters) if q.name in mine]
    rows = observed.rows(extended)
    trace = extended.exact
    slopes = ca.jacobian(trace.outputs[rows], trace.p)[:, columns]
    if not slopes.nnz():
        return set()
    at = start, observed.inputs[0], extended.values
    sizes = np.array([extended.parameters[i].scale for i in columns])
    shift = np.abs(np.asarray(trace.function("slopes", slopes)(*at))) @ sizes
    shifted = [
        row for row, by, rms in zip(rows, shift, observed.noise_rms, strict=True) if by > rms
    ]
    read = np.asarray(trace.jacobian_function(*at)[2])[shifted]
    return {q.name for i, q in enumerate(extended.states) if np.any(read[:, i] != 0.0)}


def _remembered(new: Sequence[Effect], model: Model, observed: Observed) -> Vector:
    """Return how far each state may be from what attached slow sensors remember, in its unit."""
    kept = {e.ports[0]: max(q.start_rms for q in e.states) for e in new if e.states}
    apart = np.array([kept.get(f"{q.name}.reading", 0.0) for q in model.outputs])
    if not apart.any():
        return np.zeros(len(model.states))
    at = observed.start, observed.inputs[0], model.values
    slopes = np.abs(np.asarray(model.exact.jacobian_function(*at)[2]))
    away = np.divide(apart[:, None], slopes, out=np.zeros_like(slopes), where=slopes > 0.0)
    most = np.array([q.start_rms or q.scale for q in model.states])
    return np.asarray(np.minimum(away.max(axis=0), most))


def fit_with_process_noise(
    model: Model,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    *,
    start: Mapping[str, float] | None = None,
    noise_scale: float | None = None,
    follow: bool = True,
    ladder: Sequence[float] = LADDER,
    enough: float = ENOUGH,
) -> ProcessNoiseFit:
    """Refit a model at the most likely process-noise scale.

    Args:
        recordings: Recordings as `observe` returns them, for this model.
        start: Where to start some parameters, by name, in SI.
        noise_scale: Scale to begin with, dimensionless; by default the one under which the
            recordings are most likely before the fit, 3 or more.
        ladder: Shares that are tried, falling, dimensionless.
        enough: A step that gains less log likelihood than this ends a refit, dimensionless.

    Returns:
        The refit at the best scale of the ladder at or below the first, or at a lower one that is
        as good but for `INDIFFERENT`.

    Raises:
        NumericalError: If the first refit could not be evaluated.
    """
    best: ProcessNoiseFit | None = None
    values, least = dict(start or {}), np.inf
    if noise_scale is None:
        noise_scale = likely_scale(model, recordings, {p.name: p.mean for p in priors} | values)
    first = int(np.argmin(np.abs(np.log(np.array(ladder) / noise_scale))))
    for level in ladder[first:] if follow else ladder[first : first + 1]:
        try:
            trial = refit(
                model, recordings, priors=priors, stages=(level,), start=values, enough=enough
            )
        except NumericalError:
            # Equations trusted more than they deserve throw the filter out of its range.
            if best is None:
                raise
            break
        # Where the recordings do not mind, the equations are trusted more.
        if trial.cost >= least + INDIFFERENT:
            break
        least = min(trial.cost, least)
        best = ProcessNoiseFit(trial, level, best and replace(best, passed=None))
        values = trial.values
    assert best is not None
    return best


def likely_scale(
    model: Model, recordings: Sequence[Observed], values: Mapping[str, float]
) -> float:
    """Return the process-noise scale, 3 or more, under which the first recording is most likely.

    A refit begins there: the disturbance that a plant declares may be wrong by a hundred, and a
    filter that trusts the equations far more than they deserve has no slope that leads to better
    values.

    Args:
        values: Values of some parameters by name, in SI.

    Returns:
        A step of the ladder, dimensionless.
    """
    first = recordings[0]
    p = model.with_parameters(values).values
    least, best = np.inf, _USUAL
    # Of equations that are far off, a little more noise may be less likely than none.
    for scale in (s for s in reversed(LADDER) if s >= _USUAL):
        with contextlib.suppress(NumericalError):
            cost = filter_of(model, first, scale).run(first, p).cost
            if cost <= least:
                least, best = cost, scale
    return best


def blocks_of_cost(fit: ProcessNoiseFit, recordings: Sequence[Observed]) -> Vector:
    """Return minus the log likelihood, dimensionless, under a fitted model by blocks of time.

    The recordings, used or not used for the fit, have a start for this model.

    Raises:
        NumericalError: If the filter leaves the finite numbers.
    """
    filter_ = filter_of(fit.model, recordings[0], fit.noise_scale)
    parts = filter_.along(recordings, fit.model.values)
    costs = [np.nan_to_num(0.5 * p.whitened**2 + p.log_deviation).sum(axis=1) for p in parts]
    return np.concatenate([summed_over_blocks(c) for c in costs])


def blocks_as_trusted(fit: ProcessNoiseFit, recordings: Sequence[Observed]) -> Vector:
    """Return `blocks_of_cost` of a fit, trusted less where recordings throw its filter off.

    A model that leaves something out may follow those that it was fitted to, and no others.

    Raises:
        NumericalError: If the filter leaves the finite numbers however little it is trusted.
    """
    for scale in (fit.noise_scale, *(s for s in reversed(LADDER) if s > fit.noise_scale)):
        with contextlib.suppress(NumericalError):
            return blocks_of_cost(replace(fit, noise_scale=scale), recordings)
    return blocks_of_cost(fit, recordings)


def ranges_along(
    fit: ProcessNoiseFit, recordings: Sequence[Observed]
) -> dict[str, tuple[float, float]]:
    """Return smallest and largest value of every port and state along recordings, in SI.

    With them those of the terms that add up at a port, of the difference of each two states of the
    plant in one unit, and of what each refitted parameter multiplies.

    Those of a sensor's port are measured, all others follow from the filtered states. A few of the
    samples at each end are left out.

    Raises:
        NumericalError: If the filter leaves the finite numbers.
    """
    model, trace = fit.model, fit.model.exact
    places = Survey(model).places
    seen_at = (q for at in places for q in (*at.signals.values(), *at.carried.values()))
    apart = {q.apart: q for q in seen_at if q.minus}
    values_of = dict(zip(trace.signal_names, ca.vertsplit(trace.signals), strict=True))
    entering = {
        argument_of(q.name): [cofactor(values_of[port.name], trace.p[i]) for port in trace.ports]
        for i, q in enumerate(model.parameters)
        if q.fitted and "." not in q.name
    }
    arguments = {name: [e for e in each if e is not None] for name, each in entering.items()}
    told = {name: each[0] for name, each in arguments.items() if each}
    for port in trace.ports:
        added = terms(values_of[port.name])
        told |= {term_of(port.name, k): e for k, e in enumerate(added) if len(added) > 1}
    moving = (q.name for q in (*model.states, *model.inputs))
    names = (*trace.signal_names, *moving, *told)
    seen: dict[str, list[Vector]] = {}
    for observed in recordings:
        filter_ = filter_of(model, observed, fit.noise_scale)
        every = max(1, len(observed.outputs) // _LOOKS)
        states = filter_.run(observed, model.values).states[::every]
        along = trace.signals, ca.vcat([*told.values()] or [ca.SX(0, 1)])
        signals, own = trace.along(states, observed.inputs[::every], model.values, *along)
        columns = *signals[:, :, 0].T, *states.T, *observed.inputs[::every].T, *own[:, :, 0].T
        named = dict(zip(names, columns, strict=True))
        named |= {name: q.ratio * named[q.source] - named[q.minus] for name, q in apart.items()}
        for name, column in zip(observed.used, observed.outputs.T, strict=True):
            named[f"{name}.reading"] = column
            clipped, limit = clipped_samples(column[np.isfinite(column)])
            if clipped.any():
                named[end_of(f"{name}.reading")] = np.array([limit])
        for name, values in named.items():
            seen.setdefault(name, []).append(values[np.isfinite(values)])
    return {
        name: (float(low), float(high))
        for name, parts in seen.items()
        if (values := np.concatenate(parts)).size
        for low, high in [np.quantile(values, _ENDS)]
    }


def summed_over_blocks(values: Vector) -> Vector:
    """Sum samples over blocks of time that are long enough to be taken as independent.

    A block is a fortieth of the recording, and 20 samples at least.

    Args:
        values: One row per sample, shape (n, ...), in any unit.

    Returns:
        Sums, shape (n_blocks, ...), in the same unit.

    Example:
        >>> summed_over_blocks(np.ones(1000)).tolist() == [25.0] * 40
        True
    """
    size = max(_LEAST_BLOCK, len(values) // _BLOCKS)
    return np.asarray(np.add.reduceat(values, np.arange(0, len(values), size), axis=0))


def perfect_cost(model: Model, recordings: Sequence[Observed]) -> float:
    """Return minus the log likelihood, dimensionless, to be expected if the model left nothing out.

    The filter runs along measurements that the model itself gives for the inputs, with the noise
    and the smallest scale of the ladder: ``sum (1/2 + log s)``, s the standard deviations of its
    prediction errors. The model has parameters near those of the recordings. One that runs away or
    leaves its range, as an integrator without its controller, tells none: its errors have the
    covariance of the noise, times the square of what a deviation grows by from sample to sample.
    """
    first = recordings[0]
    tight, blind = (filter_of(model, first, noise_scale) for noise_scale in (LADDER[-1], 1e-9))
    total = 0.0
    for observed in recordings:
        if not observed.diverges:
            with contextlib.suppress(NumericalError):
                # A filter that trusts no measurement simulates.
                own = blind.expected(observed, blind.run(observed.unread(), model.values))
                part = tight.run(replace(observed, outputs=own), model.values)
                used = np.isfinite(part.log_deviation)
                total += float(np.sum(0.5 + part.log_deviation[used]))
                continue
        scale = [model.outputs[i].scale for i in observed.rows(model)]
        logs = 0.5 + np.log(np.maximum(observed.white_noise_rms / scale, 1e-12))
        total += float(np.sum(logs[np.isfinite(observed.told)]))
        total += max(observed.growth, 0.0) * observed.sample_time * len(logs)
    return total


def gain_interval(
    before: Vector, after: Vector, *, draws: int = 2000, seed: int = 0
) -> tuple[float, float, float]:
    """Return how much log likelihood a model gains over another, with a bootstrap interval.

    Args:
        before: Cost by block under the one model, shape (n_blocks,), dimensionless.
        after: Cost by block under the other, shape (n_blocks,), dimensionless.

    Returns:
        The gain, and the 0.5 % and 99.5 % points over resampled blocks, dimensionless.
    """
    gains = before - after
    rng = np.random.default_rng(seed)
    sums = rng.choice(gains, size=(draws, len(gains))).sum(axis=1)
    low, high = np.quantile(sums, [0.005, 0.995])
    return float(gains.sum()), float(low), float(high)


def start_values(fit: Refit, priors: Sequence[Prior]) -> dict[str, float]:
    """Return where to start the next refit, in SI: estimates, but priors for those on a bound.

    All of a whole is no bound that a value was driven to.
    """
    means = {p.name: p.mean for p in priors}
    driven = (e for e in fit.estimates if e.on_bound and not (e.unit == "1" and e.value >= 1.0))
    return fit.values | {e.name: means.get(e.name, e.value) for e in driven}
