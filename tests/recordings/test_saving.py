from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.recordings.example import example_recording
from workbench.errors import WorkbenchError
from workbench.recordings import Recording, Signal, Span, read_recording, write_recording


def assert_equal(a: Recording, b: Recording) -> None:
    assert np.array_equal(a.time, b.time)
    for s, r in zip(a.signals, b.signals, strict=True):
        assert np.array_equal(s.values, r.values, equal_nan=True)
        assert vars(s) | {"values": 0} == vars(r) | {"values": 0}
    assert vars(a) | {"time": 0, "signals": 0} == vars(b) | {"time": 0, "signals": 0}


@pytest.mark.parametrize("name", ["trial.csv", "trial.csv.gz"])
def test_round_trip_keeps_every_bit(tmp_path: Path, name: str, rng: np.random.Generator) -> None:
    n = 300
    missing = rng.normal(size=n) * 1e-7
    missing[5:9] = np.nan
    recording = Recording(
        "bench, 2",
        np.cumsum(rng.uniform(1e-3, 2e-3, n)) + 1.7e9,
        (
            Signal("valve", rng.normal(size=n), "V", role="command"),
            Signal("angle", missing, "rad", display_unit="deg"),
            Signal("torque_N_m", rng.normal(size=n) * 1e5, "N m"),
            Signal("supply_V", rng.normal(size=n), "Pa", kind="gauge pressure"),
            Signal("goal", rng.normal(size=n), role="reference"),
        ),
        source='logger "A"',
        notes=("first", "second; µ"),
        metadata={"load_kg": 3, "plane": "v"},
        excluded=(Span("angle", 0.1, 0.2, "frozen"),),
    )
    again = read_recording(write_recording(recording, tmp_path / name))
    assert_equal(again, recording)


def test_round_trip_of_a_file_that_was_read(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        "time_ms;angle_deg;p_bar_abs\n"
        + "".join(f"{2 * k};{k % 9},5;{k / 7:.3f}\n".replace(".", ",") for k in range(40))
    )
    recording = read_recording(path)
    assert_equal(read_recording(write_recording(recording, tmp_path / "b.csv")), recording)


def test_nothing_is_left_of_a_failed_write(tmp_path: Path) -> None:
    recording = example_recording(seconds=2.0)
    target = tmp_path / "a.csv"
    target.write_text("earlier")
    with pytest.raises(WorkbenchError, match="cannot be written"):
        write_recording(recording, target / "b.csv")
    with pytest.raises(WorkbenchError, match="metadata"):
        write_recording(replace(recording, metadata={"x": float("nan")}), target)
    assert target.read_text() == "earlier"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_description_of_other_columns_is_refused(tmp_path: Path) -> None:
    path = write_recording(example_recording(seconds=2.0), tmp_path / "a.csv")
    path.write_text(
        path.read_text().replace("angle_rad", "theta_rad", 1).replace(",angle_rad", ",theta", 1)
    )
    with pytest.raises(WorkbenchError, match="describes another recording"):
        read_recording(path)
