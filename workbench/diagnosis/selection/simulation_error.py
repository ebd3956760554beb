"""Refitting to free runs, for equations that are known to leave something out.

Prediction errors weigh what the next sample shows. Where equations lack something, its estimates
are those of the best corrector, not of the best model: a filter takes out every slow mistake. The
parameters under which the model, never corrected, stays closest to the recordings are others.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from workbench.arrays import Vector
from workbench.diagnosis.estimation.free_run import free_runs
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import guesses
from workbench.diagnosis.estimation.process_noise import ProcessNoiseFit
from workbench.diagnosis.estimation.start import slopes_within
from workbench.diagnosis.selection.held_out import pieces, run_errors
from workbench.diagnosis.selection.rules import IMPERFECT
from workbench.model import Model
from workbench.model.model import index_of

_MOST_WORK = 1.5e6
"""Samples times squared number of states times free parameters up to which nobody waits for it."""

_STEP, _EVALUATIONS, _ENOUGH = 1e-3, 40, 1e-3
_LOST, _MOST = 10.0, 1e6
"""Error of a run that ended early, over that of the runs before the refit; and the largest that
counts, whose square is still a number."""

_GUESS, _FAR = 10.0, 30.0
"""Uncertainty of a guess over its value, and how far one refit may go from it."""

_BLOCKS = 20
"""Blocks of time of each run whose errors are taken as independent."""


def closest_runs(
    fit: ProcessNoiseFit,
    nominal: Model,
    fitting: Sequence[Observed],
    judging: Sequence[Observed],
    *,
    robust: bool = False,
) -> ProcessNoiseFit:
    """Refit a model whose equations are imperfect to its free runs, if that helps unseen ones.

    Least squares of the errors of free runs, each output's over its root mean square before, with
    the priors; from there, if asked for, the likeliest values for errors with heavy tails, lest the
    moments in which the model sticks elsewhere decide.

    Args:
        fit: The fit to the prediction errors, from which it begins.
        nominal: The model that the recordings have a start for.

    Returns:
        The fit with other estimates, intervals from the scatter between blocks of time, and from
        how far both are apart where the runs get little closer; the given one where the equations
        leave nothing out, where it would take too long, or where the runs on held-out recordings
        do not get closer. The cost stays that of the given fit.

    Source:
        L. Ljung, System Identification, 2nd ed., section 7.2 (output error); P. J. Huber and E. M.
        Ronchetti, Robust Statistics, 2nd ed., chapter 7.
    """
    samples = sum(len(r.outputs) for r in fitting)
    work = samples * max(len(fit.model.states), 1) ** 2 * len(fit.refit.estimates)
    if fit.noise_scale <= IMPERFECT or work > _MOST_WORK or not judging:
        return fit
    best = fit
    # Whatever a law does where it is refined, the fit that was found stands.
    with contextlib.suppress(Exception):
        begun = [piece for r in fitting for piece in pieces(fit, nominal, r)]
        errors = run_errors(fit, nominal, judging)
        for loss in ("linear", "cauchy") if robust else ("linear",):
            trial = _refitted(best, begun, loss)
            found = run_errors(trial, nominal, judging)
            if (left := found.over(errors)) < 1.0:
                best, errors = _holding(trial, best, left), found
    return best


def _holding(trial: ProcessNoiseFit, before: ProcessNoiseFit, left: float) -> ProcessNoiseFit:
    """Return a fit whose intervals of 95 % reach the estimates before it, as far as these are good.

    Equations without a fault would have both agree.

    Args:
        left: Root mean square of the held-out errors over that before, dimensionless.
    """
    told, known = trial.refit.values, before.refit.values
    apart = left * np.array([told[e.name] - known[e.name] for e in trial.refit.estimates]) / 2.0
    covariance = trial.refit.covariance + np.outer(apart, apart)
    estimates = tuple(
        replace(e, std=float(np.hypot(e.std, by)))
        for e, by in zip(trial.refit.estimates, apart.tolist(), strict=True)
    )
    return replace(trial, refit=replace(trial.refit, estimates=estimates, covariance=covariance))


def _refitted(fit: ProcessNoiseFit, begun: Sequence[Observed], loss: str) -> ProcessNoiseFit:
    model = fit.model
    priors = [*fit.refit.priors, *guesses(model, _GUESS, _FAR)]
    if not priors:
        return fit
    names = [q.name for q in priors]
    columns = [index_of("parameter", name, model.parameters) for name in names]
    values = model.values
    smallest = np.array([0.05 * model.parameters[i].scale for i in columns])
    scale = np.maximum(np.abs(values[columns]), smallest)
    mean, std, low, high = (
        np.array([getattr(q, name) for q in priors]) / scale
        for name in ("mean", "std", "lower", "upper")
    )

    def errors(x: Vector) -> list[Vector]:
        values[columns] = x * scale
        return [run.error for run in free_runs(model, begun, values=values)]

    margin = 1e-6 * np.minimum(high - low, 1.0)
    x0 = np.clip(values[columns] / scale, low + margin, high - margin)
    first = errors(x0)
    finite = [e for e in first if np.isfinite(e).any()]
    if not finite:
        return fit
    unit = np.sqrt(np.nanmean(np.concatenate(finite) ** 2, axis=0))
    unit = np.where(unit > 0.0, unit, 1.0)
    # So many blocks of time are as many independent errors.
    share = np.sqrt(min(1.0, _BLOCKS * len(begun) / sum(len(e) for e in first)))
    read = [np.isfinite(piece.outputs) for piece in begun]

    def residual(x: Vector) -> Vector:
        with np.errstate(over="ignore"):
            off = [np.nan_to_num(e / unit, nan=_LOST) for e in errors(x)]
        found = [
            np.where(seen, np.clip(e, -_MOST, _MOST), 0.0).ravel()
            for e, seen in zip(off, read, strict=True)
        ]
        return np.concatenate([share * np.concatenate(found), (x - mean) / std])

    def slopes(x: Vector) -> Vector:
        return slopes_within(residual, x, residual(x), _STEP, high)

    typical = float(np.median(np.abs(residual(x0)[: -len(x0)]))) or 1.0
    found = least_squares(
        residual,
        x0,
        slopes,
        bounds=(low, high),
        loss=loss,
        f_scale=typical,
        max_nfev=_EVALUATIONS,
        ftol=_ENOUGH,
        xtol=_ENOUGH,
    )
    covariance = _scatter(found.jac, found.fun, np.cumsum([e.size for e in first]))
    best = dict(zip(names, (found.x * scale).tolist(), strict=True))
    return _with_values(fit, best, covariance * np.outer(scale, scale))


def _scatter(jacobian: Vector, residual: Vector, ends: Vector) -> Vector:
    """Return the covariance of the estimates from the scatter of the score between blocks."""
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    score = jacobian * residual[:, None]
    edges = [
        int(edge)
        for a, b in zip([0, *ends[:-1]], ends, strict=True)
        for edge in np.unique(np.linspace(a, b, _BLOCKS, endpoint=False).astype(int))
    ]
    blocks = np.add.reduceat(score, [*edges, ends[-1]], axis=0)
    return np.asarray(inverse @ (blocks.T @ blocks) @ inverse)


def _with_values(
    fit: ProcessNoiseFit, values: Mapping[str, float], covariance: Vector
) -> ProcessNoiseFit:
    """Return a fit with other values; what is no estimate of it stands last among them."""
    count = len(fit.refit.estimates)
    own = covariance[:count, :count]
    estimates = tuple(
        replace(e, value=values[e.name], std=float(std), on_bound=e.prior.is_bound(values[e.name]))
        for e, std in zip(fit.refit.estimates, np.sqrt(np.maximum(np.diag(own), 0.0)), strict=True)
    )
    refit = replace(
        fit.refit,
        model=fit.model.with_parameters(dict(values)),
        estimates=estimates,
        covariance=own,
        inflations=np.ones(count),
    )
    return replace(fit, refit=refit)
