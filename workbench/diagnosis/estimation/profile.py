"""Profile likelihood: how much worse the recordings fit when one parameter is held elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from workbench.diagnosis.estimation.prediction_error import Observed
from workbench.diagnosis.estimation.priors import Prior, without_prior
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.estimation.refit_result import Refit
from workbench.errors import NumericalError, WorkbenchError, check_range

Vector = npt.NDArray[np.float64]

_REACH = 2.5
"""How far the profile reaches, in standard deviations of the estimate."""


@dataclass(frozen=True)
class Profile:
    """A profile likelihood.

    Args:
        name: Name of the parameter.
        unit: Its SI unit.
        values: Values at which it was held, shape (n,), in ``unit``.
        loss: Log likelihood lost there, all other parameters refitted, shape (n,), dimensionless.
        interval: Where the loss stays below the limit, in ``unit``; infinite where it never
            reaches it within the profile.

    Example:
        >>> print(Profile("mass", "kg", np.array([1.0]), np.array([0.0]), (0.9, 1.1)))
        mass: 0.9 to 1.1 kg by profile likelihood
    """

    name: str
    unit: str
    values: Vector
    loss: Vector
    interval: tuple[float, float]

    def __str__(self) -> str:
        """Return the interval in one line."""
        low, high = self.interval
        return f"{self.name}: {low:.5g} to {high:.5g} {self.unit} by profile likelihood"


def profile(
    found: Refit,
    recordings: Sequence[Observed],
    name: str,
    *,
    points: int = 7,
    confidence: float = 0.95,
    priors: Sequence[Prior] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Profile:
    """Hold one parameter at several values, refit the others, and see what the fit loses.

    The interval is where ``2 loss / inflation^2`` stays below the quantile of chi-squared with one
    degree of freedom; the inflation is that of the estimate's standard deviation by correlated
    errors. Unlike the interval of the estimate it may be one-sided or skewed.

    Args:
        found: A refit in which the parameter was free.
        recordings: The recordings that it was made from.
        name: Name of the parameter.
        points: Number of values, 3 to 51.
        confidence: Probability of the interval, 0.5 to 0.9999, dimensionless.
        priors: Priors of the refit; those of its estimates by default.
        progress: Called with a line of text before each value.

    Returns:
        The profile.

    Raises:
        WorkbenchError: If the parameter was not free or an argument is outside its range.

    Example:
        >>> from workbench.diagnosis.estimation.made_up import made_up_axis
        >>> from workbench.plants.servo_axis import servo_axis
        >>> seen = [made_up_axis(0)]
        >>> shape = profile(refit(servo_axis(), seen), seen, "mass", points=3)
        >>> shape.interval[0] < 100.0 < shape.interval[1]
        True
    """
    from scipy.stats import chi2

    check_range("points of the profile", points, 3, 51)
    check_range("confidence", confidence, 0.5, 0.9999)
    estimate = found.estimate(name)
    if estimate.on_bound:
        raise WorkbenchError(
            f"{name} sits on a bound, so its profile has no middle; widen the bound or fix it"
        )
    known = tuple(priors) if priors is not None else tuple(e.prior for e in found.estimates)
    others = without_prior(known, name)
    own = next(p for p in known if p.name == name)
    low = max(own.lower, estimate.value - _REACH * estimate.std)
    high = min(own.upper, estimate.value + _REACH * estimate.std)
    values = np.linspace(low, high, points)
    values = np.unique(np.append(values, estimate.value))
    start = {e.name: e.value for e in found.estimates if e.name != name}
    costs = np.full(len(values), np.inf)
    for i, value in enumerate(values):
        if progress:
            progress(f"{name} held at {value:.5g}")
        fixed = found.model.with_parameters({name: float(value)})
        prior_cost = 0.5 * ((value - own.mean) / own.std) ** 2
        try:
            trial = refit(fixed, recordings, priors=others, stages=(found.share,), start=start)
        except NumericalError:
            continue
        costs[i] = trial.cost + prior_cost
    loss = costs - costs.min()
    limit = 0.5 * float(chi2.ppf(confidence, 1)) * found.inflation(name) ** 2
    return Profile(name, estimate.unit, values, loss, _crossings(values, loss, limit))


def _crossings(values: Vector, loss: Vector, limit: float) -> tuple[float, float]:
    best = int(np.argmin(loss))
    ends = []
    for side, far in ((slice(best, None, -1), -np.inf), (slice(best, None), np.inf)):
        v, e = values[side], loss[side]
        above = np.flatnonzero(e > limit)
        if not above.size:
            ends.append(far)
            continue
        k = int(above[0])
        # Near its minimum the loss is a parabola, so its root is interpolated.
        a, b = np.sqrt(e[k - 1]), np.sqrt(min(e[k], 1e12))
        share = (np.sqrt(limit) - a) / (b - a)
        ends.append(float(v[k - 1] + share * (v[k] - v[k - 1])))
    return ends[0], ends[1]
