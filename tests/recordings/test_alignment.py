from dataclasses import replace

import numpy as np
import pytest

from tests.recordings.example import example_recording
from workbench.errors import WorkbenchError
from workbench.recordings import Recording, Signal, align, clock_shift, resample


@pytest.mark.parametrize("shift", [-0.7, 0.0, 0.0031, 1.2])
def test_shift_of_a_second_logger(shift: float, rng: np.random.Generator) -> None:
    trial = example_recording(seconds=6.0)
    angle = trial.signal("angle")
    noisy = replace(angle, values=angle.values + rng.normal(0, 2e-5, len(trial)))
    second = Recording("logger 2", trial.time, (noisy, Signal("force", angle.values * 3, "N")))
    second = resample(second, rate_Hz=311.0)
    second = replace(second, time=second.time + shift)
    found, likeness = clock_shift(trial, second, "angle")
    # A parabola through three samples resolves a small part of the 2 ms step.
    assert found == pytest.approx(shift, abs=4e-4)
    assert likeness > 0.5
    both = align(trial, second, "angle")
    assert both.names == (*trial.names, "force")
    inner = slice(50, -50)
    assert np.allclose(both["force"][inner], 3 * both["angle"][inner], atol=3e-3)
    assert "its clock was" in both.notes[-1]


def test_what_does_not_belong_together(rng: np.random.Generator) -> None:
    trial = example_recording(seconds=2.0)
    other = Recording("other", trial.time, (Signal("angle", rng.normal(size=1000), "rad"),))
    with pytest.raises(WorkbenchError, match="do not match on 'angle'"):
        align(trial, other, "angle")
    still = Recording("still", trial.time, (Signal("angle", np.ones(1000), "rad"),))
    with pytest.raises(WorkbenchError, match="is constant"):
        align(trial, still, "angle")
