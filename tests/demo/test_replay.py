"""A replay starts where the recording starts and is driven by its voltage alone."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.demo.replay import replay
from workbench.plants.arm import arm
from workbench.recordings import Recording, Signal
from workbench.simulation import simulate


def recorded(seed: int = 3) -> Recording:
    rng = np.random.default_rng(seed)
    voltage = 5.0 + np.repeat(rng.uniform(-0.6, 0.6, 10), 100)
    # The first samples rest at the centre, from which the start is averaged.
    voltage[:50] = 5.0
    run = simulate(arm(3), voltage, sample_time=0.002)
    signals = tuple(
        Signal(name, run[name], unit, role=role)  # type: ignore[arg-type]
        for name, unit, role in (
            ("valve", "V", "command"),
            ("angle", "rad", "measurement"),
            ("pressure_1", "Pa", "measurement"),
            ("pressure_2", "Pa", "measurement"),
        )
    )
    return Recording("made", run.time, signals)


def test_the_plant_that_made_the_recording_gives_it_back() -> None:
    found = replay(arm(3), recorded())
    # The mean of the first ten samples is not the first one: the pressures drift meanwhile, by less
    # than the 600 Pa of noise of the sensors.
    assert np.degrees(found.rms("angle")) < 0.05
    assert found.rms("pressure_1") < 600.0


def test_another_load_does_not() -> None:
    assert np.degrees(replay(arm(5), recorded()).rms("angle")) > 0.5


def test_difference_is_measured_minus_simulated() -> None:
    found = replay(arm(5), recorded())
    expected = found.recording["angle"] - found.trajectory["angle"]
    np.testing.assert_array_equal(found.difference("angle"), expected)
    assert found.rms("angle") == pytest.approx(float(np.sqrt(np.mean(expected**2))))
