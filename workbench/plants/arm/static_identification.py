"""Identification of the paper's force law from isometric ramps: D1, D2, D3 and phi(q) from data.

Every ramp at constant contraction q is a straight line F = D(q) p + phi(q) while the muscle pulls.
All lines together are one linear regression for the coefficients of D and phi; only the switch
below which phi is constant enters nonlinearly.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyder, polyval, polyvander

from workbench.arrays import Vector
from workbench.errors import NumericalError, WorkbenchError, check_finite, check_range
from workbench.physics.force_laws import BAR, SLACK_WIDTH, PaperLaw

LEVEL_WIDTH = 0.25e-3
"""Contractions closer than this count as one level of the experiment, m."""

_SLACK = 5.0
"""Force below which a muscle counts as slack, N: several times the noise of a load cell."""

_EXCESS = 1.03
"""A lower order of phi is taken if its held-out error is within 3 % of the best."""


@dataclass(frozen=True)
class StaticForceFit:
    """An identified force law with its uncertainty.

    Args:
        names: Names of the identified numbers: ``D1`` to ``D3``, ``phi_0`` to ``phi_n``, and
            ``switch`` where the data show the constant branch of phi.
        units: Their units, of millimetre, bar and newton as in the paper.
        values: Identified numbers, shape (n,), in ``units``.
        covariance: Their covariance, shape (n, n), in products of ``units``.
        quantile: Half width of an interval as a ratio to the standard deviation.
        confidence: Probability that an interval holds the true number, as a fraction.
        held_out: Error on contractions left out of the fit, rms in N on the median contraction, by
            the order of phi; empty if the order was given.
        residual_rms: Error of the fit on its own points, rms in N.
        used: Number of points in which the muscle pulls.
        slack: Number of points left out because the muscle is slack.
        contraction: Smallest and largest contraction of the points used, in m.
        gauge_pressure: Smallest and largest gauge pressure of the points used, in Pa.
    """

    law: PaperLaw
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Vector
    covariance: Vector
    quantile: float
    confidence: float
    held_out: Mapping[int, float]
    residual_rms: float
    used: int
    slack: int
    contraction: tuple[float, float]
    gauge_pressure: tuple[float, float]

    @property
    def order(self) -> int:
        """Order of the polynomial phi."""
        return len(self.law.phi_mm) - 1

    @property
    def has_switch(self) -> bool:
        """Whether the data show the constant branch of phi."""
        return "switch" in self.names

    def interval(self, name: str) -> tuple[float, float]:
        """Return the confidence interval of a number, such as ``D1`` or ``phi_0``, in its unit."""
        if name not in self.names:
            raise WorkbenchError(
                f"there is no identified number {name!r}; there are {', '.join(self.names)}"
            )
        i = self.names.index(name)
        half = self.quantile * float(np.sqrt(self.covariance[i, i]))
        return float(self.values[i]) - half, float(self.values[i]) + half

    def phi_interval(self, contraction: npt.ArrayLike) -> tuple[Vector, Vector]:
        """Return the confidence interval of phi, in N, at each of some contractions.

        Args:
            contraction: Contractions q, any shape, in m.
        """
        q = 1e3 * np.asarray(contraction, dtype=float)
        slopes = np.zeros((*q.shape, len(self.values)))
        switch = 1e3 * float(self.law.phi_switch)
        slopes[..., 3 : 4 + self.order] = polyvander(np.maximum(q, switch), self.order)
        if self.has_switch:
            slope = _slope(np.asarray(self.law.phi_mm, dtype=float), switch)
            slopes[..., -1] = np.where(q < switch, slope, 0.0)
        middle = np.asarray(self.law.phi(1e-3 * q), dtype=float)
        variance = np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)
        half = self.quantile * np.sqrt(np.maximum(variance, 0.0))
        return middle - half, middle + half

    def __str__(self) -> str:
        deviations = np.sqrt(np.diag(self.covariance))
        lines = ["static force F = (D1 + D2 q + D3 q^2) p + phi(q), q in mm, p in bar gauge"]
        lines += [
            f"  {name:<8} {value:>12.6g} +- {self.quantile * deviation:<10.2g} {unit}"
            for name, unit, value, deviation in zip(
                self.names, self.units, self.values, deviations, strict=True
            )
        ]
        held_out = "".join(f"; {n}: {error:.2f} N" for n, error in self.held_out.items())
        return "\n".join(
            [
                *lines,
                f"  intervals hold the true number with {100 * self.confidence:g} %, if the law is"
                " right",
                f"  points   {self.used} used, {self.slack} slack",
                f"  error    {self.residual_rms:.2f} N rms"
                + (f"; on contractions held out, by order of phi{held_out}" if held_out else ""),
                f"  range    {1e3 * self.contraction[0]:.2f} to {1e3 * self.contraction[1]:.2f} mm,"
                f" {self.gauge_pressure[0] / BAR:.2f} to {self.gauge_pressure[1] / BAR:.2f} bar",
            ]
        )


def identify_static_force(
    pressure: npt.ArrayLike,
    contraction: npt.ArrayLike,
    force: npt.ArrayLike,
    *,
    orders: Iterable[int] = (1, 2, 3, 4, 5),
    confidence: float = 0.95,
) -> StaticForceFit:
    """Identify D1, D2, D3 and phi(q) of the paper's equation (4) from measured forces.

    ``F = (D1 + D2 q + D3 q^2) p + phi(max(q, q_switch))`` by least squares, phi a polynomial of q.
    Its order is the lowest that predicts contractions left out of the fit as well as the best
    order does; each inner level is left out once. Points with less than 5 N are
    censored: a slack muscle says only that its tension is not positive. The rounding of the slack
    clamp is undone on the others. Where the data reach below it, the switch of phi is identified
    too; elsewhere phi is constant below the smallest contraction.

    The intervals describe random errors of the force. They do not hold if the law itself is wrong;
    a held-out error well above the noise of the load cell shows that.

    Args:
        pressure: Gauge pressures, any shape, in Pa.
        contraction: Contractions q, of the same shape, in m.
        force: Measured forces, of the same shape, in N.
        orders: Orders of phi to choose from, each 0 to 8; one to fix it.
        confidence: Probability of the intervals, 0.5 to 0.9999, dimensionless.

    Raises:
        NumericalError: If the points do not determine the coefficients.

    Source:
        The paper's identification experiment, Figure 7.

    Example:
        >>> q, p = np.meshgrid(np.linspace(0.0, 0.03, 9), np.linspace(0.0, 6e5, 20))
        >>> noise = np.random.default_rng(1).normal(0.0, 0.5, q.shape)
        >>> fit = identify_static_force(p, q, PaperLaw().force(q, p) + noise)
        >>> np.abs(fit.values[:3] - (280.0, -2.2, 0.033)).round(1).tolist()
        [0.0, 0.0, 0.0]
    """
    from scipy.stats import t as student

    check_range("confidence", confidence, 0.5, 0.9999)
    p, q, f = _columns(pressure, contraction, force)
    candidates = sorted(set(orders))
    if not candidates or candidates[0] < 0 or candidates[-1] > 8:
        raise WorkbenchError(f"orders of phi are {candidates}; give at least one between 0 and 8")
    pulls = f >= _SLACK
    if not pulls.any():
        raise WorkbenchError(
            f"no force reaches {_SLACK:g} N: the muscle is slack in every point; check units"
        )
    p, q = p / BAR, 1e3 * q
    # The clamp F = (T + sqrt(T^2 + w^2)) / 2 turned round.
    tension = f - SLACK_WIDTH**2 / (4 * np.maximum(f, 0.5 * _SLACK))
    # The order is a matter of the curve's shape, for which a thousand points are plenty.
    thin = np.flatnonzero(pulls)[:: max(1, int(pulls.sum()) // 1000)]
    order, held_out = _choose_order(p[thin], q[thin], tension[thin], candidates)
    # Chosen by the measured force, the points near the limit are those with noise upwards; the
    # force predicted by a first fit chooses fairly.
    coefficients, switch = _fit(p[pulls], q[pulls], tension[pulls], order)
    pulls = _design(p, q, order, switch) @ coefficients >= _SLACK
    p, q, tension = p[pulls], q[pulls], tension[pulls]
    coefficients, switch = _fit(p, q, tension, order)
    residual = tension - _design(p, q, order, switch) @ coefficients
    has_switch = switch is not None and bool((q < switch).any())
    jacobian = _design(p, q, order, switch)
    values = coefficients
    if has_switch and switch is not None:
        slope = _slope(coefficients[3:], switch)
        jacobian = np.column_stack([jacobian, np.where(q < switch, slope, 0.0)])
        values = np.append(values, switch)
    freedom = len(q) - jacobian.shape[1]
    covariance = _covariance(jacobian, float(residual @ residual) / freedom)
    floor_at = float(q.min()) if switch is None else switch
    law = PaperLaw(
        gain_bar_mm=(float(coefficients[0]), float(coefficients[1]), float(coefficients[2])),
        phi_mm=tuple(coefficients[3:].tolist()),
        phi_floor=float(polyval(floor_at, coefficients[3:])),
        phi_switch=1e-3 * floor_at,
    )
    return StaticForceFit(
        law=law,
        names=("D1", "D2", "D3", *(f"phi_{i}" for i in range(order + 1)))
        + (("switch",) if has_switch else ()),
        units=("N/bar", "N/(bar mm)", "N/(bar mm2)", "N", "N/mm")[: 4 + min(order, 1)]
        + tuple(f"N/mm{i}" for i in range(2, order + 1))
        + (("mm",) if has_switch else ()),
        values=values,
        covariance=covariance,
        quantile=float(student.ppf(0.5 + 0.5 * confidence, freedom)),
        confidence=confidence,
        held_out=held_out,
        residual_rms=float(np.sqrt(np.mean(residual**2))),
        used=len(q),
        slack=int((~pulls).sum()),
        contraction=(1e-3 * float(q.min()), 1e-3 * float(q.max())),
        gauge_pressure=(BAR * float(p.min()), BAR * float(p.max())),
    )


def _choose_order(
    p: Vector, q: Vector, tension: Vector, candidates: list[int]
) -> tuple[int, dict[int, float]]:
    """Return the order of phi, and the held-out error in N of every order that can be fitted."""
    level = _levels(q)
    count = int(level.max()) + 1
    # A choice needs a level to leave out, and one more to judge by.
    possible = [n for n in candidates if count >= n + (3 if len(candidates) > 1 else 1)]
    if count < 3 or not possible:
        raise WorkbenchError(
            f"the muscle pulls at {count} contraction(s) only; D(q) needs 3, a choice of phi's"
            f" order {candidates[0] + 3}: measure at more contractions"
        )
    if len(possible) == 1:
        return possible[0], {}
    held_out = {n: _held_out(p, q, tension, n, level) for n in possible}
    # No load cell resolves the last term: without noise, rounding would choose.
    limit = _EXCESS * min(held_out.values()) + 0.01
    return next(n for n in possible if held_out[n] <= limit), held_out


def _columns(
    pressure: npt.ArrayLike, contraction: npt.ArrayLike, force: npt.ArrayLike
) -> tuple[Vector, Vector, Vector]:
    tables = [
        check_finite(name, values)
        for name, values in (("pressure", pressure), ("contraction", contraction), ("force", force))
    ]
    shapes = {table.shape for table in tables}
    if len(shapes) > 1:
        raise WorkbenchError(
            "pressure, contraction and force have the shapes"
            f" {', '.join(str(t.shape) for t in tables)}; they must be the same"
        )
    p, q, f = (table.ravel() for table in tables)
    if p.size < 20:
        raise WorkbenchError(f"there are {p.size} points; the identification needs 20 or more")
    if np.ptp(p) < 0.5 * BAR:
        raise WorkbenchError(
            f"the pressures span {np.ptp(p):g} Pa; give gauge pressures in Pa that span 50000 Pa"
            " or more (1 bar = 100000 Pa)"
        )
    if np.max(np.abs(q)) > 0.1:
        raise WorkbenchError(
            f"a contraction is {np.max(np.abs(q)):g} m; give contractions in m (1 mm = 0.001 m)"
        )
    return p, q, f


def _levels(q: Vector) -> npt.NDArray[np.intp]:
    """Return the level of each contraction in mm, 0 for the smallest."""
    order = np.argsort(q)
    new = np.diff(q[order]) > 1e3 * LEVEL_WIDTH
    level = np.empty(len(q), dtype=np.intp)
    level[order] = np.concatenate([[0], np.cumsum(new)])
    if level.max() == 0:
        # A continuous sweep: twelve parts of it stand for levels.
        edges = np.linspace(q.min(), q.max(), 13)[1:-1]
        level = np.asarray(np.searchsorted(edges, q), dtype=np.intp)
    return level


def _slope(coefficients: Vector, q: float) -> float:
    return float(polyval(q, polyder(coefficients)))


def _design(p: Vector, q: Vector, order: int, switch: float | None) -> Vector:
    beyond = q if switch is None else np.maximum(q, switch)
    return np.column_stack([p[:, None] * polyvander(q, 2), polyvander(beyond, order)])


def _solve(p: Vector, q: Vector, tension: Vector, order: int, switch: float | None) -> Vector:
    design = _design(p, q, order, switch)
    size = np.linalg.norm(design, axis=0)
    solution, _, rank, _ = np.linalg.lstsq(design / size, tension, rcond=1e-12)
    if rank < design.shape[1]:
        raise NumericalError(
            f"the points do not determine a phi of order {order}; measure at more contractions and"
            " pressures"
        )
    return np.asarray(solution / size, dtype=float)


def _loss(p: Vector, q: Vector, tension: Vector, order: int, switch: float) -> float:
    """Return the sum of squared residuals, by normal equations: quick, good enough to compare."""
    design = _design(p, q / q.max(), order, switch / q.max())
    size = np.linalg.norm(design, axis=0)
    design /= size
    normal = design.T @ design + 1e-13 * np.eye(design.shape[1])
    residual = tension - design @ np.linalg.solve(normal, design.T @ tension)
    return float(residual @ residual)


def _fit(p: Vector, q: Vector, tension: Vector, order: int) -> tuple[Vector, float | None]:
    """Return the coefficients and the switch in mm, None where no branch is seen."""
    from scipy.optimize import minimize_scalar

    plain = _solve(p, q, tension, order, None)
    level = _levels(q)
    levels = np.array([np.median(q[level == i]) for i in np.unique(level)])
    # The branch may take the lowest third of the contractions at most, and leaves enough levels
    # to determine the polynomial.
    top = levels[0] + np.ptp(levels) / 3
    top = min(top, levels[-(order + 1)]) if len(levels) > order + 1 else levels[0]
    if order == 0 or top <= levels[0]:
        return plain, None
    # The loss has a kink at each level: it is minimised between neighbouring knots.
    knots = np.union1d(np.linspace(levels[0], top, 13), levels[levels <= top])
    losses = [_loss(p, q, tension, order, s) for s in knots]
    k = int(np.argmin(losses))
    tried = [(losses[k], float(knots[k]))]
    for low, high in pairwise(knots):
        if knots[max(0, k - 2)] <= low and high <= knots[min(len(knots) - 1, k + 2)]:
            found = minimize_scalar(
                lambda s: _loss(p, q, tension, order, s),
                bounds=(low, high),
                method="bounded",
                options={"xatol": 1e-6},
            )
            tried.append((float(found.fun), float(found.x)))
    best, switch = min(tried)
    without = _loss(p, q, tension, order, 0.5 * float(q.min()) + 0.5 * float(levels[0]))
    # Akaike's criterion with a margin: one more number must pay for itself clearly.
    if len(q) * np.log(max(without, 1e-300) / max(best, 1e-300)) < 10.0:
        return plain, None
    return _solve(p, q, tension, order, switch), switch


def _held_out(
    p: Vector, q: Vector, tension: Vector, order: int, level: npt.NDArray[np.intp]
) -> float:
    """Return the rms error, N, on the median of the inner levels, left out one at a time."""
    inner = range(1, int(level.max()))
    squares = []
    for left_out in inner:
        test = level == left_out
        coefficients, switch = _fit(p[~test], q[~test], tension[~test], order)
        error = tension[test] - _design(p[test], q[test], order, switch) @ coefficients
        squares.append(float(np.mean(error**2)))
    # The median: next to the switch a left-out level is a guess with every order.
    return float(np.sqrt(np.median(squares))) if squares else float("nan")


def _covariance(jacobian: Vector, variance: float) -> Vector:
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / size
    inverse = np.linalg.inv(scaled.T @ scaled)
    return np.asarray(variance * inverse / np.outer(size, size), dtype=float)
