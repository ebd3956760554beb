"""What repeats is told from noise, whichever line of the periodogram is the strongest."""

from __future__ import annotations

import numpy as np

from workbench.diagnosis.location.periods import period_of


def test_noise_repeats_with_no_period_up_to_the_fastest_that_samples_show() -> None:
    time = np.arange(500.0)
    for seed in range(100):
        noise = np.random.default_rng(seed).normal(size=500)
        assert np.isnan(period_of([("run", time)], noise))
