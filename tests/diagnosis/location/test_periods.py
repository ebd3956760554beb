"""What repeats is told from noise, whichever line of the periodogram is the strongest."""

from __future__ import annotations

import numpy as np

from workbench.diagnosis.location.periods import period_of, stride_of


def test_noise_repeats_with_no_period_up_to_the_fastest_that_samples_show() -> None:
    time = np.arange(500.0)
    for seed in range(100):
        noise = np.random.default_rng(seed).normal(size=500)
        assert np.isnan(period_of([("run", time)], noise))
    # Rounding of what is constant repeats nothing.
    rounded = 0.198 + 1e-16 * np.sin(2.0 * np.pi * time / 40.0)
    assert np.isnan(period_of([("run", time)], rounded))


def test_a_slow_course_hides_nothing_that_repeats() -> None:
    time = np.arange(500.0)
    noise = np.random.default_rng(1).normal(0.0, 0.3, 500)
    signal = np.sin(2.0 * np.pi * time / 40.0) + 3.0 * (time / 250.0 - 1.0) ** 2 + noise
    assert abs(period_of([("run", time)], signal, beside_course=True) - 40.0) < 0.4
    assert np.isnan(period_of([("run", time)], signal))


def test_a_ripple_that_is_passed_fast_is_found_though_its_line_is_spread() -> None:
    found = 0
    for seed in range(8):
        random = np.random.default_rng(seed)
        speed = np.convolve(np.repeat(random.uniform(-0.5, 0.5, 40), 50), np.ones(60) / 60, "same")
        way = 0.004 * np.cumsum(speed)
        # What is missing is found through a filter.
        window = np.hanning(17) / np.hanning(17).sum()
        signal = np.convolve(np.sin(2.0 * np.pi * way / 0.008), window, "same")
        signal += 0.2 * np.convolve(random.normal(size=2040), np.ones(41) / 6.4, "valid")
        found += abs(stride_of(way, signal) - 0.008) < 2e-5
    assert found >= 5
