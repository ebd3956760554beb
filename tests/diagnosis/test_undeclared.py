"""What a plant declares of its sensors, and what the recordings show instead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.newcomers import oscillator
from workbench.diagnosis.undeclared import as_coarse_as_recorded
from workbench.recordings.recording import Recording, Signal


def _swinging(step: float) -> Recording:
    time = 0.01 * np.arange(2000)
    position = np.sin(time) + 1e-3 * np.random.default_rng(1).normal(size=len(time))
    if step:
        position = step * np.round(position / step)
    signals = Signal("drive", 0.0 * time, "N", role="command"), Signal("position", position, "m")
    return Recording("swinging", time, signals)


def test_steps_coarser_than_declared_count_as_noise() -> None:
    model, (row,) = as_coarse_as_recorded(oscillator(), [_swinging(0.0), _swinging(0.02)])
    assert model.outputs[0].resolution == pytest.approx(0.02)
    assert row["result"] == "corrected" and "steps of 0.02 m" in row["note"]


def test_steps_below_the_declared_noise_or_resolution_change_nothing() -> None:
    declared = oscillator()
    fine = replace(declared, outputs=(replace(declared.outputs[0], resolution=0.02),))
    for model, step in ((declared, 0.0), (declared, 1e-3), (fine, 0.02)):
        assert as_coarse_as_recorded(model, [_swinging(step)]) == (model, ())
