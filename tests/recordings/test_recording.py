import json
from pathlib import Path

import numpy as np
import pytest

from tests.recordings.example import example_recording
from workbench.errors import WorkbenchError
from workbench.recordings import Recording, Signal, Span, read_recording


def test_arrays_cannot_be_changed() -> None:
    values = np.zeros(3)
    recording = Recording("r", np.arange(3.0), (Signal("x", values),))
    values[0] = 1.0
    assert recording["x"][0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        recording["x"][0] = 2.0


@pytest.mark.parametrize(
    ("time", "signals", "message"),
    [
        ([0.0, 1.0], (Signal("x", np.zeros(3)),), "has 3 samples but the time has 2"),
        ([0.0, np.nan], (Signal("x", np.zeros(2)),), "not finite"),
        ([0.0, 1.0], (Signal("x", np.zeros(2)), Signal("x", np.zeros(2))), "two signals 'x'"),
        ([[0.0], [1.0]], (), "one column"),
        ([0.0, 1.0], {"x": np.zeros(2)}, r"is a str; give each as Signal\(name, values, unit\)"),
    ],
)
def test_what_is_no_recording(time: list[float], signals: tuple[Signal, ...], message: str) -> None:
    with pytest.raises(WorkbenchError, match=message):
        Recording("r", np.array(time), signals)


def test_slices_and_selections() -> None:
    recording = example_recording(seconds=2.0)
    assert len(recording[10:20]) == 10
    assert recording.between(0.5, 0.7).time[0] == pytest.approx(0.5)
    assert recording.select(["angle", "valve"]).names == ("angle", "valve")
    assert recording.matrix(["angle", "valve"]).shape == (1000, 2)
    with pytest.raises(WorkbenchError, match="did you mean 'angle'"):
        _ = recording["angel"]
    with pytest.raises(WorkbenchError, match="no samples from 5 to 6 s"):
        recording.between(5.0, 6.0)


def test_excluded_spans() -> None:
    spans = (Span("x", 2.0, 4.0, "frozen"), Span("y", 0.0, 9.0, "clipped"))
    x = np.zeros(10)
    x[9] = np.nan
    recording = Recording("r", np.arange(10.0), (Signal("x", x), Signal("y", x)), excluded=spans)
    assert np.flatnonzero(~recording.valid("x")).tolist() == [2, 3, 4, 9]
    assert not recording.valid("y").any()
    # The spans are instants, so they hold on any time base, increasing or not.
    assert np.flatnonzero(~recording[::2].valid("x")).tolist() == [1, 2]
    backwards = recording.take(np.arange(10)[::-1])
    assert np.flatnonzero(~backwards.valid("x")).tolist() == [0, 5, 6, 7]


def test_prints_itself() -> None:
    text = str(example_recording(seconds=2.0).noted("something was corrected"))
    assert "gauge pressure  measurement  bar" in text
    assert text.endswith("note: something was corrected")


def test_a_script_learns_how_columns_were_read(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("t_ms,n_rpm\n0,30\n10,-60\n20,\n")
    told = json.loads(json.dumps(read_recording(file).as_data()))
    (signal,) = told["signals"]
    assert (signal["unit"], signal["minimum"], signal["maximum"]) == ("rpm", -60.0, 30.0)
    assert signal["missing"] == 1
    assert [(row["column"], row["signal"], row["unit"]) for row in told["columns"]] == [
        ("t_ms", "time", "ms"),
        ("n_rpm", "n", "rpm"),
    ]
