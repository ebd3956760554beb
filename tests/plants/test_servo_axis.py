"""The servo axis against the closed-form solution of a mass with friction."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.plants.servo_axis import servo_axis
from workbench.simulation import simulate

MASS, DAMPING, DRY = 95.0, 200.0, 20.0


def test_a_step_of_force_gives_an_exponential_rise() -> None:
    run = simulate(servo_axis(), np.full(300, 100.0), sample_time=0.01)
    rate, final = DAMPING / MASS, (100.0 - DRY) / DAMPING
    expected = final * (1 - np.exp(-rate * run.time))
    # Below some 3 mm/s, tanh has not reached the full friction: 2 ms of the rise.
    assert run["speed"] == pytest.approx(expected, abs=2e-3)


def test_without_friction_it_is_newtons_law() -> None:
    axis = servo_axis().without("viscous_friction", "coulomb_friction")
    run = simulate(axis, np.full(101, 95.0), sample_time=0.01)
    assert run["position"] == pytest.approx(0.5 * run.time**2, abs=1e-9)


def test_it_sticks_below_the_dry_friction() -> None:
    run = simulate(servo_axis(), np.full(200, 15.0), sample_time=0.01)
    # tanh creeps: 15 N, less 0.2 N of the damper, are 74 % of the dry friction.
    assert run["speed"][-1] == pytest.approx(np.arctanh(14.81 / DRY) * 1e-3, rel=1e-3)


def test_the_offset_acts_like_force() -> None:
    axis = servo_axis()
    shifted = axis.with_parameters({"offset": 10.0})
    assert np.array_equal(shifted.rates([0.0, 0.1], [40.0]), axis.rates([0.0, 0.1], [50.0]))
