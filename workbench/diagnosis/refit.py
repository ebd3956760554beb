"""Refitting: the parameters of a model from recordings, with intervals.

Gauss-Newton on the whitened prediction errors of an extended Kalman filter, jointly over all
recordings, with the parameters' bounds and priors. The first passes let the filter take up
unmodelled signals at the ports, which keeps them away from local minima; the last pass trusts the
equations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.diagnosis.prediction_error import (
    Innovations,
    Observed,
    PredictionError,
    stack,
)
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Model
from workbench.model.model import index_of

Vector = npt.NDArray[np.float64]

STAGES = (1.0, 0.03)
"""Shares of the expected disturbance that the filter allows in successive passes."""

_ITERATIONS = 15
_GAIN = 0.05
"""A step that gains less log likelihood than this ends the last pass."""

_BLOCK_S = 0.5
"""Length over which prediction errors may be correlated, for the intervals, s."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter before the data: a normal distribution within bounds.

    Args:
        name: Name of the parameter.
        mean: Most likely value, in the parameter's SI unit.
        std: Standard deviation, in the parameter's SI unit.
        lower: Smallest value, in the parameter's SI unit.
        upper: Largest value, in the parameter's SI unit.

    Example:
        >>> Prior("load", 3.0, 0.1, 0.0, 8.0).mean
        3.0
    """

    name: str
    mean: float
    std: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Estimate:
    """A refitted parameter.

    Args:
        name: Name of the parameter.
        unit: SI unit.
        value: Estimate, in ``unit``.
        std: Standard deviation of the estimate, in ``unit``.
        prior: What was known before.
        on_bound: Whether the estimate sits on one of its bounds.

    Example:
        >>> prior = Prior("load", 3.0, 0.1, 0.0, 8.0)
        >>> print(Estimate("load", "kg", 3.02, 0.01, prior, False))
        load                                 3.02 +- 0.01       kg             prior 3 +- 0.1
    """

    name: str
    unit: str
    value: float
    std: float
    prior: Prior
    on_bound: bool

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the 95 % interval, in ``unit``."""
        return self.value - 1.96 * self.std, self.value + 1.96 * self.std

    def __str__(self) -> str:
        """Return one aligned line."""
        line = (
            f"{self.name:<30} {self.value:>10.5g} +- {self.std:<10.2g} {self.unit:<14}"
            f" prior {self.prior.mean:.5g} +- {self.prior.std:.2g}"
        )
        return line + ("  ON BOUND" if self.on_bound else "")


@dataclass(frozen=True)
class Refit:
    """Result of a refit.

    Args:
        model: The model with the estimated parameter values.
        estimates: The free parameters.
        covariance: Covariance of the estimates, shape (n_free, n_free), in SI.
        cost: Minus the log likelihood of the last pass, with the priors.
        converged: Whether the last pass converged.
        iterations: Gauss-Newton steps of all passes.
        whiteness: Mean square of the whitened prediction errors by output, 1 where the model
            explains the recordings to the noise.
        unidentifiable: Combinations of parameters that the recordings do not determine.
        disagreements: Parameters whose estimates from single recordings disagree.

    Raises:
        WorkbenchError: From `estimate`, if the parameter was not free.
    """

    model: Model
    estimates: tuple[Estimate, ...]
    covariance: Vector
    cost: float
    converged: bool
    iterations: int
    whiteness: Mapping[str, float]
    unidentifiable: tuple[str, ...]
    disagreements: tuple[str, ...]

    def estimate(self, name: str) -> Estimate:
        """Return the estimate of a parameter.

        Args:
            name: Name of the parameter.

        Raises:
            WorkbenchError: If the parameter was not free.
        """
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise WorkbenchError(
            f"parameter {name!r} was not refitted; these were:"
            f" {', '.join(e.name for e in self.estimates)}"
        )

    @property
    def correlation(self) -> Vector:
        """Correlation of the estimates, shape (n_free, n_free), dimensionless."""
        std = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(std, std))

    def __str__(self) -> str:
        """Return a short aligned table."""
        state = "converged" if self.converged else "NOT CONVERGED"
        lines = [f"refit of {self.model.name}: {state}, {self.iterations} steps"]
        lines += [f"  {estimate}" for estimate in self.estimates]
        white = ", ".join(f"{k} {v:.3g}" for k, v in self.whiteness.items())
        lines += [f"  mean square of whitened prediction errors: {white}"]
        lines += [f"  not determined by the data: {text}" for text in self.unidentifiable]
        lines += [f"  recordings disagree on {text}" for text in self.disagreements]
        return "\n".join(lines)


def default_priors(model: Model, names: Sequence[str] | None = None) -> tuple[Prior, ...]:
    """Return priors centred on a model's values, a quarter of the bounds wide.

    Args:
        model: The plant.
        names: Names of the free parameters; all that a refit may change by default.

    Returns:
        One prior per free parameter.

    Raises:
        WorkbenchError: If a name is unknown or a parameter has no bounds.

    Example:
        >>> from workbench.plants.servo_axis import servo_axis
        >>> [prior.name for prior in default_priors(servo_axis())][:2]
        ['mass', 'offset']
    """
    chosen = [q.name for q in model.parameters if q.fitted] if names is None else list(names)
    priors = []
    for name in chosen:
        q = model.parameters[index_of("parameter", name, model.parameters)]
        if not (np.isfinite(q.lower) and np.isfinite(q.upper)):
            raise WorkbenchError(
                f"parameter {name} has the bounds {q.lower:g} to {q.upper:g} {q.unit}; a free"
                " parameter needs finite bounds"
            )
        priors.append(Prior(name, q.value, (q.upper - q.lower) / 4, q.lower, q.upper))
    return tuple(priors)


def refit(
    model: Model,
    recordings: Sequence[Observed],
    *,
    priors: Sequence[Prior] | None = None,
    stages: Sequence[float] = STAGES,
    start: Mapping[str, float] | None = None,
    starts: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
) -> Refit:
    """Estimate parameters of a model from recordings.

    Minimises ``sum (e^2 / 2 + log s) + sum ((p - mean) / std)^2 / 2`` over the parameters, e the
    innovations of an extended Kalman filter divided by their standard deviations s.

    Args:
        model: The plant.
        recordings: Recordings as `observe` returns them, all with the same outputs and sample
            time.
        priors: The free parameters; `default_priors` by default.
        stages: Shares of the disturbance expected at the ports, pass by pass.
        start: Where to start some parameters, by name, in SI; at the prior by default.
        starts: Number of starts; those after the first are drawn from the priors.
        seed: Seed of the draws.
        progress: Called with a line of text before each pass.

    Returns:
        Estimates with intervals, of the best start.

    Raises:
        WorkbenchError: If there is no recording, or recordings do not fit together.
        NumericalError: If no start could be evaluated.
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
    best: _Search | None = None
    failures = []
    for attempt in range(max(1, starts)):
        values = {p.name: p.mean for p in known} | dict(start or {})
        if attempt:
            values = {
                p.name: float(np.clip(rng.normal(p.mean, p.std), p.lower, p.upper)) for p in known
            }
        try:
            search = _search(model, recordings, known, values, stages, progress)
        except NumericalError as error:
            failures.append(str(error))
            continue
        if best is None or search.cost < best.cost:
            best = search
    if best is None:
        raise NumericalError(failures[0])
    return _summary(model, recordings, known, best)


@dataclass
class _Search:
    values: Vector
    parts: list[Innovations]
    cost: float
    converged: bool
    iterations: int


def _search(
    model: Model,
    recordings: Sequence[Observed],
    priors: Sequence[Prior],
    start: Mapping[str, float],
    stages: Sequence[float],
    progress: Progress | None,
) -> _Search:
    names = tuple(p.name for p in priors)
    columns = [index_of("parameter", n, model.parameters) for n in names]
    scale = np.array([model.parameters[i].scale for i in columns])
    mean, std = np.array([p.mean for p in priors]), np.array([p.std for p in priors])
    lower = np.array([p.lower for p in priors])
    upper = np.array([p.upper for p in priors])
    values = np.array([start[n] for n in names], dtype=float)
    iterations = 0
    for number, share in enumerate(stages):
        if progress:
            progress(f"refit pass {number + 1} of {len(stages)}")
        filter_ = PredictionError(
            model,
            recordings[0].sample_time,
            recordings[0].used,
            names,
            {q.name: share * q.disturbance for q in model.ports if share * q.disturbance > 0},
        )

        def evaluate(
            trial: Vector, filter_: PredictionError = filter_
        ) -> tuple[list[Innovations], float]:
            p = model.values
            p[columns] = trial
            parts = [filter_.run(r, p) for r in recordings]
            return parts, sum(part.cost for part in parts) + 0.5 * float(
                np.sum(((trial - mean) / std) ** 2)
            )

        parts, cost = evaluate(values)
        damping, converged = 1e-3, False
        enough = _GAIN if number == len(stages) - 1 else 100 * _GAIN
        for _ in range(_ITERATIONS):
            iterations += 1
            moved = False
            for _ in range(6):
                trial = _step(parts, values, mean, std, lower, upper, scale, damping)
                change = np.abs(trial - values) / std
                try:
                    trial_parts, trial_cost = evaluate(trial)
                except NumericalError:
                    trial_cost = np.inf
                if trial_cost < cost:
                    moved = True
                    gained, cost = cost - trial_cost, trial_cost
                    values, parts = trial, trial_parts
                    damping = max(damping / 5, 1e-9)
                    break
                if change.max(initial=0.0) < 1e-3:
                    break
                damping *= 8
            if not moved or gained < enough:
                converged = True
                break
    return _Search(values, parts, cost, converged, iterations)


def _step(
    parts: Sequence[Innovations],
    values: Vector,
    mean: Vector,
    std: Vector,
    lower: Vector,
    upper: Vector,
    scale: Vector,
    damping: float,
) -> Vector:
    """Solve the linearised least squares within the bounds; returns the new values."""
    errors, jacobian = stack(parts)
    hessian = jacobian.T @ jacobian
    gradient = jacobian.T @ errors
    prior = (scale / std) ** 2
    hessian = hessian + np.diag(prior)
    gradient = gradient + prior * (values - mean) / scale
    hessian = hessian + damping * np.diag(np.diag(hessian))
    low, high = (lower - values) / scale, (upper - values) / scale
    free = np.ones(len(values), dtype=bool)
    step = np.zeros(len(values))
    # Active set: parameters that would leave their bounds are put on them, the rest solved again.
    for _ in range(len(values) + 1):
        rhs = -gradient[free] - hessian[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(hessian[np.ix_(free, free)], rhs)
        out = free & ((step < low) | (step > high))
        if not out.any():
            break
        step[out] = np.clip(step[out], low[out], high[out])
        free &= ~out
    return np.asarray(np.clip(values + step * scale, lower, upper))


def _summary(
    model: Model, recordings: Sequence[Observed], priors: Sequence[Prior], search: _Search
) -> Refit:
    names = [p.name for p in priors]
    quantities = [model.parameters[index_of("parameter", n, model.parameters)] for n in names]
    scale = np.array([q.scale for q in quantities])
    std = np.array([p.std for p in priors])
    prior = np.diag((scale / std) ** 2)
    information, scatter = np.zeros_like(prior), np.zeros_like(prior)
    single = []
    for part, observed in zip(search.parts, recordings, strict=True):
        one, spread = _information(part, observed.sample_time)
        information, scatter = information + one, scatter + spread
        single.append((one, spread, part))
    inverse = np.linalg.inv(information + prior)
    # Correlated errors carry less information than white ones: never report less than either.
    sandwich = inverse @ (scatter + prior) @ inverse
    inflation = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(inverse), 1.0))
    covariance = np.outer(inflation * scale, inflation * scale) * inverse
    deviations = np.sqrt(np.diag(covariance))
    estimates = tuple(
        Estimate(
            p.name,
            q.unit,
            float(v),
            float(s),
            p,
            bool(min(v - p.lower, p.upper - v) < 1e-3 * (p.upper - p.lower)),
        )
        for p, q, v, s in zip(priors, quantities, search.values, deviations, strict=True)
    )
    used = recordings[0].used
    squares = np.concatenate([part.whitened for part in search.parts]) ** 2
    return Refit(
        model=model.with_parameters(dict(zip(names, search.values.tolist(), strict=True))),
        estimates=estimates,
        covariance=covariance,
        cost=search.cost,
        converged=search.converged,
        iterations=search.iterations,
        whiteness=dict(zip(used, np.nanmean(squares, axis=0).tolist(), strict=True)),
        unidentifiable=_unidentifiable(names, information, std / scale),
        disagreements=_disagreements(names, recordings, single, prior),
    )


def _information(part: Innovations, sample_time: float) -> tuple[Vector, Vector]:
    """Information of white errors, and the scatter of the score over blocks of time."""
    errors = np.nan_to_num(part.whitened)
    score = np.einsum("kyf,ky->kf", part.jacobian, errors)
    rows = part.jacobian.reshape(-1, part.jacobian.shape[2])
    size = max(1, round(_BLOCK_S / sample_time))
    edges = np.arange(0, len(score), size)
    blocks = np.add.reduceat(score, edges, axis=0)
    blocks = blocks - blocks.mean(axis=0)
    return rows.T @ rows, blocks.T @ blocks


def _unidentifiable(
    names: Sequence[str], information: Vector, prior_std: Vector
) -> tuple[str, ...]:
    """Name the combinations of parameters on which the data say less than the priors."""
    relative = np.outer(prior_std, prior_std) * information
    eigenvalues, vectors = np.linalg.eigh(relative)
    found = []
    for value, vector in zip(eigenvalues, vectors.T, strict=True):
        if value < 1.0:
            order = np.argsort(-np.abs(vector))
            kept = [i for i in order if abs(vector[i]) > 0.3]
            terms = [f"{vector[i]:+.2f} {names[i]}" for i in kept]
            found.append(" ".join(terms) + " (in units of the priors)")
    return tuple(found)


def _disagreements(
    names: Sequence[str],
    recordings: Sequence[Observed],
    single: Sequence[tuple[Vector, Vector, Innovations]],
    prior: Vector,
) -> tuple[str, ...]:
    """Compare one Gauss-Newton step of each recording alone, in standard deviations."""
    if len(single) < 2:
        return ()
    steps, variances = [], []
    for information, scatter, part in single:
        inverse = np.linalg.inv(information + prior)
        score = np.einsum("kyf,ky->f", part.jacobian, np.nan_to_num(part.whitened))
        steps.append(-inverse @ score)
        variances.append(
            np.maximum(np.diag(inverse), np.diag(inverse @ (scatter + prior) @ inverse))
        )
    found = []
    for i, name in enumerate(names):
        value = np.array([s[i] for s in steps])
        weight = 1 / np.array([v[i] for v in variances])
        mean = np.sum(weight * value) / np.sum(weight)
        distance = np.abs(value - mean) * np.sqrt(weight)
        worst = int(np.argmax(distance))
        if distance[worst] > 4.0:
            found.append(
                f"{name}: {recordings[worst].name} is {distance[worst]:.1f} standard deviations"
                " from the others"
            )
    return tuple(found)


def without_prior(priors: Sequence[Prior], *names: str) -> tuple[Prior, ...]:
    """Return priors without those of some parameters, which then stay fixed.

    Args:
        priors: Priors of the free parameters.
        names: Names of the parameters to fix.

    Returns:
        The other priors.

    Example:
        >>> without_prior([Prior("a", 0, 1, -1, 1), Prior("b", 0, 1, -1, 1)], "a")[0].name
        'b'
    """
    return tuple(p for p in priors if p.name not in names)


def widened(prior: Prior, factor: float) -> Prior:
    """Return a prior with a larger standard deviation.

    Args:
        prior: The prior.
        factor: Factor on the standard deviation, dimensionless.

    Returns:
        The widened prior; its bounds stay.

    Example:
        >>> widened(Prior("a", 0.0, 1.0, -9.0, 9.0), 3.0).std
        3.0
    """
    return replace(prior, std=prior.std * factor)
