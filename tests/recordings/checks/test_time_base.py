from dataclasses import replace

import numpy as np
import pytest

from tests.recordings.example import example_recording, recorded, with_values
from workbench.recordings import Recording, check_recording
from workbench.recordings.checks import Expected
from workbench.recordings.checks.time_base import check_time_base, check_uniformity

TRIAL = example_recording(seconds=4.0)


def checked(recording: Recording, name: str = "time base") -> tuple[str, str, Recording]:
    report = check_recording(recording)
    check = report.check(name)
    return check.result, check.note, report.recording


def with_time(time: np.ndarray) -> Recording:
    return replace(TRIAL, time=time)


RESET = np.where(np.arange(2000) < 1500, TRIAL.time, TRIAL.time - TRIAL.time[1500])
SWAPPED = np.arange(2000)
SWAPPED[[100, 101, 700, 701]] = [101, 100, 701, 700]
REPEATED = np.sort(np.append(np.arange(2000), [5, 5, 900]))
NANOSECONDS = with_time(TRIAL.time * 1e9)
FOUND: list[tuple[Recording, str, str]] = [
    (TRIAL, "pass", ""),
    (with_time(TRIAL.time % 0.5), "unfit", "split the file"),
    (with_time(np.zeros(2000)), "unfit", "the time never advances"),
    (TRIAL[:10], "unfit", "10 samples"),
    (replace(TRIAL, metadata={"sample_rate_Hz": 250}), "unfit", "250 Hz but the time says 500 Hz"),
    (NANOSECONDS, "unfit", "ns"),
    # What is corrected is the trial that it was made of, or the first rows of it.
    (TRIAL.take(SWAPPED), "corrected", "sorted"),
    (with_time(RESET), "corrected", "longest stretch was kept (1500 of 2000 rows)"),
    (TRIAL.take(REPEATED), "corrected", "3 row(s) with a repeated instant"),
    (with_time(np.floor(TRIAL.time / 0.01 + 1e-9) * 0.01), "corrected", "coarser"),
    *((replace(TRIAL, time=TRIAL.time * k, metadata={"sample_rate_Hz": 500}), "corrected",
       f"the time is in {unit}") for k, unit in ((1e3, "ms"), (1e6, "us"), (1e9, "ns"))),
]  # fmt: skip


@pytest.mark.parametrize(("recording", "result", "said"), FOUND)
def test_what_is_found_of_a_time_base(recording: Recording, result: str, said: str) -> None:
    found, note, corrected = checked(recording)
    assert (found, said in note) == (result, True), note
    if result == "corrected":
        n = 1500 if "longest" in said else 2000
        assert np.array_equal(corrected["angle"], TRIAL["angle"][:n])
        assert np.allclose(np.diff(corrected.time), 0.002, rtol=1e-3)
        assert said == "coarser" or np.allclose(corrected.time, TRIAL.time[:n])


def test_a_clock_that_is_put_back_in_the_night_goes_on() -> None:
    time = 5.0 * np.arange(400.0)
    told = recorded(np.where(time > 1200.0, time - 3600.0, time), {"u V": time % 7}, {"y m": time})
    result, note, found = checked(told)
    assert result == "corrected" and "put back by an hour after 1200 s" in note
    assert np.array_equal(found.time, time) and np.array_equal(found["y"], time)


def test_of_the_rows_of_an_event_the_one_after_it_counts() -> None:
    time = np.sort(np.append(np.arange(40.0), 20.0))
    found = check_time_base(recorded(time, {"valve V": np.arange(41) > 20}, {}), Expected())
    assert found.recording is not None and list(found.recording["valve"][19:22]) == [0.0, 1.0, 1.0]


def test_events_between_even_instants_move_no_sample() -> None:
    time = np.sort(np.append(np.arange(40.0), [7.25, 20.5]))
    trial = recorded(time, {"valve V": time >= 20.5}, {"level m": time**2})
    found = check_uniformity(trial, Expected())
    assert np.array_equal(found.recording.time, np.arange(40.0))
    assert np.array_equal(found.recording["level"], np.arange(40.0) ** 2)
    # The command of a step is its mean there.
    assert list(found.recording["valve"][19:22]) == [0.0, 0.5, 1.0]


def test_jitter_is_interpolated(rng: np.random.Generator) -> None:
    time = TRIAL.time + rng.uniform(-6e-4, 6e-4, 2000)
    true = np.interp(time, TRIAL.time, TRIAL["angle"])
    result, note, recording = checked(with_values(with_time(time), "angle", true), "uniformity")
    assert (result, "interpolated to" in note) == ("corrected", True)
    assert np.ptp(np.diff(recording.time)) < 1e-9
    # Straight lines between samples 2 ms apart; the angular acceleration stays below 400 rad/s2.
    again = np.interp(recording.time, TRIAL.time, TRIAL["angle"])
    assert np.abs(recording["angle"] - again).max() < 2e-4


@pytest.mark.parametrize("taken_late", [False, True])
def test_a_clock_that_is_uneven_alone_moves_no_sample(
    taken_late: bool, rng: np.random.Generator
) -> None:
    even = 0.05 * np.arange(1000)
    late = rng.normal(0.0, 1.2e-3, 1000)
    taken = even + taken_late * late
    height = np.sin(0.9 * taken) + 0.5 * np.sin(1.7 * taken) + rng.normal(0.0, 5e-4, 1000)
    moved = recorded(even + late - late[0], {}, {"height m": height})
    result, note, recording = checked(moved, "uniformity")
    assert (result, "interpolated" in note) == ("corrected", taken_late)
    assert np.ptp(np.diff(recording.time)) < 1e-9
    assert np.array_equal(recording["height"], height) is not taken_late
    # All stamps together tell the step, not the first and the last one.
    assert taken_late or recording.sample_time == pytest.approx(0.05, abs=4e-7)
