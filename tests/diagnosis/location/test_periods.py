"""What repeats is told from noise, whichever line of the periodogram is the strongest."""

from __future__ import annotations

import numpy as np

from workbench.diagnosis.location.periods import period_of


def test_noise_repeats_with_no_period_up_to_the_fastest_that_samples_show() -> None:
    time = np.arange(500.0)
    for seed in range(100):
        noise = np.random.default_rng(seed).normal(size=500)
        assert np.isnan(period_of([("run", time)], noise))


def test_a_slow_course_hides_nothing_that_repeats() -> None:
    time = np.arange(500.0)
    noise = np.random.default_rng(1).normal(0.0, 0.3, 500)
    signal = np.sin(2.0 * np.pi * time / 40.0) + 3.0 * (time / 250.0 - 1.0) ** 2 + noise
    assert abs(period_of([("run", time)], signal, beside_course=True) - 40.0) < 0.4
    assert np.isnan(period_of([("run", time)], signal))
