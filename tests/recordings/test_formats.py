"""MATLAB, Parquet and JSON hold the same trial; each gives the same recording."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from tests.recordings.example import Read
from workbench.errors import WorkbenchError
from workbench.recordings import Recording, read_recording

TIME = np.arange(60) * 0.001
POSITION = np.cumsum(np.sin(100 * TIME)) * 1e-4
VOLTAGE = np.cos(70 * TIME)


def saved(folder: Path, **variables: object) -> Path:
    """Save variables as MATLAB does."""
    path = folder / "trial.mat"
    savemat(path, variables)
    return path


def assert_same(recording: Recording) -> None:
    assert np.array_equal(recording.time, TIME)
    assert np.array_equal(recording["qm"], POSITION)
    assert np.array_equal(recording["vir"], VOLTAGE)
    assert recording.signal("vir").role == "command"
    assert recording.metadata["kp"] == 160.18


def test_mat_5(tmp_path: Path) -> None:
    columns = {"t": TIME.reshape(-1, 1), "qm": POSITION.reshape(1, -1), "vir": VOLTAGE}
    others = {"kp": 160.18, "short": np.arange(7.0), "name": "EMPS"}
    recording = read_recording(saved(tmp_path, **columns, **others))
    assert_same(recording)
    assert recording.metadata["name"] == "EMPS"
    assert "'short' has 7 samples instead of 60 and became a setting" in recording.notes[0]
    assert recording.metadata["short"] == "0, 1, 2, 3, 4, 5, 6"


@pytest.mark.parametrize(("title", "data"), [("Name", "Data"), ("label", "values")])
def test_mat_5_structs_and_matrices(tmp_path: Path, title: str, data: str) -> None:
    log = np.empty(2, dtype=object)
    log[0] = {title: "angle_deg", data: POSITION}
    log[1] = {title: "valve_V", data: VOLTAGE}
    path = saved(tmp_path, rec={"time": TIME, "p": np.c_[POSITION, VOLTAGE]}, Y=log)
    signals = {"angle": "angle_deg", "valve": "valve_V", "p": "rec.p_2"}
    rules = {"time": {"column": "rec.time"}, "signals": signals}
    recording = read_recording(path, mapping=rules)
    assert np.allclose(np.rad2deg(recording["angle"]), POSITION, rtol=1e-14)
    assert np.array_equal(recording["p"], VOLTAGE)


def test_columns_of_a_matrix_get_the_names_of_a_mapping(tmp_path: Path) -> None:
    path = saved(tmp_path, M=np.c_[TIME, VOLTAGE, POSITION])
    recording = read_recording(path, mapping={"columns": ["time_s", "vir_V", "qm_mm"]})
    assert recording.names == ("vir", "qm") and np.array_equal(recording.time, TIME)
    assert recording["qm"] == pytest.approx(1e-3 * POSITION)
    with pytest.raises(WorkbenchError, match="names 2 columns but trial.mat has 3"):
        read_recording(path, mapping={"columns": ["time_s", "vir_V"]})


@pytest.mark.parametrize("every", [1, 5])
def test_time_series_share_the_instants_of_all(tmp_path: Path, every: int) -> None:
    series = {
        "vir": {"Time": TIME.reshape(-1, 1), "Data": VOLTAGE.reshape(1, 1, -1)},
        "qm": {"Time": 1.0 * TIME[::every], "Data": POSITION[::every]},
    }
    recording = read_recording(saved(tmp_path, **series, kp=160.18))
    assert np.array_equal(recording.time, TIME) and recording.metadata["kp"] == 160.18
    assert np.array_equal(recording["vir"], VOLTAGE)
    assert np.array_equal(recording["qm"][::every], POSITION[::every])
    assert np.count_nonzero(np.isfinite(recording["qm"])) == len(TIME[::every])
    alone = read_recording(saved(tmp_path, qm=series["qm"]))
    assert alone.names == ("qm",) and np.array_equal(alone["qm"], POSITION[::every])


def test_tables_that_share_their_first_column_have_it_for_the_time(tmp_path: Path) -> None:
    both = {"u": np.c_[TIME, VOLTAGE], "y": np.c_[TIME, POSITION, 2.0 * POSITION]}
    recording = read_recording(saved(tmp_path, **both))
    assert recording.names == ("u", "y_1", "y_2")
    assert np.array_equal(recording.time, TIME) and np.array_equal(recording["u"], VOLTAGE)
    other = read_recording(saved(tmp_path, **both | {"u": np.c_[VOLTAGE, VOLTAGE], "t": TIME}))
    assert other.names == ("u_1", "u_2", "y_1", "y_2", "y_3")


def test_arrays_of_other_lengths_than_the_time_are_no_signals(tmp_path: Path) -> None:
    others = {f"map_{k}": np.arange(400.0) for k in range(3)}
    path = saved(tmp_path, t=TIME, qm=POSITION, vir=VOLTAGE, kp=160.18, **others)
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


def rows() -> list[dict[str, float]]:
    columns = np.c_[TIME, POSITION, VOLTAGE]
    return [dict(zip(("t", "qm", "vir"), row, strict=True)) for row in columns.tolist()]


def test_json(read: Read) -> None:
    assert_same(read(json.dumps({"kp": 160.18, "entries": rows()}), "log.json"))
    lists = {"t": TIME.tolist(), "qm": POSITION.tolist(), "vir": VOLTAGE.tolist()}
    assert_same(read(json.dumps({"kp": 160.18, **lists}), "log.json"))
    assert np.array_equal(read(map(json.dumps, rows()), "log.jsonl")["qm"], POSITION)


def test_json_of_objects_with_instants(read: Read) -> None:
    entries = [
        {"ts": f"2024-03-04T10:11:{row['t']:09.6f}Z", "axis": {"qm": row["qm"], "ok": True}}
        for row in rows()
    ]
    recording = read(map(json.dumps, entries), "log.jsonl", signals={"qm": "m"})
    assert np.array_equal(recording["qm"], POSITION)
    assert np.allclose(recording.time, TIME, atol=1e-6)


def test_json_with_keys_missing_and_text(read: Read) -> None:
    entries: list[dict[str, object]] = [dict(row) for row in rows()]
    del entries[3]["qm"]
    entries[5]["qm"] = "stalled"
    entries[7]["remark"] = "x"
    recording = read(json.dumps(entries), "log.json")
    assert np.flatnonzero(np.isnan(recording["qm"])).tolist() == [3, 5]
    assert "'stalled' in entry 6" in " ".join(recording.notes)


@pytest.mark.parametrize("name", ["trial.mat", "hdf.mat", "trial.parquet", "log.json"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_truncated_files_are_one_sentence(tmp_path: Path, name: str, share: float) -> None:
    path = tmp_path / name
    if name == "trial.mat":
        saved(tmp_path, t=TIME, qm=POSITION)
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
    (tmp_path / "trial.ods").write_bytes(b"PK")
    with pytest.raises(WorkbenchError, match=r"'.ods', which is no known format"):
        read_recording(tmp_path / "trial.ods")
    (tmp_path / "trial.csv").write_text("")
    with pytest.raises(WorkbenchError, match=r"did you mean 'trial.csv'"):
        read_recording(tmp_path / "trail.csv")
    with pytest.raises(WorkbenchError, match="is a folder; give one of its"):
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


def test_numpy_arrays_by_name(tmp_path: Path) -> None:
    path = tmp_path / "trial.npz"
    np.savez(path, t=TIME, qm=POSITION, vir=VOLTAGE, kp=160.18)
    assert_same(read_recording(path))
    stamps = np.datetime64("2024-03-01T12:00") + (1e3 * TIME).astype("timedelta64[ms]")
    np.savez(path, timestamp=stamps, qm=POSITION)
    assert read_recording(path).time == pytest.approx(TIME)


def test_a_table_of_numpy_takes_its_names_from_its_fields_or_a_mapping(tmp_path: Path) -> None:
    path = tmp_path / "trial.npy"
    np.save(path, np.column_stack([TIME, POSITION, VOLTAGE]))
    with pytest.raises(WorkbenchError, match="name its 3 columns"):
        read_recording(path)
    named = read_recording(path, mapping={"columns": ["t", "qm", "vir"]})
    assert np.array_equal(named["vir"], VOLTAGE)
    np.save(path, np.rec.fromarrays([TIME, POSITION], names="t,qm"))
    assert np.array_equal(read_recording(path)["qm"], POSITION)


def test_numpy_objects_are_never_unpickled(tmp_path: Path) -> None:
    path = tmp_path / "trial.npz"
    np.savez(path, t=np.array([{}], dtype=object))
    with pytest.raises(WorkbenchError, match="holds more than arrays of numbers"):
        read_recording(path)


def test_hdf5_of_other_programs_than_matlab(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "trial.h5"
    with h5py.File(path, "w") as file:
        run = file.create_group("run")
        run.attrs["kp"] = 160.18
        run["t"], run["qm"], run["vir"] = TIME, 1e3 * POSITION, VOLTAGE
        run["qm"].attrs["units"] = "mm"
    recording = read_recording(path)
    assert recording["qm"] == pytest.approx(POSITION)
    assert recording.signal("qm").unit == "m"
    assert recording.metadata["kp"] == 160.18
    with h5py.File(path, "w") as file:
        file["table"] = np.rec.fromarrays([TIME, VOLTAGE], names="t,vir")
    assert np.array_equal(read_recording(path)["vir"], VOLTAGE)


def test_groups_of_which_one_holds_the_time(tmp_path: Path) -> None:
    import h5py

    path = tmp_path / "trial.h5"
    with h5py.File(path, "w") as file:
        file["drive/t"], file["drive/vir"], file["table/qm"] = TIME, VOLTAGE, POSITION
    recording = read_recording(path)
    assert np.array_equal(recording.time, TIME)
    assert set(recording.names) == {"drive_vir", "table_qm"}
    asked = read_recording(path, signals=["vir", "qm"])
    assert np.array_equal(asked["qm"], POSITION)


def test_one_struct_around_everything_says_nothing(tmp_path: Path) -> None:
    path = saved(tmp_path, out={"tout": TIME, "qm": POSITION, "vir": VOLTAGE})
    recording = read_recording(path)
    assert np.array_equal(recording["qm"], POSITION)
    mapped = read_recording(path, mapping={"time": "out.tout", "signals": {"q": "out.qm"}})
    assert np.array_equal(mapped["q"], POSITION)


LVM = """LabVIEW Measurement\t
Separator\tTab
Multi_Headings\tYes
X_Columns\t{columns}
Time_Pref\tAbsolute
***End_of_Header***\t\t\t
\t\t\t
Channels\t2\t\t
Samples\t60\t60\t
Y_Unit_Label\tmm\tV\t
X0\t0.0\t0.0\t
Delta_X\t0.001\t0.001\t
***End_of_Header***\t\t\t
"""


@pytest.mark.parametrize(("sign", "title"), [("\t", "Tab"), (",", "Comma"), (";", "Semicolon")])
@pytest.mark.parametrize("end", ["", "\t"])
@pytest.mark.parametrize("with_time", [True, False])
def test_labview_measurements(read: Read, with_time: bool, end: str, sign: str, title: str) -> None:
    rows = np.column_stack([TIME, 1e3 * POSITION, VOLTAGE])[:, 0 if with_time else 1 :].tolist()
    titles = ["X_Value"] * with_time + ["qm", "vir", "Comment"]
    lines = ["\t".join(titles), *("\t".join(map(str, row)) + end for row in rows)]
    head = LVM.format(columns="One" if with_time else "No")
    # LabVIEW leaves the first column empty where no time is written.
    empty = ["X_Value\t" + lines[0], *("\t" + line for line in lines[1:])]
    for written in [lines] if with_time else [lines, empty]:
        text = (head + "\n".join(written)).replace("Tab", title).replace("\t", sign)
        recording = read(text, "trial.lvm")
        assert recording.time == pytest.approx(TIME)
        assert recording["qm"] == pytest.approx(POSITION)
        assert [recording.signal(name).unit for name in ("qm", "vir")] == ["m", "V"]


def test_tdms(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "trial.tdms"
    told = {"wf_increment": 0.001}
    qm = nptdms.ChannelObject("run", "qm", POSITION, told | {"unit_string": "m"})
    vir = nptdms.ChannelObject("run", "vir", VOLTAGE, told)
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.RootObject({"kp": 160.18}), qm, vir])
    recording = read_recording(path)
    assert recording.time == pytest.approx(TIME)
    assert np.array_equal(recording["qm"], POSITION)
    assert recording.metadata["kp"] == 160.18
    path.write_bytes(b"TDSm" + bytes(20))
    with pytest.raises(WorkbenchError, match="not a TDMS file|holds no channels"):
        read_recording(path)


def test_mdf(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "trial.mf4"
    file = asammdf.MDF()
    file.append([asammdf.Signal(POSITION, TIME, name="qm", unit="m")])
    slow = TIME[::2]
    file.append([asammdf.Signal(2.0 * slow, slow, name="vir", unit="V")])
    file.save(path)
    file.close()
    recording = read_recording(path)
    assert recording.time == pytest.approx(TIME)
    assert np.array_equal(recording["qm"], POSITION)
    # The last instant of the slower one holds.
    assert recording["vir"][:-1] == pytest.approx(2.0 * TIME[:-1])
    assert recording.signal("vir").unit == "V"
    path.write_bytes(b"no measurement at all")
    with pytest.raises(WorkbenchError, match="not an MDF file"):
        read_recording(path)


def test_the_longest_sheet_of_a_workbook(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    path = tmp_path / "trial.xlsx"
    book = openpyxl.Workbook()
    book.active.append(["notes"])
    sheet = book.create_sheet("run")
    for row in (
        ["t", "qm", "vir"],
        ["s", "mm", "V"],
        *np.c_[TIME, 1e3 * POSITION, VOLTAGE].tolist(),
    ):
        sheet.append(row)
    book.save(path)
    recording = read_recording(path)
    assert recording["qm"] == pytest.approx(POSITION)
    assert "sheet 'run', the longest of 2" in recording.notes[0]
    path.write_bytes(b"PK")
    with pytest.raises(WorkbenchError, match="not an Excel workbook"):
        read_recording(path)


@pytest.mark.parametrize(
    ("module", "name", "extra"),
    [
        ("nptdms", "a.tdms", "logs"),
        ("openpyxl", "a.xlsx", "logs"),
        ("pyarrow", "a.parquet", "parquet"),
        ("asammdf", "a.mf4", "mdf"),
    ],
)
def test_what_an_extra_reads_says_so(
    read: Read, monkeypatch: pytest.MonkeyPatch, module: str, name: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(WorkbenchError, match=rf"workbench\[{extra}\]"):
        read(b"PAR1", name)


@pytest.mark.parametrize("unit", [True, False])
def test_a_row_per_value_becomes_a_row_per_instant(read: Read, unit: bool) -> None:
    lines = ["Timestamp;Tag;Value" + ";Unit" * unit]
    for t, q, v in zip(TIME, POSITION, VOLTAGE, strict=True):
        stamp = f"2024-03-01 12:00:{t:06.3f}"
        lines += [f"{stamp};qm;{1e3 * q:.9f}" + ";mm" * unit, f"{stamp};vir;{v:.9f}" + ";V" * unit]
    recording = read(lines)
    assert recording.time == pytest.approx(TIME, abs=1e-6)
    assert recording["qm"] == pytest.approx(POSITION * (1 if unit else 1e3))
    assert recording["vir"] == pytest.approx(VOLTAGE)


@pytest.mark.parametrize(
    ("zero", "step", "decimals", "days"),
    [
        (45987.6, 1.0, 9, True),
        (45987.6, 0.01, 12, True),
        (739000.5, 0.1, 10, True),
        (739000.5, 60.0, 9, True),
        # Seconds of the day at 1 kHz, and hours of a slow machine, in s.
        (45987.6, 1e-3, 3, False),
        (45987.6, 10.0, 1, False),
    ],
)
def test_days_of_a_calendar_are_told_from_seconds(
    read: Read, zero: float, step: float, decimals: int, days: bool
) -> None:
    unit = 86400.0 if days else 1.0
    rows = [f"{zero + k * step / unit:.{decimals}f},{k % 5},{k}" for k in range(200)]
    recording = read(["time,u,y", *rows])
    assert np.ptp(recording.time) == pytest.approx(199 * step, rel=1e-3)


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_instants_since_1970_tell_their_unit(read: Read, unit: str, factor: float) -> None:
    rows = (f"{round(factor * (1.7e9 + k))},{k}" for k in range(60))
    recording = read(["timestamp,qm", *rows])
    assert np.diff(recording.time) == pytest.approx(1.0)
    assert unit == "s" or recording.mapping.rows[0].unit == unit


def test_a_blank_within_a_cell_separates_no_columns(read: Read) -> None:
    rows = (f"2024-03-01 12:00:{t:06.3f}\t{q}" for t, q in zip(TIME, POSITION, strict=True))
    recording = read(["Timestamp\tqm", *rows], "trial.tsv")
    assert recording.time == pytest.approx(TIME, abs=1e-6)
    assert np.array_equal(recording["qm"], POSITION)


@pytest.mark.parametrize(
    "line", ["# sample rate = 1 kHz", "# Fs [Hz]: 1000", "# dt = 1 ms", "# sample_time_s = 0.001"]
)
def test_a_sampling_rate_above_the_table_gives_its_instants(read: Read, line: str) -> None:
    assert read([line, "qm,vir", *(f"{q},0" for q in POSITION)]).time == pytest.approx(TIME)


def test_a_stamp_of_seconds_and_nanoseconds_is_one_time(read: Read) -> None:
    rows = (f"{1_700_000_000 + k // 4},{k % 4 * 250_000_000},{k}" for k in range(60))
    recording = read(["header.stamp.sec,header.stamp.nanosec,qm", *rows])
    assert recording.names == ("qm",)
    assert np.diff(recording.time) == pytest.approx(0.25)


@pytest.mark.parametrize("first", ["2024-03-01 12:00:{:06.3f}", "{:.3f}"])
def test_an_index_without_a_name_is_the_time(read: Read, first: str) -> None:
    recording = read([",qm", *(f"{first.format(t)},{t}" for t in TIME)])
    assert recording.time - recording.time[0] == pytest.approx(TIME, abs=1e-6)
    assert recording.names == ("qm",)


def test_numbers_of_rows_are_no_signal_and_no_time(read: Read) -> None:
    recording = read([",t,qm", *(f"{k},{t},{t}" for k, t in enumerate(TIME))])
    assert np.array_equal(recording.time, TIME) and recording.names == ("qm",)
    with pytest.raises(WorkbenchError, match="no time column"):
        read([",qm", *(f"{k},{t}" for k, t in enumerate(TIME))])


def test_settings_of_an_oscilloscope_are_no_rows(read: Read) -> None:
    settings = ["Model,MSO", "Sample Interval,0.001,", "Record Length,60,", "Zero Index,0,"]
    rows = (f"{t:.6e},{q:.9e},{v:.4e}" for t, q, v in zip(TIME, POSITION, VOLTAGE, strict=True))
    recording = read([*settings, "TIME,CH1,CH2", *rows])
    assert recording.names == ("CH1", "CH2") and recording["CH1"] == pytest.approx(POSITION)


@pytest.mark.parametrize("around", ["", "# name: run\n# type: scalar struct\n# ndims: 2\n 1 1\n"])
def test_octave_saves_a_text(read: Read, around: str) -> None:
    column = "# type: matrix\n# rows: 60\n# columns: 1\n"
    text = (
        f"# Created by Octave 8.4.0, Mon Mar 04 10:00:00 2024 UTC <me@lab>\n{around}"
        "# name: t\n# type: double_range\n# base, limit, increment\n0 0.059 0.001\n\n\n"
        f"# name: qm\n{column}" + "".join(f" {q!r}\n" for q in POSITION.tolist()) + "\n\n"
        "# name: kp\n# type: scalar\n160.18\n\n\n"
        f"# name: vir\n{column}" + "".join(f" {v!r}\n" for v in VOLTAGE.tolist())
    )
    assert_same(read(text, "trial.mat"))
    with pytest.raises(WorkbenchError, match="not a text of Octave"):
        read(text[:-200], "trial.mat")
