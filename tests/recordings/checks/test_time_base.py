from dataclasses import replace

import numpy as np
import pytest

from tests.recordings.example import example_recording
from workbench.recordings import Recording, Signal, check_recording
from workbench.recordings.checks import Expected
from workbench.recordings.checks.time_base import check_time_base, check_uniformity

TRIAL = example_recording(seconds=4.0)


def checked(recording: Recording, name: str = "time base") -> tuple[str, str, Recording]:
    report = check_recording(recording)
    check = report.check(name)
    return check.result, check.note, report.recording


def with_time(time: np.ndarray) -> Recording:
    return replace(TRIAL, time=time)


def test_clean() -> None:
    assert check_recording(TRIAL).result == "pass"


def test_swapped_rows_are_sorted() -> None:
    order = np.arange(2000)
    order[[100, 101, 700, 701]] = order[[101, 100, 701, 700]]
    result, note, recording = checked(TRIAL.take(order))
    assert (result, "sorted" in note) == ("corrected", True)
    assert np.array_equal(recording.time, TRIAL.time)
    assert np.array_equal(recording["angle"], TRIAL["angle"])


def test_clock_reset_keeps_the_longest_stretch() -> None:
    time = TRIAL.time.copy()
    time[1500:] -= time[1500]
    result, note, recording = checked(with_time(time))
    assert (result, len(recording)) == ("corrected", 1500)
    assert "longest stretch was kept (1500 of 2000 rows)" in note


def test_many_resets_are_unfit() -> None:
    result, note, _ = checked(with_time(TRIAL.time % 0.5))
    assert (result, "split the file" in note) == ("unfit", True)


def test_repeated_instants_are_left_out() -> None:
    rows = np.sort(np.concatenate([np.arange(2000), [5, 5, 900]]))
    result, note, recording = checked(TRIAL.take(rows))
    assert (result, len(recording)) == ("corrected", 2000)
    assert "3 row(s) with a repeated instant" in note


def test_of_the_rows_of_an_event_the_one_after_it_counts() -> None:
    time = np.sort(np.append(np.arange(40.0), 20.0))
    step = Signal("valve", (np.arange(41) > 20).astype(float), "V", role="command")
    found = check_time_base(Recording("export", time, (step,)), Expected())
    assert found.recording is not None and list(found.recording["valve"][19:22]) == [0.0, 1.0, 1.0]


def test_events_between_even_instants_move_no_sample() -> None:
    time = np.sort(np.append(np.arange(40.0), [7.25, 20.5]))
    signals = (
        Signal("valve", (time >= 20.5).astype(float), "V", role="command"),
        Signal("level", time**2, "m"),
    )
    found = check_uniformity(Recording("export", time, signals), Expected())
    assert np.array_equal(found.recording.time, np.arange(40.0))
    assert np.array_equal(found.recording["level"], np.arange(40.0) ** 2)
    # The command of a step is its mean there.
    assert list(found.recording["valve"][19:22]) == [0.0, 0.5, 1.0]


def test_coarse_clock_is_spread() -> None:
    result, note, recording = checked(with_time(np.floor(TRIAL.time / 0.01 + 1e-9) * 0.01))
    assert (result, "coarser" in note) == ("corrected", True)
    assert np.allclose(np.diff(recording.time), 0.002, rtol=1e-3)


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_wrong_unit_of_time(factor: float) -> None:
    wrong = replace(TRIAL, time=TRIAL.time * factor, metadata={"sample_rate_Hz": 500})
    result, note, recording = checked(wrong)
    assert (result, "the time is in" in note) == ("corrected", True)
    assert np.allclose(recording.time, TRIAL.time)


def test_notes_and_time_disagree() -> None:
    result, note, _ = checked(replace(TRIAL, metadata={"sample_rate_Hz": 250}))
    assert (result, "250 Hz but the time says 500 Hz" in note) == ("unfit", True)


def test_time_that_stands_still() -> None:
    assert checked(with_time(np.zeros(2000)))[:2] == ("unfit", "the time never advances")


def test_too_short() -> None:
    assert checked(TRIAL[:10])[0] == "unfit"


def test_jitter_is_interpolated(rng: np.random.Generator) -> None:
    time = TRIAL.time + rng.uniform(-6e-4, 6e-4, 2000)
    true = np.interp(time, TRIAL.time, TRIAL["angle"])
    moved = replace(TRIAL, time=time).with_signal(replace(TRIAL.signal("angle"), values=true))
    result, note, recording = checked(moved, "uniformity")
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
    moved = Recording("lift", even + late - late[0], (Signal("height", height, "m"),))
    result, note, recording = checked(moved, "uniformity")
    assert (result, "interpolated" in note) == ("corrected", taken_late)
    assert np.ptp(np.diff(recording.time)) < 1e-9
    assert np.array_equal(recording["height"], height) is not taken_late
    # All stamps together tell the step, not the first and the last one.
    assert taken_late or recording.sample_time == pytest.approx(0.05, abs=4e-7)


def test_nanoseconds_called_seconds() -> None:
    trial = example_recording(seconds=2.0)
    late = replace(trial, time=trial.time * 1e9)
    check = check_recording(late).check("time base")
    assert (check.result, "ns" in check.note) == ("unfit", True)
    noted = replace(late, metadata={"sample_rate_Hz": 500.0})
    assert "the time is in ns" in check_recording(noted).check("time base").note
