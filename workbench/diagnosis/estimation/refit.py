"""Refitting: the parameters of a model from recordings, with intervals.

Gauss-Newton on the whitened prediction errors of an extended Kalman filter, jointly over all
recordings, with the parameters' bounds and priors. The first passes let the filter take up
unmodelled signals at the ports, which keeps them away from local minima; the last pass trusts the
equations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from workbench.arrays import Vector
from workbench.diagnosis.estimation.filter import OUTLIER_SIGMA, Innovations, is_outlier
from workbench.diagnosis.estimation.prediction_error import (
    Observed,
    PredictionError,
    disturbances,
    stack,
)
from workbench.diagnosis.estimation.priors import Prior, default_priors
from workbench.diagnosis.estimation.refit_result import Outcome, Refit, summarise
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Model
from workbench.model.model import index_of

STAGES = (1.0, 0.03)
"""Process-noise scales that the filter allows in successive passes."""

_ITERATIONS = 15

ENOUGH = 0.05
"""A step that gains less log likelihood than this ends the last pass."""

_ATTEMPTS, _AS_OUTLIERS, _STEADY = 4, 3, 0.03
"""Dampings that are tried, also of a step that weighs outliers as they cost, which no longer goes
too far; and the damping that this one begins with, dimensionless."""

_HELD = 0.1
"""What a step must promise that holds parameters on the bounds which they would leave at first,
over the best within them."""

Progress = Callable[[str], None]
Evaluate = Callable[[Vector], tuple[list[Innovations], float]]


def refit(
    model: Model,
    recordings: Sequence[Observed],
    *,
    priors: Sequence[Prior] | None = None,
    stages: Sequence[float] = STAGES,
    start: Mapping[str, float] | None = None,
    starts: int = 1,
    seed: int = 0,
    enough: float = ENOUGH,
    pushed: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Refit:
    """Estimate parameters of a model from recordings.

    Minimises ``sum (e^2 / 2 + log s) + sum ((p - mean) / std)^2 / 2`` over the parameters, e the
    innovations of an extended Kalman filter divided by their standard deviations s.

    Args:
        recordings: Recordings as `observe` returns them, all with the same outputs and sample
            time.
        stages: Process-noise scales at the ports, pass by pass, dimensionless.
        start: Where to start some parameters, by name, in SI; at the prior by default.
        starts: Number of starts; those after the first are drawn from the priors.
        pushed: Disturbances by port, rms in its SI unit; those that the model expects by default.
        enough: A step that gains less log likelihood than this ends the last pass, dimensionless.

    Raises:
        WorkbenchError: If there is no recording, or recordings do not fit together.
        NumericalError: If no start could be evaluated.

    Example:
        >>> from workbench.diagnosis.estimation.simulated_recordings import simulated_axis
        >>> from workbench.plants.servo_axis import servo_axis
        >>> found = refit(servo_axis(), [simulated_axis(seed) for seed in (0, 1)])
        >>> low, high = found.estimate("mass").interval
        >>> found.converged, low < 100.0 < high
        (True, True)
    """
    if not recordings:
        raise WorkbenchError("no recording to refit on; give at least one")
    kinds = {(r.used, round(r.sample_time, 9)) for r in recordings}
    if len(kinds) > 1:
        raise WorkbenchError(
            "recordings of one refit need the same outputs and sample time; these have"
            f" {sorted(str(k) for k in kinds)}"
        )
    known = tuple(priors if priors is not None else default_priors(model))
    rng = np.random.default_rng(seed)
    best: Outcome | None = None
    failures = []
    for attempt in range(max(1, starts)):
        values = {p.name: p.mean for p in known} | dict(start or {})
        if attempt:
            values = {
                p.name: float(np.clip(rng.normal(p.mean, p.std), p.lower, p.upper)) for p in known
            }
        try:
            search = _search(model, recordings, known, values, stages, enough, pushed, progress)
        except NumericalError as error:
            failures.append(str(error))
            continue
        if best is None or search.cost < best.cost:
            best = search
    if best is None:
        raise NumericalError(failures[0])
    return summarise(model, recordings, known, best)


def _search(
    model: Model,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    start: Mapping[str, float],
    stages: Sequence[float],
    enough: float,
    pushed: Mapping[str, float] | None,
    progress: Progress | None,
) -> Outcome:
    names = tuple(p.name for p in priors)
    columns = [index_of("parameter", n, model.parameters) for n in names]
    problem = _Problem(priors, np.array([model.parameters[i].scale for i in columns]))
    values = np.array([start[n] for n in names], dtype=float)
    outcome = None
    for number, noise_scale in enumerate(stages):
        if progress:
            progress(f"refit pass {number + 1} of {len(stages)}")
        size = pushed or disturbances(model, 1.0)
        size = {port: noise_scale * rms for port, rms in size.items()}
        filter_ = PredictionError(model, recordings[0], names, size)

        def evaluate(
            trial: Vector, filter_: PredictionError = filter_
        ) -> tuple[list[Innovations], float]:
            p = model.values
            p[columns] = trial
            parts = filter_.along(recordings, p)
            return parts, sum(part.cost for part in parts) + problem.prior_cost(trial)

        # All but the last pass only have to come near.
        near = enough if number == len(stages) - 1 else 100 * enough
        done = outcome.iterations if outcome else 0
        outcome = _descend(problem, values, evaluate, near)
        outcome = replace(outcome, iterations=outcome.iterations + done, noise_scale=noise_scale)
        values = outcome.values
    assert outcome is not None
    return outcome


def _descend(problem: _Problem, values: Vector, evaluate: Evaluate, enough: float) -> Outcome:
    """Take damped Gauss-Newton steps until one promises or gains less than enough."""
    parts, cost = evaluate(values)
    damping, iterations, as_outliers = 1e-3, 0, False
    while iterations < _ITERATIONS:
        iterations += 1
        normal = problem.normal_equations(parts, values, as_outliers=as_outliers)
        for _ in range(_AS_OUTLIERS if as_outliers else _ATTEMPTS):
            trial, promised = problem.step(normal, values, damping)
            if promised < 0.2 * enough:
                return Outcome(values, parts, cost, True, iterations, 0.0)
            try:
                trial_parts, trial_cost = evaluate(trial)
            except NumericalError:
                trial_cost = np.inf
            if trial_cost < cost:
                break
            damping *= 30
        else:
            if not as_outliers and _many_outliers(parts):
                damping, as_outliers = _STEADY, True
                continue
            # The derivatives hold the filter's gain fixed: near the optimum that is all they show.
            return Outcome(values, parts, cost, True, iterations, 0.0)
        gained = cost - trial_cost
        values, parts, cost = trial, trial_parts, trial_cost
        damping, as_outliers = max(damping / 5, 1e-9), False
        if gained < enough:
            return Outcome(values, parts, cost, True, iterations, 0.0)
    return Outcome(values, parts, cost, False, iterations, 0.0)


def _many_outliers(parts: Sequence[Innovations]) -> bool:
    """Whether outliers, weighed as their cost is, are as much of the Hessian as all others."""
    share = np.mean(np.concatenate([is_outlier(part.whitened).ravel() for part in parts]))
    return bool(share * OUTLIER_SIGMA**2 > 1.0)


class _Problem:
    """The free parameters: priors, bounds and scales."""

    def __init__(self, priors: Sequence[Prior], scale: Vector) -> None:
        self._scale = scale
        self._mean, self._std, self._lower, self._upper = (
            np.array([getattr(p, of) for p in priors]) for of in ("mean", "std", "lower", "upper")
        )

    def prior_cost(self, values: Vector) -> float:
        return 0.5 * float(np.sum(((values - self._mean) / self._std) ** 2))

    def normal_equations(
        self, parts: Sequence[Innovations], values: Vector, *, as_outliers: bool = False
    ) -> tuple[Vector, Vector]:
        """Return gradient and Hessian of the linearised cost in scaled parameters.

        Args:
            as_outliers: Whether errors that count as outliers weigh as their cost does, the
                logarithm of an error (iteratively reweighted least squares): a step then takes it
                away, where one of least squares goes as much too far as an outlier weighs less.
        """
        errors, jacobian = stack(parts)
        prior = (self._scale / self._std) ** 2
        # Derivatives beyond the range of numbers end a step, not the search.
        with np.errstate(over="ignore", invalid="ignore"):
            gradient = jacobian.T @ errors + prior * (values - self._mean) / self._scale
            if as_outliers:
                jacobian = np.where(is_outlier(errors), OUTLIER_SIGMA, 1.0)[:, None] * jacobian
            return gradient, jacobian.T @ jacobian + np.diag(prior)

    def step(
        self, normal: tuple[Vector, Vector], values: Vector, damping: float
    ) -> tuple[Vector, float]:
        """Solve within the bounds; returns the new values and the gain they promise."""
        gradient, hessian = normal
        damped = hessian + damping * np.diag(np.diag(hessian))
        low = (self._lower - values) / self._scale
        high = (self._upper - values) / self._scale

        def promised(step: Vector) -> float:
            return -float(gradient @ step + 0.5 * step @ hessian @ step)

        # What would leave its bounds is put on them, and the rest solved again.
        free, step = np.ones(len(values), dtype=bool), np.zeros(len(values))
        for _ in range(len(values) + 1):
            right = -gradient[free] - damped[np.ix_(free, ~free)] @ step[~free]
            step[free] = np.linalg.solve(damped[np.ix_(free, free)], right)
            out = free & ((step < low) | (step > high))
            if not out.any():
                break
            step[out] = np.clip(step[out], low[out], high[out])
            free &= ~out
        if not free.all():
            from scipy.optimize import lsq_linear

            # That may lead uphill, which the best step within the bounds never does.
            factor = np.linalg.cholesky(damped)
            aim = -np.linalg.solve(factor, gradient)
            best = lsq_linear(factor.T, aim, (low, high), method="bvls").x
            step = step if promised(step) > _HELD * promised(best) else best
        trial = np.clip(values + step * self._scale, self._lower, self._upper)
        return trial, promised(step)
