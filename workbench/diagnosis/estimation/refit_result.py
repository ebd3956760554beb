"""Result of a refit: estimates with intervals, what the data do not determine, who disagrees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.diagnosis.estimation.filter import Innovations
from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior
from workbench.errors import NumericalError, WorkbenchError
from workbench.model import Model
from workbench.model.model import index_of
from workbench.model.units import read_with_deviation

_BLOCKS = (0.5, 2.0)
"""Lengths over which prediction errors may be correlated, for the intervals, over the time in which
the response of the machine shows."""

_LEAST_BLOCKS = 8


@dataclass(frozen=True)
class Estimate:
    """A refitted parameter.

    Args:
        value: Estimate, in ``unit``.
        std: Standard deviation of the estimate, in ``unit``.
        shown: Unit in which people read it, where that was asked for (`Refit.as_read`) and the unit
            of its size will not do.
    """

    name: str
    unit: str
    value: float
    std: float
    prior: Prior
    on_bound: bool
    shown: str = ""

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the 95 % interval, in ``unit``."""
        return self.value - 1.96 * self.std, self.value + 1.96 * self.std

    def read(self, value: float, std: float) -> tuple[float, float, str]:
        """Return a value of the parameter and its deviation, in SI, as people read them."""
        size = max(abs(self.prior.mean), abs(self.value))
        return read_with_deviation(value, std, self.unit, self.shown, size)

    def __str__(self) -> str:
        value, std, unit = self.read(self.value, self.std)
        mean, spread, _ = self.read(self.prior.mean, self.prior.std)
        line = (
            f"{self.name:<30} {value:>10.5g} +- {std:<10.2g} {unit.removesuffix('1'):<14}"
            f" prior {mean:.5g} +- {spread:.2g}"
        )
        return line + ("  ON BOUND" if self.on_bound else "")


@dataclass(frozen=True)
class Refit:
    """Result of a refit.

    Args:
        covariance: Covariance of the estimates, shape (n_free, n_free), in SI.
        cost: Minus the log likelihood of the last pass, with the priors; dimensionless.
        whiteness: Mean square of the whitened prediction errors by output, dimensionless; 1
            where the model explains the recordings to the noise.
        unidentifiable: Combinations of parameters that the recordings do not determine.
        disagreements: Parameters whose estimates from single recordings disagree.
        noise_scale: Process-noise scale that the filter allowed, dimensionless.
        inflations: Factor of each standard deviation for correlated errors, shape (n_free,),
            dimensionless.

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
    noise_scale: float = 0.0
    inflations: Vector = field(default_factory=lambda: np.ones(0))

    @property
    def as_read(self) -> tuple[Estimate, ...]:
        """Estimates with the units in which people read them."""
        return tuple(replace(e, shown=self.model.read_in(e.name)) for e in self.estimates)

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name, in SI."""
        return {e.name: e.value for e in self.estimates}

    @property
    def priors(self) -> tuple[Prior, ...]:
        """Priors of the parameters that were refitted."""
        return tuple(e.prior for e in self.estimates)

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """Draw values by name, in SI, from the distribution of the estimates, within bounds."""
        # In SI units the variance of one may be less than what is lost of that of another.
        size = np.sqrt(np.diag(self.covariance))
        per = np.where(size > 0.0, size, 1.0)
        eigenvalues, vectors = np.linalg.eigh(self.covariance / np.outer(per, per))
        root = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
        off = size * (root @ rng.normal(size=len(self.estimates)))
        return {
            e.name: float(np.clip(e.value + by, e.prior.lower, e.prior.upper))
            for e, by in zip(self.estimates, off, strict=True)
        }

    def estimate(self, name: str) -> Estimate:
        """Return the estimate of a parameter."""
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise WorkbenchError(
            f"parameter {name!r} was not refitted; these were:"
            f" {', '.join(e.name for e in self.estimates)}"
        )

    def __str__(self) -> str:
        state = "converged" if self.converged else "NOT CONVERGED"
        lines = [f"refit of {self.model.name}: {state}, {self.iterations} steps"]
        lines += [f"  {estimate}" for estimate in self.as_read]
        white = ", ".join(f"{k} {v:.3g}" for k, v in self.whiteness.items())
        lines += [f"  mean square of whitened prediction errors: {white}"]
        lines += [f"  not determined by the data: {text}" for text in self.unidentifiable]
        lines += [f"  recordings disagree on {text}" for text in self.disagreements]
        return "\n".join(lines)


@dataclass(frozen=True)
class Outcome:
    """Where a search for the best parameters ended.

    Args:
        values: Values of the free parameters, shape (n_free,), in SI.
        cost: Minus the log likelihood with the priors, dimensionless.
        noise_scale: Process-noise scale in the last pass, dimensionless.
    """

    values: Vector
    parts: Sequence[Innovations]
    cost: float
    converged: bool
    iterations: int
    noise_scale: float


def summarise(
    model: Model, recordings: Sequence[Observed], priors: Sequence[Prior], outcome: Outcome
) -> Refit:
    """Turn the end of a search into estimates with intervals.

    Returns:
        Estimates, their covariance, and what to know when reading them.
    """
    names = [p.name for p in priors]
    quantities = [model.parameters[index_of("parameter", n, model.parameters)] for n in names]
    scale = np.array([q.scale for q in quantities])
    std = np.array([p.std for p in priors])
    prior = np.diag((scale / std) ** 2)
    information = np.zeros_like(prior)
    scatter = np.zeros((len(_BLOCKS), *prior.shape))
    single = []
    for part, observed in zip(outcome.parts, recordings, strict=True):
        one, spread = _information(part, observed.horizon / observed.sample_time)
        information, scatter = information + one, scatter + spread
        single.append((one, spread, part))
    if not np.isfinite(information).all():
        raise NumericalError(
            f"the derivatives of {model.name!r} leave the range of numbers at the refitted values"
        )
    inverse = _inverse(information + prior)
    # Correlated errors carry less information than white ones: never report less than either.
    inflation = np.sqrt(_spread(inverse, scatter, prior) / np.diag(inverse))
    covariance = np.outer(inflation * scale, inflation * scale) * inverse
    deviations = np.sqrt(np.diag(covariance))
    estimates = tuple(
        Estimate(p.name, q.unit, float(v), float(s), p, p.is_bound(float(v)))
        for p, q, v, s in zip(priors, quantities, outcome.values, deviations, strict=True)
    )
    used = recordings[0].used
    squares = np.concatenate([part.whitened for part in outcome.parts]) ** 2
    return Refit(
        model=model.with_parameters(dict(zip(names, outcome.values.tolist(), strict=True))),
        estimates=estimates,
        covariance=covariance,
        cost=outcome.cost,
        converged=outcome.converged,
        iterations=outcome.iterations,
        noise_scale=outcome.noise_scale,
        inflations=inflation,
        whiteness=dict(zip(used, np.nanmean(squares, axis=0).tolist(), strict=True)),
        unidentifiable=_unidentifiable(names, information, std / scale),
        disagreements=_disagreements(names, recordings, single, prior),
    )


def _inverse(information: Vector) -> Vector:
    """Invert an information matrix so that no variance is negative, whatever is hardly told."""
    size = np.sqrt(np.diag(information))
    eigenvalues, vectors = np.linalg.eigh(information / np.outer(size, size))
    kept = np.maximum(eigenvalues, len(size) * np.finfo(float).eps)
    return np.asarray((vectors / kept) @ vectors.T / np.outer(size, size))


@np.errstate(over="ignore", invalid="ignore")
def _information(part: Innovations, horizon: float) -> tuple[Vector, Vector]:
    """Information of white errors, and the scatter of the score over blocks of each length.

    Args:
        horizon: Samples in which the response of the machine shows.
    """
    errors = np.nan_to_num(part.whitened)
    score = np.einsum("kyf,ky->kf", part.jacobian, errors)
    rows = part.jacobian.reshape(score.shape[0] * errors.shape[1], score.shape[1])
    scatters: list[Vector] = []
    for length in _BLOCKS:
        if scatters and len(score) < _LEAST_BLOCKS * length * horizon:
            # Too few blocks say nothing of their scatter.
            scatters.append(scatters[-1])
            continue
        # Of a slow machine less than these times may be recorded.
        size = max(1, min(round(length * horizon), len(score) // _LEAST_BLOCKS))
        edges = np.arange(0, len(score), size)
        blocks = np.add.reduceat(score, edges, axis=0)
        blocks = blocks - blocks.mean(axis=0)
        scatters.append(blocks.T @ blocks)
    return rows.T @ rows, np.array(scatters)


def _spread(inverse: npt.NDArray[np.floating[Any]], scatter: Vector, prior: Vector) -> Vector:
    """Variances of the estimates: of white errors, or of correlated ones where that is more."""
    sandwiches = inverse @ (scatter + prior) @ inverse
    return np.asarray(
        np.maximum(np.diag(inverse), np.diagonal(sandwiches, axis1=1, axis2=2).max(axis=0))
    )


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
        inverse = _inverse(information + prior)
        score = np.einsum("kyf,ky->f", part.jacobian, np.nan_to_num(part.whitened))
        steps.append(-inverse @ score)
        variances.append(_spread(inverse, scatter, prior))
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
