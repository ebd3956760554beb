"""What a filter is told of a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.newcomers import oscillator, recorded
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.refit import refit
from workbench.recordings.recording import Recording, Signal

STEP = 0.05
TRUE = {"mass": 1.0, "stiffness": 25.0, "damping": 0.6}


def _driven(seed: int, noise: float = 0.0) -> Recording:
    """A mass on a spring, pushed about along seven steps of its scale."""
    drive = 4.0 * np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, 60), 25)
    return recorded(1.0, lambda x, v: -25.0 * x - 0.6 * v, drive, 0.01, noise, seed=seed)


@pytest.mark.long
def test_intervals_hold_the_truth_where_a_scale_repeats_its_rounding() -> None:
    plain = oscillator(left_out=1e-3)
    coarse = replace(plain, outputs=(replace(plain.outputs[0], noise_rms=0.0, resolution=STEP),))
    scores = []
    for seed in range(6):
        seen = _driven(seed)
        seen = seen.with_signal(Signal("position", STEP * np.round(seen["position"] / STEP), "m"))
        found = [refit(coarse, [observe(coarse, seen)]).estimate(name) for name in TRUE]
        scores.append([(e.value - TRUE[e.name]) / e.std for e in found])
    # Repeated readings that count as independent leave 1.5, 1.5 and 1.1 (six machines).
    assert np.all(np.sqrt(np.mean(np.square(scores), axis=0)) < 1.0), scores


def test_a_sensor_finer_than_it_declares_is_read_as_it_is() -> None:
    plain = oscillator()
    coarse = replace(plain, outputs=(replace(plain.outputs[0], noise_rms=0.0, resolution=STEP),))
    seen = _driven(0, noise=1e-3)
    np.testing.assert_array_equal(observe(coarse, seen).told[:, 0], seen["position"])
