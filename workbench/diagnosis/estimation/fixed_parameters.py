"""Intervals that count what a refit holds although it is not known exactly.

Some parameters scale with others, so that no recording tells them apart: the volume of the muscles
with every flow. One of them is fixed; its uncertainty then belongs to the intervals of the others,
after S. F. Schmidt's consider analysis (1966).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import casadi as ca
import numpy as np

from workbench.diagnosis.estimation.prediction_error import Observed, filter_of
from workbench.diagnosis.estimation.priors import Prior, default_priors, guesses
from workbench.diagnosis.estimation.process_noise import (
    INDIFFERENT,
    ProcessNoiseFit,
    blocks_of_cost,
    extended_start,
    fit_with_process_noise,
)
from workbench.diagnosis.estimation.refit_result import Outcome, summarise
from workbench.errors import NumericalError
from workbench.model import Effect, Model, Parameter

_WITHIN = 0.01
"""Part of a sample to which no device's timing is told: its clock, and what it does first."""

_TWIN, _SEEN = 0.998, 1e-4
"""Square of the cosine of two signatures from which on they are the same, and part of the square of
one that has to be left beside all else that is refitted."""


def with_fixed_uncertainty(fit: ProcessNoiseFit, recordings: Sequence[Observed]) -> ProcessNoiseFit:
    """Widen the intervals of a refit by what the fixed parameters may be wrong.

    ``P = (J^T J + diag(prior variances)^-1)^-1`` over free and fixed parameters together, of which
    the block of the free ones is kept; the estimates stay.
    """
    return _beside(fit, recordings, _still_fixed(fit))


def with_all_uncertainty(fit: ProcessNoiseFit, recordings: Sequence[Observed]) -> ProcessNoiseFit:
    """Widen the intervals of a last refit by all that no recording tells.

    That is what fixed parameters and the guesses of the laws that were found may be wrong, such as
    how fast a slew limit follows small motions; and, for times, when within a sample a machine
    reads and acts. A period is told by all its repetitions.
    """
    estimates = fit.refit.values
    guessed = (q for q in guesses(fit.model, 1.0) if q.name not in estimates)
    wide = _beside(fit, recordings, (*_still_fixed(fit), *guessed)).refit
    periods = {f"{e.name}.{e.about.period}" for e in fit.model.effects if e.about.period}
    known = _WITHIN * recordings[0].sample_time
    added = [known * (e.unit == "s" and e.name not in periods) for e in wide.estimates]
    own = np.array([e.std for e in wide.estimates])
    # What the scatter of free runs tells is never less uncertain than it was.
    std = np.hypot(np.maximum(own, [e.std for e in fit.refit.estimates]), added)
    grown = np.divide(std, own, out=np.ones_like(own), where=own > 0.0)
    told = tuple(replace(e, std=float(s)) for e, s in zip(wide.estimates, std, strict=True))
    covariance = wide.covariance * np.outer(grown, grown)
    return replace(fit, refit=replace(wide, estimates=told, covariance=covariance))


def _still_fixed(fit: ProcessNoiseFit) -> tuple[Prior, ...]:
    """Return the priors of the fixed parameters that a fit has not refitted."""
    estimates = fit.refit.values
    names = [q.name for q in fit.model.parameters if q.fixed and q.name not in estimates]
    return default_priors(fit.model, names)


def _beside(
    fit: ProcessNoiseFit, recordings: Sequence[Observed], uncertain: Sequence[Prior]
) -> ProcessNoiseFit:
    """Return a refit with its estimates, as uncertain as beside parameters that stay."""
    if not uncertain:
        return fit
    model, estimates, own = fit.model, fit.refit.values, fit.refit.priors
    # The value that it has is the best guess of what stays: only its uncertainty counts here.
    every = [*own, *uncertain]
    filter_ = filter_of(model, recordings[0], fit.noise_scale, [p.name for p in every])
    try:
        parts = filter_.along(recordings, model.values)
    except NumericalError:
        return fit
    outcome = Outcome(
        np.array([estimates.get(p.name, p.mean) for p in every]),
        parts,
        fit.cost,
        fit.refit.converged,
        fit.refit.iterations,
        fit.refit.noise_scale,
    )
    wide = summarise(model, recordings, every, outcome)
    count = len(own)
    return replace(
        fit,
        refit=replace(
            fit.refit,
            estimates=wide.estimates[:count],
            covariance=wide.covariance[:count, :count],
            inflations=wide.inflations[:count],
        ),
    )


def with_fixed_refitted(
    fit: ProcessNoiseFit, fitting: Sequence[Observed], judging: Sequence[Observed]
) -> ProcessNoiseFit:
    """Refit what was left too, where all that was missing is found.

    While something is missing, what is fixed would take its place: a soft stop that of an angle
    that is off. Once nothing is, its true value moves the others to theirs.

    Args:
        fitting: Fitting recordings, with a start for the fit's model.
        judging: Held-out recordings, with a start for it.

    Returns:
        The fit with the fixed parameters among its estimates; the given one where it does not
        converge, or where it makes the held-out recordings less likely.
    """
    model, refit = fit.model, fit.refit
    start, fixed = refit.values, _still_fixed(fit)
    if not fixed:
        return fit
    priors = [*refit.priors, *fixed]
    # Values that the filter cannot follow are no better ones.
    with suppress(NumericalError):
        found = fit_with_process_noise(
            model, fitting, priors, start=start, noise_scale=fit.noise_scale, follow=False
        )
        before, after = (float(blocks_of_cost(one, judging).sum()) for one in (fit, found))
        if found.refit.converged and after < before:
            return found
    return fit


def value_instead(
    fit: ProcessNoiseFit,
    effect: Effect,
    size: str,
    nominal: Model,
    recordings: Sequence[Observed],
) -> tuple[str, float] | None:
    """Find a value that no refit changes and that, if it is wrong, does what an effect does.

    Both signatures are taken beside those of all else that is refitted, and where they are one the
    value is refitted in place of the effect. Only what enters the equations where the effect acts
    is looked at; where that is a sensor, a wrong gain may be that of anything it reads.

    Args:
        size: Name of the size of the effect, which is one of those that were refitted.
        nominal: The model that the recordings have a start for.

    Returns:
        The parameter and the value it would have to have, in SI; None if there is none.
    """
    model, free = fit.model, [e.name for e in fit.refit.estimates]
    held = [q for q in _entering(model, effect) if q.name not in free and q.value]
    if f"{effect.name}.{size}" not in free or not held:
        return None
    observed = extended_start(recordings[0], nominal, model)
    filter_ = filter_of(model, observed, fit.noise_scale, [*free, *(q.name for q in held)])
    try:
        rows = np.nan_to_num(filter_.run(observed, model.values).jacobian)
    except NumericalError:
        return None
    rows = rows.reshape(-1, rows.shape[-1]) / filter_.free_scale
    k = free.index(f"{effect.name}.{size}")
    others = np.delete(rows[:, : len(free)], k, axis=1)
    # Each parameter has a unit of its own, and none is too small to count.
    others = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    left = rows - others @ np.linalg.lstsq(others, rows, rcond=None)[0]
    own = left[:, k]
    for q, whole, other in zip(held, rows.T[len(free) :], left.T[len(free) :], strict=True):
        length, shared = float(other @ other), float(own @ other)
        # What nothing depends on has no length at all.
        if length <= _SEEN * float(whole @ whole) or shared**2 < _TWIN * length * float(own @ own):
            continue
        value = q.value + fit.refit.estimates[k].value * shared / length
        # A mass that every force scales with would vanish with them.
        if q.lower <= value <= q.upper and value / q.value > _SEEN:
            # Of what all else scales with the straight line is a tangent only.
            without = fit.model.without(effect.name)
            started = [extended_start(r, nominal, without) for r in recordings]
            if refitted := _in_place(fit, without, q, value, started):
                return q.name, refitted
    return None


def _in_place(
    fit: ProcessNoiseFit, without: Model, q: Parameter, value: float, recordings: Sequence[Observed]
) -> float | None:
    """Refit a value in place of an effect; None unless the recordings are as likely so."""
    kept = [e for e in fit.refit.estimates if e.name in {p.name for p in without.parameters}]
    away = abs(value - q.value)
    lower, upper = max(q.lower, q.value - 4.0 * away), min(q.upper, q.value + 4.0 * away)
    priors = [*(e.prior for e in kept), Prior(q.name, q.value, away, lower, upper)]
    begun = {e.name: e.value for e in kept} | {q.name: value}
    try:
        found = fit_with_process_noise(
            without, recordings, priors, start=begun, noise_scale=fit.noise_scale, follow=False
        )
    except NumericalError:
        return None
    return found.refit.values[q.name] if found.cost < fit.cost + INDIFFERENT else None


def _entering(model: Model, effect: Effect) -> list[Parameter]:
    """Return the parameters of a plant that enter what an effect acts on, or what that moves.

    What a sensor reads is moved by all of them.
    """
    t, names = model.exact, [port.name for port in model.ports]
    if all(port.endswith(".reading") for port in effect.ports):
        return [q for q in model.parameters if "." not in q.name]
    at = [names.index(port) for port in effect.ports]
    places = [t.signals[t.signal_names.index(names[i])] for i in at]
    entered = ca.vertcat(*(t.rates_by_port[:, i] for i in at), *places)
    own = ((k, q) for k, q in enumerate(model.parameters) if "." not in q.name)
    return [q for k, q in own if ca.depends_on(entered, t.p[k])]
