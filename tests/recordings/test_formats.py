"""MATLAB, Parquet and JSON hold the same trial; each gives the same recording."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.recordings import Recording, read_recording

TIME = np.arange(60) * 0.001
POSITION = np.cumsum(np.sin(100 * TIME)) * 1e-4
VOLTAGE = np.cos(70 * TIME)


def assert_same(recording: Recording) -> None:
    assert np.array_equal(recording.time, TIME)
    assert np.array_equal(recording["qm"], POSITION)
    assert np.array_equal(recording["vir"], VOLTAGE)
    assert recording.signal("vir").role == "command"
    assert recording.metadata["kp"] == 160.18


def test_mat_5(tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / "trial.mat"
    savemat(
        path,
        {
            "t": TIME.reshape(-1, 1),
            "qm": POSITION.reshape(1, -1),
            "vir": VOLTAGE,
            "kp": 160.18,
            "short": np.arange(7.0),
            "name": "EMPS",
        },
    )
    recording = read_recording(path)
    assert_same(recording)
    assert recording.metadata["name"] == "EMPS"
    assert "'short' has 7 samples instead of 60 and became a setting" in recording.notes[0]
    assert recording.metadata["short"] == "0, 1, 2, 3, 4, 5, 6"


def test_mat_5_structs_and_matrices(tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / "trial.mat"
    log = np.empty(2, dtype=object)
    log[0] = {"Name": "angle_deg", "Data": POSITION}
    log[1] = {"Name": "valve_V", "Data": VOLTAGE}
    savemat(path, {"rec": {"time": TIME, "p": np.column_stack([POSITION, VOLTAGE])}, "Y": log})
    recording = read_recording(
        path,
        mapping={
            "time": {"column": "rec.time"},
            "signals": {"angle": "angle_deg", "valve": "valve_V", "p": "rec.p_2"},
        },
    )
    assert np.allclose(np.rad2deg(recording["angle"]), POSITION, rtol=1e-14)
    assert np.array_equal(recording["p"], VOLTAGE)


def test_arrays_of_other_lengths_than_the_time_are_no_signals(tmp_path: Path) -> None:
    from scipy.io import savemat

    path = tmp_path / "trial.mat"
    others = {f"map_{k}": np.arange(400.0) for k in range(3)}
    savemat(path, {"t": TIME, "qm": POSITION, "vir": VOLTAGE, "kp": 160.18, **others})
    recording = read_recording(path)
    assert_same(recording)
    assert [n for n in recording.notes if "400 samples instead of 60 and was left out" in n]


def write_mat_73(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", TIME), ("qm", POSITION), ("vir", VOLTAGE)):
            # MATLAB stores a column vector as one row.
            file[name] = values.reshape(1, -1)
        file["kp"] = np.array([[160.18]])
        text = file.create_dataset("name", data=np.array([[ord(c)] for c in "EMPS"], dtype="u2"))
        text.attrs["MATLAB_class"] = np.bytes_(b"char")
    content = bytearray(path.read_bytes())
    content[:19] = b"MATLAB 7.3 MAT-file"
    path.write_bytes(bytes(content))


def test_mat_73(tmp_path: Path) -> None:
    path = tmp_path / "trial.mat"
    write_mat_73(path)
    recording = read_recording(path)
    assert_same(recording)
    assert recording.metadata["name"] == "EMPS"


def test_parquet(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "trial.parquet"
    columns = {"t": TIME, "qm": POSITION, "vir": VOLTAGE, "remark": ["ok"] * 60}
    pq.write_table(pa.table(columns).replace_schema_metadata({"kp": "160.18"}), path)
    recording = read_recording(path)
    assert_same(recording)
    assert "remark" in recording.notes[0]
    assert len(read_recording(path, max_rows=20)) == 15


def test_parquet_without_pyarrow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "trial.parquet"
    path.write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(WorkbenchError, match="install it with the extra 'parquet'"):
        read_recording(path)


def rows() -> list[dict[str, float]]:
    return [
        {"t": t, "qm": q, "vir": v}
        for t, q, v in zip(TIME.tolist(), POSITION.tolist(), VOLTAGE.tolist(), strict=True)
    ]


@pytest.mark.parametrize("form", ["entries", "lists"])
def test_json(tmp_path: Path, form: str) -> None:
    path = tmp_path / "log.json"
    content: object = {"kp": 160.18, "entries": rows()}
    if form == "lists":
        content = {
            "kp": 160.18,
            "t": TIME.tolist(),
            "qm": POSITION.tolist(),
            "vir": VOLTAGE.tolist(),
        }
    path.write_text(json.dumps(content))
    assert_same(read_recording(path))


def test_json_lines(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(json.dumps(row) for row in rows()))
    assert np.array_equal(read_recording(path)["qm"], POSITION)


def test_json_with_keys_missing_and_text(tmp_path: Path) -> None:
    entries: list[dict[str, object]] = [dict(row) for row in rows()]
    del entries[3]["qm"]
    entries[5]["qm"] = "stalled"
    entries[7]["remark"] = "x"
    path = tmp_path / "log.json"
    path.write_text(json.dumps(entries))
    recording = read_recording(path)
    assert np.flatnonzero(np.isnan(recording["qm"])).tolist() == [3, 5]
    assert "'stalled' in entry 6" in " ".join(recording.notes)


@pytest.mark.parametrize("name", ["trial.mat", "hdf.mat", "trial.parquet", "log.json"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_truncated_files_are_one_sentence(tmp_path: Path, name: str, share: float) -> None:
    path = tmp_path / name
    if name == "trial.mat":
        from scipy.io import savemat

        savemat(path, {"t": TIME, "qm": POSITION})
    elif name == "hdf.mat":
        write_mat_73(path)
    elif name == "trial.parquet":
        pq = pytest.importorskip("pyarrow.parquet")
        pa = pytest.importorskip("pyarrow")
        pq.write_table(pa.table({"t": TIME}), path)
    else:
        path.write_text(json.dumps(rows()))
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(WorkbenchError, match="truncated|holds no|not a") as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)


def test_unknown_format_and_missing_file(tmp_path: Path) -> None:
    (tmp_path / "trial.xlsx").write_bytes(b"PK")
    with pytest.raises(WorkbenchError, match=r"'.xlsx', which is no known format"):
        read_recording(tmp_path / "trial.xlsx")
    (tmp_path / "trial.csv").write_text("")
    with pytest.raises(WorkbenchError, match=r"did you mean 'trial.csv'"):
        read_recording(tmp_path / "trail.csv")
    with pytest.raises(WorkbenchError, match="is a folder; read_case"):
        read_recording(tmp_path)


OWN_FORMAT = """
import numpy as np
from workbench.recordings.columns import Columns
from workbench.recordings.formats.format import Format

def read(path, options):
    values = np.frombuffer(path.read_bytes()).reshape(-1, 2)
    return Columns(("time_s", "angle_deg"), ("", ""), values)

logger = Format("logger", "the rig's logger", (".rig",), read)

def broken(path, options):
    return 1 / 0
"""


def test_a_format_of_the_users_own(tmp_path: Path) -> None:
    (tmp_path / "rig_format.py").write_text(OWN_FORMAT)
    path = tmp_path / "trial.rig"
    path.write_bytes(np.column_stack([TIME, np.rad2deg(POSITION)]).tobytes())
    rules = tmp_path / "trial.mapping.toml"
    for name in ("rig_format:logger", "rig_format:read"):
        rules.write_text(f'format = "{name}"\n')
        assert np.allclose(read_recording(path)["angle"], POSITION, rtol=1e-12)
    rules.write_text('format = "rig_format:broken"\n')
    with pytest.raises(WorkbenchError, match=r"ZeroDivisionError.*rig_format.py, line 13"):
        read_recording(path)
    rules.write_text('format = "jsno"\n')
    with pytest.raises(WorkbenchError, match="json"):
        read_recording(path)
