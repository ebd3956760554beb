"""Simulated runs against exact solutions: held inputs, tolerance, the reported difference."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from tests.machines import machine
from tests.simulation.plants import integrator, oscillator
from workbench.model import Model
from workbench.simulation import Stepper, simulate

STEP = 0.002


def exact(frequency: float, damping: float, force: np.ndarray, step: float = STEP) -> np.ndarray:
    """States at the samples, by the matrix exponential of the system with held input."""
    a = np.array([[0.0, 1.0], [-(frequency**2), -2 * damping * frequency]])
    block = np.zeros((3, 3))
    block[:2, :2], block[1, 2] = a, 1.0
    transition = expm(block * step)
    states = np.zeros((len(force), 2))
    for k in range(len(force) - 1):
        states[k + 1] = transition[:2, :2] @ states[k] + transition[:2, 2] * force[k]
    return states


@pytest.mark.parametrize("method", ["erk", "rosenbrock"])
def test_a_linear_system_follows_its_matrix_exponential(
    method: str, rng: np.random.Generator
) -> None:
    force = rng.uniform(-1.0, 1.0, 1200)
    run = simulate(oscillator(), force, sample_time=STEP, method=method)  # type: ignore[arg-type]
    true = exact(30.0, 0.1, force)
    apart = np.abs(run.states - true).max(axis=0) / [1e-3, 0.03]
    assert apart.max() < 1e-5  # errors of 1e-7 per step, damped with 3 per second


@pytest.mark.parametrize("method", ["erk", "rosenbrock"])
def test_a_tighter_tolerance_is_a_smaller_error(method: str, rng: np.random.Generator) -> None:
    # Samples of 0.1 s, so that the tolerance and not the sample decides the step.
    force = rng.uniform(-1.0, 1.0, 60)
    true = exact(30.0, 0.1, force, step=0.1)
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        run = simulate(
            oscillator(),
            force,
            sample_time=0.1,
            tolerance=tolerance,
            method=method,  # type: ignore[arg-type]
        )
        error = float((np.abs(run.states - true) / [1e-3, 0.03]).max())
        errors.append(error)
        # The reported difference to the tighter run tells the size of the true error.
        assert 0.2 * error < run.error < 5.0 * error
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 0.1 * errors[1]


def test_inputs_are_held_and_not_interpolated() -> None:
    inflow = np.array([1.0, -2.0, 0.0, 3.0, 9.0])
    run = simulate(integrator(), inflow, sample_time=0.1)
    # Row k acts from sample k to k + 1; the last one acts on nothing.
    assert run["level"] == pytest.approx([0.0, 0.1, -0.1, -0.1, 0.2], abs=1e-12)
    assert run.time == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert run["inflow"] == pytest.approx(inflow)


def test_blocks_of_samples_leave_no_trace(rng: np.random.Generator) -> None:
    force = rng.uniform(-1.0, 1.0, 700)  # two full blocks, then single samples
    model = oscillator()
    run = simulate(model, force, sample_time=STEP, check=False)
    stepper = Stepper(model, STEP)
    x = run.states[0]
    for k in range(699):
        x = stepper.step(x, [force[k]])
        # The integrator tries the last step size again within a block: far below the tolerance.
        assert np.abs((x - run.states[k + 1]) / [1e-3, 0.03]).max() < 1e-9
    resumed = simulate(model, force[100:], sample_time=STEP, start=run.states[100], check=False)
    assert np.abs((resumed.states - run.states[100:]) / [1e-3, 0.03]).max() < 1e-9


@pytest.mark.parametrize("count", [2, 249, 250, 251, 252, 500, 501])
def test_every_length_around_a_block_is_filled(count: int) -> None:
    run = simulate(integrator(), np.ones(count), sample_time=1e-3, check=False)
    assert run["level"] == pytest.approx(1e-3 * np.arange(count), abs=1e-12)


def test_other_parameter_values_need_no_other_model() -> None:
    model = oscillator()
    force = np.ones(200)
    stiff = simulate(model, force, sample_time=STEP, values=[60.0, 0.1])
    other = simulate(model.with_parameters({"frequency": 60.0}), force, sample_time=STEP)
    assert np.array_equal(stiff.states, other.states)
    assert stiff.values == pytest.approx([60.0, 0.1])


def sled(sign: Callable[[Any], Any]) -> Model:
    """A sled whose dry friction is written as a sign."""
    return machine(
        lambda m: {"x": m.x.v, "v": m.u.f - 0.5 * sign(m.x.v) - 0.1 * m.x.v},
        "x m, v m/s",
        "f N -10 10",
        "x m",
    )


@pytest.mark.parametrize("sign", [np.sign, lambda v: np.copysign(1.0, v)], ids=["sign", "copysign"])
def test_what_sticks_by_a_sign_is_held(sign: Callable[[Any], Any]) -> None:
    push = np.repeat([0.3, 5.0, 0.2, -0.4], [10, 10, 180, 100])
    run = simulate(sled(sign), push, sample_time=0.1)
    # Pushed for 1 s by 4.5 N more than holds it, it is slowed down by 0.3 N more than 0.1 v.
    fast = 45.0 * -np.expm1(-0.1)
    gone = 45.0 - 3.0 * 10.0 * np.log1p(fast / 3.0)
    assert run["x"][9] == pytest.approx(0.0, abs=1e-3)
    assert run["x"][200:] == pytest.approx(gone, abs=2e-3)
