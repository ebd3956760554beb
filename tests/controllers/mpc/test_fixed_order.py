"""Products in a fixed order: the digits of a plain loop."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.arrays import product


def looped(matrix: np.ndarray, vector: np.ndarray) -> list[float]:
    found = []
    for row in matrix.tolist():
        total = row[0] * vector[0]
        for entry, factor in zip(row[1:], vector[1:].tolist(), strict=True):
            total += entry * factor
        found.append(float(total))
    return found


@pytest.mark.parametrize("shape", [(1, 40), (2, 33), (12, 40), (91, 11), (40, 3), (7, 1)])
def test_every_digit_is_that_of_a_loop(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(sum(shape))
    # Numbers of many sizes, so that another order would round differently.
    matrix = rng.normal(size=shape) * 10.0 ** rng.integers(-6, 7, size=shape)
    vector = rng.normal(size=shape[1])
    for layout in (matrix, np.asfortranarray(matrix)):
        assert product(layout, vector).tolist() == looped(matrix, vector)
