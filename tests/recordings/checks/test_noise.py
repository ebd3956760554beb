"""The estimates against signals whose noise and steps are known."""

import math

import numpy as np
import pytest

from workbench.recordings import Recording, Signal
from workbench.recordings.checks.noise import noise_of, usual_rms, white_rms
from workbench.recordings.checks.quantisation import quantum

TIME = 0.002 * np.arange(10_000)
MOTION = 3e5 + 1e5 * np.sin(2 * TIME) + 3e4 * np.sin(11 * TIME)


def floor_of(values: np.ndarray) -> tuple[float, float, float]:
    noise = noise_of(Recording("r", TIME, (Signal("x", values),)), "x")
    return noise.floor, noise.noise_rms, noise.step


@pytest.mark.parametrize("rms", [100.0, 600.0, 3000.0])
@pytest.mark.parametrize("step", [240.0, 1000.0])
def test_noise_apart_from_steps(rms: float, step: float, rng: np.random.Generator) -> None:
    values = step * np.round((MOTION + rms * rng.normal(size=len(TIME))) / step)
    floor, noise, found = floor_of(values)
    assert found == pytest.approx(step, rel=1e-6)
    # The median of 100 blocks scatters by 1 %; blocks of correlated differences bias it by 2 %.
    assert floor == pytest.approx(np.hypot(rms, step / np.sqrt(12)), rel=0.06)
    if rms > step / 2:
        assert noise == pytest.approx(rms, rel=0.08)


def test_steps_that_hide_the_noise() -> None:
    step = 3.5e-5
    floor, noise, found = floor_of(step * np.round(0.5 * np.sin(3 * TIME) / step))
    assert (found, floor) == (pytest.approx(step), pytest.approx(step / np.sqrt(12), rel=0.06))
    assert np.isnan(noise)


def test_impacts_and_pauses_do_not_count(rng: np.random.Generator) -> None:
    motion = np.where(TIME % 4 < 2, MOTION, 2e5)
    motion[::700] += 3e5
    assert floor_of(motion + 600 * rng.normal(size=len(TIME)))[0] == pytest.approx(600, rel=0.06)


def test_motion_too_fast_to_tell_is_an_upper_bound() -> None:
    fast = Recording("r", TIME, (Signal("x", np.sin(300 * TIME)),))
    assert noise_of(fast, "x").upper_bound
    slow = Recording("r", TIME, (Signal("x", np.sin(TIME) + 1e-3 * np.sin(1e5 * TIME**2)),))
    assert not noise_of(slow, "x").upper_bound


@pytest.mark.parametrize("step", [0.25, 10 / 4096, 1e-3, 2e-7])
@pytest.mark.parametrize("rounding", [0.0, 0.02])
def test_quantum(step: float, rounding: float, rng: np.random.Generator) -> None:
    values = step * np.round(rng.normal(size=3000) * 40)
    if rounding:
        # Printing rounds once more, to a fraction of the step.
        values = np.round(values / (rounding * step)) * (rounding * step)
    assert quantum(values) == pytest.approx(step, rel=2e-3)


def test_quantum_of_few_levels_far_apart(rng: np.random.Generator) -> None:
    # Pulses that visit 24 of a thousand levels, as a valve command does.
    levels = 10 / 4096 * rng.integers(1500, 2500, 60)
    assert quantum(np.repeat(levels, 50)) == pytest.approx(10 / 4096, rel=1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_no_quantum_in_unrelated_numbers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert quantum(rng.normal(size=int(rng.integers(10, 5000)))) == 0.0


def test_steps_that_reach_a_signal_at_once_are_no_noise(rng: np.random.Generator) -> None:
    # A load that changes every 90 samples, seen through a resistance: every block has a step.
    levels = np.repeat(rng.uniform(-1.0, 1.0, 40), 90)
    values = levels + rng.normal(0.0, 0.01, levels.size)
    # Of the differences, 5 in 90 hold a step: that moves their median by a tenth.
    assert white_rms(values, quantile=0.25) > 0.014
    assert usual_rms(values) == pytest.approx(0.0105, rel=0.08)
    assert np.isnan(usual_rms(np.repeat(np.arange(10.0), 20)))


@pytest.mark.parametrize("steps", [0.3, 0.5, 1.0, 2.0, 5.0])
def test_the_usual_noise_between_steps_of_a_converter(
    steps: float, rng: np.random.Generator
) -> None:
    # Noise of so many steps, rounded to one of them; the differences are whole numbers then.
    moving = 300.0 * np.sin(np.arange(3000) * 0.004)
    values = 0.25 * np.round(moving + rng.normal(0.0, steps, moving.size))
    assert usual_rms(values) == pytest.approx(0.25 * math.hypot(steps, 12**-0.5), rel=0.08)
