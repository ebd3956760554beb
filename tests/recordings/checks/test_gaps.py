import numpy as np
import pytest

from tests.recordings.example import example_recording, recorded, with_values
from workbench.recordings import Recording, check_recording

TRIAL = example_recording(seconds=4.0)


def without(first: int, last: int) -> np.ndarray:
    keep = np.ones(len(TRIAL), dtype=bool)
    keep[first:last] = False
    return keep


def holed(missing: np.ndarray) -> Recording:
    return with_values(TRIAL, "pressure_1", np.where(missing, np.nan, TRIAL["pressure_1"]))


def test_short_gap_is_filled_and_excluded() -> None:
    report = check_recording(TRIAL.take(without(500, 503)))
    assert report.check("gaps").result == "corrected"
    recording = report.recording
    assert np.allclose(recording.time, TRIAL.time)
    assert np.flatnonzero(~recording.valid("angle")).tolist() == [500, 501, 502]
    assert np.allclose(recording["angle"], TRIAL["angle"], atol=1e-3)
    # The command keeps its last value: what the machine got is unknown.
    assert (recording["valve"][500:503] == TRIAL["valve"][499]).all()
    assert any(note.startswith("gaps:") for note in recording.notes)


def test_rows_that_are_lost_here_and_there_leave_the_others_where_they_are() -> None:
    rng = np.random.default_rng(0)
    kept = np.flatnonzero(rng.random(1000) > 0.2)
    level = np.repeat(rng.uniform(0.0, 1.0, 20), 50)
    wave = np.sin(0.05 * np.arange(1000.0))
    trial = recorded(0.01 * kept, {"u V": level[kept]}, {"y m": wave[kept]})
    report = check_recording(trial)
    found = report.recording
    at = np.round(found.time / 0.01).astype(int)
    assert report.check("gaps").result == "corrected"
    assert found.time == pytest.approx(0.01 * at) and set(np.diff(at)) == {1}
    whole = found.valid("y")
    assert set(at[whole]) == set(kept) and np.array_equal(found["y"][whole], wave[at[whole]])
    assert np.mean(found["u"] != level[at]) < 0.01


def test_of_a_recording_with_long_gaps_the_longest_piece_is_looked_at() -> None:
    report = check_recording(TRIAL.take(without(600, 700) & without(1300, 1400)))
    found = report.check("gaps")
    assert found.result == "corrected" and report.fit
    assert report.recording.name == TRIAL.name and report.recording.time[0] == TRIAL.time[0]
    assert "2 gap(s) too long to fill" in found.note
    assert "0 to 1.198 s (600 of 1800 rows)" in found.note


def test_nothing_between_gaps_that_is_long_enough_is_unfit() -> None:
    rows = np.arange(len(TRIAL)) % 100 < 10
    assert check_recording(TRIAL.take(rows)).check("gaps").result == "unfit"


def test_missing_cells() -> None:
    report = check_recording(holed(np.isin(np.arange(len(TRIAL)), range(100, 140))))
    assert report.check("gaps").result == "corrected"
    assert np.isfinite(report.recording["pressure_1"]).all()
    assert int((~report.recording.valid("pressure_1")).sum()) == 40
    assert report.recording.valid("angle").all()


def test_a_slow_sensor_has_numbers_in_some_rows_only() -> None:
    slow = np.arange(len(TRIAL)) % 25 != 0
    report = check_recording(holed(slow))
    gaps = report.check("gaps")
    assert gaps.result == "corrected" and "pressure_1 is measured every 50 ms only" in gaps.note
    np.testing.assert_array_equal(report.recording.valid("pressure_1"), ~slow)
    # It may fail for a while, as any other.
    slow[800:1000] = True
    report = check_recording(holed(slow))
    assert report.fit
    np.testing.assert_array_equal(report.recording.valid("pressure_1"), ~slow)
    assert report.recording.valid("angle").all()


@pytest.mark.parametrize("every", [2.5, 8.0, 8.3])
def test_a_slow_sensor_repeats_what_it_read(every: float) -> None:
    rows = np.arange(len(TRIAL))
    read = np.floor(np.floor((rows + 1.3) / every) * every).clip(0, rows[-1]).astype(int)
    # Some readings are as the one before.
    coarse = 200.0 * np.round(TRIAL["pressure_1"] / 200.0)
    report = check_recording(with_values(TRIAL, "pressure_1", coarse[read]))
    gaps = report.check("gaps")
    told = f"pressure_1 is measured every {2.0 * every:.3g} ms only, and repeated"
    assert gaps.result == "corrected" and told in gaps.note, gaps
    measured = report.recording.valid("pressure_1")
    assert np.count_nonzero(measured) == pytest.approx(len(rows) / every, rel=0.02)
    late = np.abs(report.recording["pressure_1"] - TRIAL["pressure_1"])[measured]
    assert np.quantile(late, 0.9) < 2e3
    assert report.recording.valid("angle").all()


@pytest.mark.parametrize("shape", ["at a constant speed", "at several speeds"])
def test_an_encoder_reads_anew_in_all_rows(shape: str) -> None:
    speed = 0.11 if shape == "at a constant speed" else 0.11 + 0.1 * np.sin(0.8 * TRIAL.time)
    angle = np.floor(np.cumsum(speed * np.ones(len(TRIAL)))) * 1e-3
    report = check_recording(with_values(TRIAL, "angle", angle))
    assert "repeated" not in report.check("gaps").note
    assert report.recording.valid("angle").all()


def test_a_command_may_be_written_where_it_changes_only() -> None:
    held = np.repeat(np.arange(20.0), 10 * [60, 140])[: len(TRIAL)] / 4.0
    changes = np.diff(held, prepend=-1.0) != 0.0
    valve = np.where(changes, held, np.nan)
    report = check_recording(with_values(TRIAL, "valve", valve))
    assert report.check("gaps").result == "corrected"
    assert "valve is written where it changes only" in report.check("gaps").note
    np.testing.assert_array_equal(report.recording["valve"], held)
    assert report.recording.valid("valve").all()
    # A command that is written twice was lost in between, and one that begins later is unknown.
    for row, value in ((150, held[150]), (0, np.nan)):
        values = valve.copy()
        values[row] = value
        other = check_recording(with_values(TRIAL, "valve", values))
        assert other.check("gaps").result == "unfit"


def test_a_command_may_have_messages_of_its_own() -> None:
    """A log that joins topics holds in each row what one of them said."""
    held = np.repeat(np.arange(len(TRIAL) // 4 + 1.0) % 3, 4)[: len(TRIAL)]
    written = np.arange(len(TRIAL)) % 4 == 0
    written[0] = False
    report = check_recording(with_values(TRIAL, "valve", np.where(written, held, np.nan)))
    assert "valve is written every" in report.check("gaps").note
    # What was commanded before the first message nobody knows.
    np.testing.assert_array_equal(report.recording["valve"], held[4:])
    assert report.recording.valid("valve").all()


def test_mostly_missing_signal() -> None:
    broken = holed(np.arange(len(TRIAL)) < len(TRIAL) // 2)
    report = check_recording(broken)
    assert "pressure_1 is missing in 50 % of the rows" in report.check("gaps").note
    assert not report.fit
    optional = check_recording(broken, required=["valve", "angle"])
    assert optional.fit
    assert "pressure_1" not in optional.recording
