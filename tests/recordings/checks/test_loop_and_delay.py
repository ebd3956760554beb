"""Feedback and delays of made-up loops whose answers are known."""

import numpy as np
import pytest

from tests.recordings.example import example_recording, recorded, with_values
from workbench.recordings import Recording, check_recording
from workbench.recordings.checks import estimate_delay
from workbench.recordings.checks.loop import feedback_strength


def loop(gain: float, delay: int, seed: int, n: int = 8000) -> Recording:
    """A first-order plant with dead time and noise; a proportional controller if gain is not 0."""
    rng = np.random.default_rng(seed)
    goal = np.repeat(rng.normal(size=n // 200 + 1), 200)[:n]
    u, y = np.zeros(n), np.zeros(n)
    state = 0.0
    for k in range(n):
        y[k] = state + 0.01 * rng.normal()
        u[k] = goal[k] + (gain * (goal[k] - y[k]) if gain else 0.0)
        state += 0.01 * (u[max(0, k - delay)] - state)
    return recorded(0.002, {"u V": u}, {"y m": y})


def loop_of(recording: Recording) -> str:
    """Whether the check of the loop finds one: open, closed or unknown."""
    return str(check_recording(recording).check("loop").values["loop"])


@pytest.mark.parametrize("seed", range(6))
def test_open_loops_show_no_feedback(seed: int) -> None:
    trial = loop(0.0, 3, seed)
    assert feedback_strength(trial, "u", "y")[0] < 5.0
    assert loop_of(trial) == "open"


@pytest.mark.parametrize("seed", range(6))
def test_noise_in_the_command_shows_feedback(seed: int) -> None:
    # A proportional controller answers within the sample; a later lag shows with its filter.
    trial = loop(2.0, 3, seed)
    filtered = trial["u"].copy()
    for k in range(1, len(filtered)):
        filtered[k] = 0.5 * filtered[k - 1] + 0.5 * trial["u"][k]
    assert loop_of(with_values(trial, "u", filtered)) == "closed"


def test_smooth_command_without_feedback_is_unknown() -> None:
    time = 0.002 * np.arange(6000)
    u = np.sin(3 * time) + np.sin(7.3 * time)
    y = np.sin(3 * time - 0.4) + np.sin(7.3 * time - 0.9)
    y += 1e-3 * np.random.default_rng(0).normal(size=6000)
    assert loop_of(recorded(time, {"u V": u}, {"y m": y})) == "unknown"


def _driven(voltage: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return speed and current of a motor; the latter answers to its voltage at once."""
    speed, current = np.zeros((2, len(voltage)))
    for k, volts in enumerate(voltage):
        current[k] = (volts - 0.05 * speed[k]) / 1.2
        speed[k + 1 : k + 2] = speed[k] + 0.01 * (0.05 * current[k] - 8e-4 * speed[k]) / 1.5e-3
    noise = rng.normal(size=(2, len(voltage)))
    return {"n rad/s": speed + 0.3 * noise[0], "i A": current + 0.02 * noise[1]}


@pytest.mark.parametrize("late", [0, 1, 3])
def test_a_held_command_that_was_written_late_is_no_feedback(late: int) -> None:
    rng = np.random.default_rng(0)
    voltage = np.repeat(rng.uniform(-12.0, 12.0, 24), 50)
    read = {name: values[late:] for name, values in _driven(voltage, rng).items()}
    found = check_recording(recorded(0.01, {"u V": voltage[: len(voltage) - late]}, read))
    loop = found.check("loop")
    assert loop.values["loop"] == "open" and loop.doubt == (late > 0)
    assert not late or f"u changes {10 * late} ms after i answers" in loop.note


@pytest.mark.parametrize("seed", range(3))
def test_a_thermostat_does_not_know_what_comes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    warm, on = 0.0, 1.0
    heat, read = np.zeros(6000), np.zeros(6000)
    for k in range(6000):
        read[k] = warm + 0.02 * rng.normal()
        on = 0.0 if read[k] > 21.0 else 1.0 if read[k] < 19.0 else on
        heat[k] = on
        warm += 0.005 * (40.0 * on - warm) + 0.02 * rng.normal()
    assert (
        not check_recording(recorded(1.0, {"heat 1": heat}, {"room K": read})).check("loop").doubt
    )


@pytest.mark.parametrize("closed", [False, True])
def test_example(closed: bool) -> None:
    trial = example_recording(seconds=20.0, closed_loop=closed)
    assert loop_of(trial) == ("closed" if closed else "open")


@pytest.mark.parametrize("delay", [0, 2, 5, 11])
@pytest.mark.parametrize("gain", [0.0, 2.0])
def test_delay(delay: int, gain: float) -> None:
    trial = loop(gain, delay, 1, n=20_000)
    found = estimate_delay(trial, "u", "y", closed_loop=gain > 0)
    # The state answers one sample after the delayed command; the response then rises slowly.
    assert found.onset == pytest.approx(0.002 * (delay + 1), abs=0.0061)
    assert found.onset >= 0.002 * (delay + 1) - 1e-9
    assert found.strength > 5.5


def test_a_peak_far_behind_the_command_that_is_no_answer_is_no_delay() -> None:
    rng = np.random.default_rng(0)
    u, *noise = rng.normal(size=(3, 4000))
    pushed = {"y m": 0.5 * np.roll(u, 1) + noise[0], "z m": 0.11 * np.roll(u, 150) + noise[1]}
    read = {name: np.cumsum(push) for name, push in pushed.items()}
    trial = recorded(0.001, {"u V": u}, read)
    assert np.isfinite(estimate_delay(trial, "u", "z").onset)
    report = check_recording(trial)
    assert "no answer of z to u is seen" in report.check("response").note
    assert "u shows in y" in report.check("delay").note
    assert "in z" not in report.check("delay").note


@pytest.mark.parametrize("n", [125, 150])
def test_a_recording_that_is_shorter_than_the_longest_delay_has_one(n: int) -> None:
    rng = np.random.default_rng(0)
    u = rng.normal(size=n)
    late = np.concatenate([np.zeros(3), u[:-3]]) + 0.1 * rng.normal(size=n)
    trial = recorded(0.001, {"u V": u}, {"y m": late})
    assert estimate_delay(trial, "u", "y").onset == pytest.approx(0.003)
