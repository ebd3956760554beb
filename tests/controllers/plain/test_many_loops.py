"""Loops of many laws at once: how fast they decay, against their eigenvalues."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.plain.many_loops import log_radii


@pytest.mark.parametrize("size", [1, 2, 5, 40, 90])
def test_radii_are_those_of_the_largest_eigenvalues(size: int, rng: np.random.Generator) -> None:
    matrices = rng.normal(size=(50, size, size)) / np.sqrt(size)
    matrices *= rng.uniform(0.5, 1.2, size=(50, 1, 1))
    # Half of the states of some only hand on what the one before them had.
    first = max(size // 2, 1)
    matrices[:25, first:] = np.eye(size, k=-1)[first:]
    largest = np.log(np.abs(np.linalg.eigvals(matrices)).max(axis=1))
    found = log_radii(matrices)
    np.testing.assert_allclose(found, largest, rtol=0.03)
    assert np.array_equal(found < 0.0, largest < 0.0)


@pytest.mark.parametrize("left", [1e-2, 1e-5, 1e-9, -1e-5])
def test_what_hardly_decays_is_told_from_what_grows(left: float, rng: np.random.Generator) -> None:
    units = rng.normal(size=(20, 20)) * 10.0 ** rng.uniform(-3.0, 3.0, size=(20, 1))
    poles = np.append(rng.uniform(-0.9, 0.9, 19), 1.0 - left)
    loop = units @ np.diag(poles) @ np.linalg.inv(units)
    assert log_radii(loop[None])[0] == pytest.approx(np.log1p(-left), rel=0.05)


def test_what_is_over_after_some_samples_has_no_radius() -> None:
    assert log_radii(np.stack([np.eye(30, k=-1), np.zeros((30, 30))])).max() < -20.0


def test_what_grows_on_its_way_only_is_waited_for() -> None:
    # A million times as much from one to the next for 30 samples, a billionth for 30, and again.
    loop = np.roll(np.diag(np.repeat([1e6, 1e-9], 30)), 1, axis=0)
    # Powers that repeat what passes in them tell its pace badly, but not that it grows.
    assert log_radii(loop[None])[0] < 0.0
