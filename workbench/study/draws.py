"""Draws from a parameter box, and what can be read from their scores.

A scrambled Sobol sequence covers the box more evenly than independent draws, so the interval of a
probability, which is exact for independent ones, is on the safe side.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.arrays import Vector
from workbench.study.study import Box

CONFIDENCE = 0.95
"""Probability that an interval covers."""


def unit_draws(parameters: int, draws: int, seed: int) -> Vector:
    """Draw points of the unit cube, shape (draws, parameters), by a scrambled Sobol sequence."""
    from scipy.stats import qmc

    sampler = qmc.Sobol(parameters, scramble=True, rng=np.random.default_rng(seed))
    whole = sampler.random_base2(max(1, math.ceil(math.log2(draws))))
    return np.asarray(whole[:draws], dtype=float)


def scaled(box: Box, unit: Vector) -> Vector:
    """Return points of the box, in SI, for points of the unit cube, both shape (n, n_parameters).

    They have 9 digits, so that a stored run is found again.
    """
    ends = np.array(list(box.ranges.values()))
    values = ends[:, 0] + unit * (ends[:, 1] - ends[:, 0])
    return np.array([[float(f"{v:.9g}") for v in row] for row in values]).reshape(np.shape(unit))


def interval(met: int, draws: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the exact interval of a probability of which some draws were seen.

    Args:
        confidence: Probability that the interval covers, a ratio.

    Source:
        Clopper and Pearson, Biometrika 26, 1934.

    Example:
        >>> [round(end, 3) for end in interval(20, 20)]
        [0.832, 1.0]
    """
    from scipy.stats import binomtest

    low, high = binomtest(met, draws).proportion_ci(confidence)
    return float(low), float(high)


def straight_line(unit: Vector, values: Vector) -> tuple[float, Vector, float]:
    """Fit a straight line to scores over the unit cube.

    Args:
        unit: Points, shape (n, n_parameters), 0 to 1.
        values: Scores, shape (n,).

    Returns:
        Constant, change over the whole range of each parameter, shape (n_parameters,), and the
        ratio of the variance that is explained.
    """
    matrix = np.column_stack([np.ones(len(unit)), unit - 0.5])
    solution, *_ = np.linalg.lstsq(matrix, values, rcond=None)
    spread = float(np.sum((values - values.mean()) ** 2))
    rest = float(np.sum((values - matrix @ solution) ** 2))
    # Equal scores leave nothing to explain.
    explained = 1.0 - rest / spread if spread > 1e-12 else 0.0
    changes = np.asarray(solution[1:], dtype=float) if spread > 1e-12 else np.zeros(unit.shape[1])
    return float(solution[0]), changes, explained
