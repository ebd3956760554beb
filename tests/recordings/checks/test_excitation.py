import numpy as np
import pytest

from workbench.recordings import Recording, Signal, check_recording

TIME = 0.002 * np.arange(5000)


def directions_of(values: np.ndarray) -> tuple[float, float, float, int]:
    trial = Recording("r", TIME, (Signal("angle", values, "rad"),))
    found = check_recording(trial).check("excitation").values["directions"]["angle"]
    return found.forward, found.backward, found.resting, found.reversals


def test_directions() -> None:
    noise = 1e-5 * np.random.default_rng(1).normal(size=5000)
    forward, backward, resting, reversals = directions_of(
        np.interp(TIME, [0, 4, 6, 8, 10], [0, 1, 1, 0.5, 0.5]) + noise
    )
    assert forward == pytest.approx(0.4, abs=0.02)
    assert backward == pytest.approx(0.2, abs=0.02)
    assert resting == pytest.approx(0.4, abs=0.03)
    assert reversals == 1


def test_one_way_motion_is_told() -> None:
    trial = Recording("r", TIME, (Signal("angle", 0.1 * TIME + 0.01 * np.sin(TIME), "rad"),))
    assert "one way only" in check_recording(trial).check("excitation").note
