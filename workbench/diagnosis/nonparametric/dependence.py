"""What a located signal depends on: regressions on what ports see, tests against shifted signals.

What free parameters of the model can reproduce at the same place takes part in every regression,
so that only what goes beyond it counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from workbench.arrays import Vector
from workbench.model.units import SPEEDS, per, same_dimension
from workbench.physics.nonparametric_term import Curve

SURROGATES = 99
"""Shifted signals against which a dependence is tested; the smallest p-value is 0.01."""

_LEAST_SHIFT = 20
"""The smallest shift is that part of a recording: at 1/20, what moves slowly is shifted too."""
_FINEST = 300.0


@dataclass(frozen=True)
class Site:
    """A port, or ports that share a law, with what they see along the recordings.

    Args:
        signals: Local signals by name, shape (n, n_ports) each, in SI.
        value: The signals themselves, shape (n, n_ports), in ``unit``.
        effect: What a unit signal at each port does to the located signals, shape
            (n, n_located, n_ports), in their units per ``unit``.
    """

    ports: tuple[str, ...]
    unit: str
    signals: dict[str, Vector]
    units: dict[str, str]
    value: Vector
    effect: Vector

    def columns(self, functions: Vector, relative: bool) -> Vector:
        """Carry functions of what the ports see to the located signals, as columns of a regression.

        Args:
            functions: One set of functions at every port, shape (n, n_ports, k), dimensionless.

        Returns:
            Located signals one below the other, shape (n_located n, k), in their unit.
        """
        weight = self.effect * self.value[:, None, :] if relative else self.effect
        product = np.einsum("nlp,npk->lnk", weight, functions)
        return np.asarray(product.reshape(-1, functions.shape[2]))


@dataclass(frozen=True)
class Evidence:
    """The located signals of all recordings, ready for regressions.

    Args:
        signal: Signals one below the other, shape (n_located n,), in the ports' unit.
        known: Where the measurements determine them, of that shape.
        nominal: What a step of each free parameter adds there, shape (n_located n, n_free), in
            the ports' unit, for a step of one prior standard deviation.
        toward: Step from each estimate to its prior, shape (n_free,), in prior standard deviations.
        time: Times within each recording, shape (n,), in s.
        recording: Number of the recording, shape (n,).
    """

    located: tuple[str, ...]
    signal: Vector
    known: npt.NDArray[np.bool_]
    nominal: Vector
    toward: Vector
    sites: tuple[Site, ...]
    time: Vector
    recording: npt.NDArray[np.int_]

    @property
    def mean_square(self) -> float:
        """Mean square of the signals where they are known, in the square of their unit."""
        return float(np.mean(self.signal[self.known] ** 2))

    def at_ports(self, values: Vector) -> Vector:
        """Return what ports see where a located signal is known, one after the other, in any unit.

        Args:
            values: A local signal, shape (n, n_ports), in any unit.
        """
        used = self.known.reshape(len(self.located), -1).any(axis=0)
        return values[used].ravel()

    def solve(self, columns: Vector, rows: npt.NDArray[np.bool_] | None = None) -> Vector:
        """Regress the signals on the free parameters and further columns.

        Args:
            columns: Further columns, shape (n_located n, k), in the signals' unit.
            rows: Rows to use; those where the signals are known by default.

        Returns:
            Steps of the free parameters in prior standard deviations, then one coefficient per
            column, shape (n_free + k,), dimensionless.
        """
        rows = self.known if rows is None else rows
        matrix = np.column_stack([self.nominal, columns])[rows]
        n_free = len(self.toward)
        # Neighbouring rows say the same: the prior of a parameter weighs as much as one independent
        # sample of the signal's own size in ten.
        penalty = np.full(matrix.shape[1], 0.1 * self.mean_square)
        # Ordinates where there are no data stay near zero.
        size = float(np.sum(matrix[:, n_free:] ** 2)) / max(columns.shape[1], 1)
        penalty[n_free:] = 1e-3 * size
        prior = np.concatenate([self.toward, np.zeros(columns.shape[1])])
        return prior + _ridge(matrix, self.signal[rows] - matrix @ prior, penalty)

    def reproduced(self, column: Vector) -> float:
        """Return the share of a column's mean square that free parameters reproduce, a fraction.

        Args:
            column: The column, shape (n_located n,), in the signals' unit.
        """
        matrix, target = self.nominal[self.known], column[self.known]
        answer = np.linalg.lstsq(matrix, target, rcond=None)[0]
        left = float(np.sum((target - matrix @ answer) ** 2))
        return 1.0 - left / max(float(np.sum(target**2)), 1e-300)

    def share(self, columns: Vector) -> float:
        """Return the share that columns predict across blocks of time beyond the free parameters.

        Every fifth block is predicted from the others, with and without the columns; 1,
        dimensionless, stands for all of the mean square. A block lasts 2 s, or a tenth of
        recordings below 10 s, and 20 samples at least.

        Args:
            columns: Further columns, shape (n_located n, k), in the signals' unit.
        """
        long, step = float(np.ptp(self.time)), float(self.time[1] - self.time[0])
        block = max(0.1 * long, 20 * step)
        fold = (self.time // block + self.recording).astype(int) % 5
        fold = np.tile(fold, len(self.located))
        none = columns[:, :0]
        left = {True: 0.0, False: 0.0}
        for k in range(5):
            test, train = self.known & (fold == k), self.known & (fold != k)
            for with_it, used in ((True, columns), (False, none)):
                matrix = np.column_stack([self.nominal, used])[test]
                error = self.signal[test] - matrix @ self.solve(used, train)
                left[with_it] += float(np.sum(error**2))
        return 1.0 - left[True] / max(left[False], 1e-300)

    def p_value(self, columns: Vector, given: Vector) -> float:
        """Test whether columns explain more than they do of the signal shifted in time.

        Each recording's signal is shifted circularly, by a twentieth of it at least, against what
        the ports see: that keeps its size and its correlation in time and breaks its dependence.

        Args:
            columns: Columns to test, shape (n_located n, k), in the signals' unit.
            given: Columns that explain what they can first, shape (n_located n, m), in that unit.

        Returns:
            Probability of as large a share without dependence, ``1 / (SURROGATES + 1)`` at least,
            dimensionless.
        """
        rng = np.random.default_rng(0)
        base = np.column_stack([self.nominal, given])
        rest = self.signal - base @ self.solve(given)
        full = np.column_stack([base, columns])
        seen = _explained(full, base, rest, self.known)
        beyond = 0
        for _ in range(SURROGATES):
            order = self._shifted(rng)
            beyond += _explained(full, base, rest[order], self.known[order]) >= seen
        return (1 + beyond) / (SURROGATES + 1)

    def _shifted(self, rng: np.random.Generator) -> npt.NDArray[np.int_]:
        n = len(self.time)
        order = np.arange(n)
        for number in np.unique(self.recording):
            own = np.flatnonzero(self.recording == number)
            least = len(own) // _LEAST_SHIFT + 1
            order[own] = np.roll(own, rng.integers(least, len(own) - least + 1))
        return np.concatenate([order + i * n for i in range(len(self.located))])


def spread(values: Vector, argument: str, unit: str, most: int, *, centred: bool = True) -> Curve:
    """Spread the knots of a curve over the values of its argument.

    Evenly; over a speed in equal ratios to both sides of zero, where friction has its structure.

    Args:
        values: Values of the argument, shape (n,), in ``unit``.
        centred: Whether the curve is zero on average over the values.
    """
    low, high = np.quantile(values, [0.002, 0.998])
    knots = np.linspace(low, high, most)
    if same_dimension(unit, *SPEEDS) and low < 0.0 < high:
        side = max(-low, high) * np.geomspace(1.0 / _FINEST, 1.0, max(most // 2, 2))
        knots = np.concatenate([-side[::-1], side])
        knots = knots[(knots > 1.3 * low) & (knots < 1.3 * high)]
    curve = Curve(argument, unit, tuple(knots.tolist()))
    if not centred:
        return curve
    return replace(curve, mean=tuple(curve.functions(values).mean(axis=0).tolist()))


def partial(
    evidence: Evidence, site: Site, relative: bool, argument: str, rest: Vector
) -> tuple[Vector, Vector, Vector]:
    """Return what a curve over an argument would have to follow at the ports of a site.

    What is left of the located signals is laid to the ports in proportion to their effect on them.

    Args:
        rest: What is left of the located signals, shape (n_located n,), in their unit.

    Returns:
        Values of the argument, in its unit, what the curve has to follow, in the unit of the curve,
        and weights, dimensionless; each of shape (n_ports n,).
    """
    n, located, _ = site.effect.shape
    effect = site.effect * site.value[:, None, :] if relative else site.effect
    used = evidence.known.reshape(located, n).T
    left = np.where(used, rest.reshape(located, n).T, 0.0)
    effect = effect * used[:, :, None]
    square = np.sum(effect**2, axis=(1, 2))
    # Where the ports act on nothing, nothing can be said of their signals.
    share = (
        np.einsum("nlp,nl->np", effect, left) / np.maximum(square, 1e-6 * square.mean())[:, None]
    )
    weight = np.sum(effect**2, axis=1)
    weight = weight / max(float(weight.mean()), 1e-300)
    return site.signals[argument].ravel(), share.ravel(), weight.ravel()


def loop_along(x: Vector, recording: npt.NDArray[np.int_], distance: float) -> Vector:
    """Return the memory of a loop along recordings, exact where x moves straight between samples.

    ``dz/dx = (sign(dx) - z) / distance`` along the way of x, from zero at the start of each
    recording.

    Args:
        x: Coordinate of the loop, shape (n, n_ports), in SI.
        recording: Number of the recording, shape (n,).
        distance: Distance over which the loop is closed, in the unit of x.

    Returns:
        The memory, shape (n, n_ports), -1 to 1, dimensionless.
    """
    memory = np.zeros_like(x)
    for k in range(1, len(x)):
        if recording[k] == recording[k - 1]:
            step = x[k] - x[k - 1]
            end = np.sign(step)
            memory[k] = end + (memory[k - 1] - end) * np.exp(-np.abs(step) / distance)
    return memory


def rate_of(argument: str, site: Site) -> str | None:
    """Return the one local signal with the unit of the rate of another; None if there is none."""
    unit = per(site.units[argument], "s")
    rates = [name for name in site.signals if same_dimension(site.units[name], unit)]
    return rates[0] if len(rates) == 1 else None


def _ridge(matrix: Vector, target: Vector, penalty: Vector) -> Vector:
    normal = matrix.T @ matrix + np.diag(penalty)
    return np.asarray(np.linalg.solve(normal, matrix.T @ target))


def _explained(full: Vector, base: Vector, signal: Vector, rows: npt.NDArray[np.bool_]) -> float:
    """Share of a signal that columns explain beyond others."""
    target = signal[rows]

    def left(matrix: Vector) -> float:
        used = matrix[rows]
        size = 1e-6 * np.maximum(np.sum(used**2, axis=0), 1e-300)
        return float(np.sum((target - used @ _ridge(used, target, size)) ** 2))

    return 1.0 - left(full) / max(left(base), 1e-300)
