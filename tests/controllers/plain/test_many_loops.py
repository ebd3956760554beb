"""Loops of many laws at once: how fast they decay, against their eigenvalues."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.linear_law import LinearLaw
from controllers.plain.many_loops import _without_twins, log_radii, response


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
    assert log_radii(np.zeros((0, 3, 3))).shape == (0,)
    assert log_radii(np.stack([np.eye(30, k=-1), np.zeros((30, 30))])).max() < -20.0


def test_what_grows_on_its_way_only_is_waited_for() -> None:
    # A million times as much from one to the next for 30 samples, a billionth for 30, and again.
    loop = np.roll(np.diag(np.repeat([1e6, 1e-9], 30)), 1, axis=0)
    # Powers that repeat what passes in them tell its pace badly, but not that it grows.
    assert log_radii(loop[None])[0] < 0.0


def _late(core: int, samples: int, commands: int, rng: np.random.Generator) -> LinearLaw:
    """Return laws that know their commands of some samples, their states in any order."""
    n = core + samples * commands
    F, G = np.zeros((3, n, n)), np.zeros((3, n, 2))
    F[:, :core], G[:, :core] = 0.1 * rng.normal(size=(3, core, n)), rng.normal(size=(3, core, 2))
    F[:, core:] = np.eye(n, k=-commands)[core:]
    order = rng.permutation(n)
    H, J = rng.normal(size=(3, commands, n)), rng.normal(size=(3, commands, 2))
    return LinearLaw(F[:, order][:, :, order], G[:, order], H, J)


@pytest.mark.parametrize(("core", "samples", "commands"), [(10, 39, 2), (4, 6, 1), (5, 1, 1)])
def test_responses_of_laws_that_know_their_commands_are_those_of_their_matrices(
    core: int, samples: int, commands: int, rng: np.random.Generator
) -> None:
    laws, z = _late(core, samples, commands, rng), np.exp(1j * np.linspace(0.01, 3.1, 7))
    # What goes round in circles is no delay.
    laws.F[:, 0], laws.G[:, 0] = np.eye(laws.F.shape[1])[0], 0.0
    left = z[:, None, None] * np.eye(laws.F.shape[1]) - laws.F[:, None]
    told = laws.H[:, None] @ np.linalg.solve(left, laws.G[:, None]) + laws.J[:, None]
    np.testing.assert_allclose(response(laws, z, 2), told, rtol=1e-9)


def test_a_loop_whose_plant_and_law_have_a_record_each_of_one_command_has_its_radius(
    rng: np.random.Generator,
) -> None:
    # y+ = 0.9 y + u 30 samples late; the law keeps the same commands in thirds of a unit.
    loops = np.zeros((4, 62, 62))
    loops[:, :, :] = np.eye(62, k=-1)
    loops[:, 0], loops[:, 31], loops[:, 61] = 0.0, 0.0, 0.0
    feedback = np.concatenate([np.full((4, 1), -0.01), 0.01 * rng.normal(size=(4, 30))], axis=1)
    loops[:, 0, 61], loops[:, 0, 31:61] = feedback[:, 0], feedback[:, 1:]
    loops[:, 31] = loops[:, 0] / 3.0
    loops[:, 61, 61], loops[:, 61, 29] = 0.9, 1.0
    loops[:, 30] = 0.0
    largest = np.log(np.abs(np.linalg.eigvals(loops)).max(axis=1))
    assert _without_twins(loops).shape == (4, 32, 32)
    np.testing.assert_allclose(log_radii(loops), largest, rtol=0.03)
