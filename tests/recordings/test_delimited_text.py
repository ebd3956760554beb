import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.recordings import read_recording
from workbench.recordings.formats.delimited_text import read_text
from workbench.recordings.formats.format import ReadOptions

TIME = np.arange(50) * 0.002
VALVE = 5.0 + 0.5 * np.sin(40 * TIME)
ANGLE = 30.0 + 10 * np.sin(9 * TIME)


def table(
    separator: str = ",", decimal: str = ".", header: str = "time_s,valve_V,angle_deg"
) -> str:
    lines = [header.replace(",", separator)] if header else []
    lines += [
        separator.join(f"{v:.6f}" for v in row).replace(".", decimal)
        for row in zip(TIME, VALVE, ANGLE, strict=True)
    ]
    return "\n".join(lines) + "\n"


def saved(folder: Path, text: str | bytes, name: str = "trial.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", "  "])
@pytest.mark.parametrize("decimal", [".", ","])
def test_separators_and_decimal_signs(tmp_path: Path, separator: str, decimal: str) -> None:
    if separator == decimal:
        pytest.skip("a comma cannot be both")
    recording = read_recording(saved(tmp_path, table(separator, decimal)))
    # The file holds six decimals.
    assert np.allclose(recording.time, TIME, atol=1e-6)
    assert np.allclose(recording["valve"], VALVE, atol=1e-6)
    assert np.allclose(np.rad2deg(recording["angle"]), ANGLE, atol=1e-6)
    assert recording.notes == ()


@pytest.mark.parametrize(
    "header",
    [
        "time [s],valve [V],angle [deg]",
        "time (s),valve (V),angle (deg)",
        "time / s,valve / V,angle / deg",
        '"time_s","valve_V","angle_deg"',
        "time_sec,valve_volt,angle_degrees",
    ],
)
def test_headers(tmp_path: Path, header: str) -> None:
    recording = read_recording(saved(tmp_path, table(header=header)))
    assert recording.names == ("valve", "angle")
    assert np.allclose(np.rad2deg(recording["angle"]), ANGLE, atol=1e-6)


def test_row_of_units_and_comments(tmp_path: Path) -> None:
    text = "# rig: 2\n# load_kg = 3\n\n" + table(header="time,valve,angle\nms,V,deg")
    recording = read_recording(saved(tmp_path, text))
    assert np.allclose(recording.time, TIME / 1000)
    assert recording.metadata == {"rig": 2.0, "load_kg": 3.0}
    assert recording.signal("angle").kind == "angle"


def test_an_oscilloscope_writes_its_step_among_the_units(tmp_path: Path) -> None:
    head = "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-3.0e+00,1.0e-02\n"
    rows = "".join(f"{k},{k / 9:.4e},{1 / (k + 1):.4e},,\n" for k in range(50))
    recording = read_recording(saved(tmp_path, head + rows))
    assert np.allclose(recording.time, 0.01 * np.arange(50))
    assert recording.signal("CH1").unit == "V" and recording["CH2"][1] == 0.5


def test_a_row_of_units_stands_above_what_a_title_ends_in(tmp_path: Path) -> None:
    head = "Time,Channel A,Channel B\n(ms),(V),(mm)\n\n"
    rows = "".join(f"{k},{k},{k}\n" for k in range(9))
    recording = read_recording(saved(tmp_path, head + rows))
    assert [s.unit for s in recording.signals] == ["V", "m"]
    assert recording.names == ("Channel_A", "Channel_B") and recording.time[1] == 0.001


def test_a_night_in_which_clocks_change_has_no_gap(tmp_path: Path) -> None:
    rows = [f"2024-03-31T01:59:{k:02d}+01:00,{k}" for k in range(50, 60)]
    rows += [f"2024-03-31T03:00:{k:02d}+02:00,{k}" for k in range(10)]
    recording = read_recording(saved(tmp_path, "\n".join(["time,x_mm", *rows])))
    assert np.array_equal(recording.time, np.arange(20.0))


def test_header_in_the_last_comment(tmp_path: Path) -> None:
    text = "% recorded on the bench\n% time_s,valve_V,angle_deg\n" + table(header="")
    assert read_recording(saved(tmp_path, text)).names == ("valve", "angle")


def test_preamble_of_a_logger_is_skipped(tmp_path: Path) -> None:
    text = "Logger 3000\nSerial: 17\nfree text; here\n" + table()
    assert len(read_recording(saved(tmp_path, text))) == 50


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    text = table(header="time [s],valve [V],angle [°]")
    recording = read_recording(saved(tmp_path, text.encode(encoding)))
    assert np.allclose(np.rad2deg(recording["angle"]), ANGLE, atol=1e-6)


@pytest.mark.parametrize("end", ["\r\n", "\r"])
def test_line_ends(tmp_path: Path, end: str) -> None:
    assert len(read_recording(saved(tmp_path, table().replace("\n", end)))) == 50


def test_no_header_needs_names(tmp_path: Path) -> None:
    path = saved(tmp_path, table(header=""))
    with pytest.raises(WorkbenchError, match=r"has no header; name its 3 columns"):
        read_recording(path)
    recording = read_recording(path, mapping={"columns": ["time_s", "valve_V", "angle_deg"]})
    assert recording.names == ("valve", "angle")
    with pytest.raises(WorkbenchError, match=r"names 2 columns but trial.csv has 3"):
        read_recording(path, mapping={"columns": ["time_s", "valve_V"]})


def test_text_in_numbers_becomes_missing_and_is_told(tmp_path: Path) -> None:
    lines = table().splitlines()
    lines[7] = lines[7].rsplit(",", 1)[0] + ",error"
    recording = read_recording(saved(tmp_path, "\n".join(lines)))
    assert np.flatnonzero(np.isnan(recording["angle"])).tolist() == [6]
    assert "'error' in line 8" in recording.notes[0]


@pytest.mark.parametrize("giant", ["1e305", "-1e160", "1e999", "inf"])
def test_numbers_no_sensor_gives_are_missing(tmp_path: Path, giant: str) -> None:
    lines = table().splitlines()
    lines[7] = lines[7].rsplit(",", 1)[0] + f",{giant}"
    recording = read_recording(saved(tmp_path, "\n".join(lines)))
    assert np.flatnonzero(np.isnan(recording["angle"])).tolist() == [6]


def test_incomplete_last_row_is_left_out(tmp_path: Path) -> None:
    recording = read_recording(saved(tmp_path, table()[:-14]))
    assert len(recording) == 49
    assert "incomplete row(s) left out (line 51" in recording.notes[0]


def test_too_many_broken_rows_are_an_error(tmp_path: Path) -> None:
    lines = table().splitlines()
    for k in range(10, 30):
        lines[k] += ",1"
    with pytest.raises(WorkbenchError, match="another number of columns"):
        read_recording(saved(tmp_path, "\n".join(lines)))


def test_text_column(tmp_path: Path) -> None:
    lines = table().splitlines()
    lines = [lines[0] + ",remark"] + [line + ",ok" for line in lines[1:]]
    path = saved(tmp_path, "\n".join(lines))
    recording = read_recording(path)
    assert recording.names == ("valve", "angle")
    assert recording.mapping.unused == (
        ("remark", "holds text in 100 % of its rows (first: 'ok' in line 2)"),
    )
    with pytest.raises(WorkbenchError, match="needed for 'remark', holds text"):
        read_recording(path, signals=["remark"])


def test_a_table_of_words_with_few_numbers_says_what_its_words_are(tmp_path: Path) -> None:
    rows = [f"{k};{'EIN' if k % 3 else 'AUS'};Tag;TRUE;{k},5" for k in range(20)]
    path = saved(tmp_path, "\n".join(["Zeit [s];Brenner;Betriebsart;bereit;T [°C]", *rows]))
    found = read_recording(path)
    assert (found.names, found["bereit"][0], found["T"][1]) == (("bereit", "T"), 1.0, 274.65)
    rules = {"words": {"EIN": 1, "AUS": 0}, "signals": {"burner": {"column": "Brenner"}}}
    assert list(read_recording(path, mapping=rules)["burner"][:4]) == [0.0, 1.0, 1.0, 0.0]
    with pytest.raises(WorkbenchError, match=r"100 % of its rows \(first: 'AUS' in line 2\)"):
        read_recording(path, mapping={"burner": "Brenner"})


@pytest.mark.parametrize("decimal", [",", "."])
def test_thousands_may_be_set_apart(decimal: str, tmp_path: Path) -> None:
    rows = [(k, 1013.5 + k, 950.0 + k) for k in range(0, 200, 10)]
    texts = [f'{t};"{p:,.1f}";"{n:,.0f}"' for t, p, n in rows]
    if decimal == ",":
        texts = [text.translate(str.maketrans(".,", ",.")) for text in texts]
    found = read_recording(saved(tmp_path, "\n".join(["t [s];p [Pa];n", *texts])))
    assert np.array_equal(np.c_[found.time, found["p"], found["n"]], rows)


def test_number_in_the_first_row_only_is_a_setting(tmp_path: Path) -> None:
    lines = table(header="u,y,z").splitlines()
    lines = [lines[0] + ",Ts,"] + [
        line + (",4," if k == 0 else ",,") for k, line in enumerate(lines[1:])
    ]
    recording = read_recording(saved(tmp_path, "\n".join(lines)))
    assert recording.metadata == {"Ts": 4.0}
    assert recording.time[-1] == 4.0 * 49


def test_missing_time_column(tmp_path: Path) -> None:
    path = saved(tmp_path, table(header="valve_V,angle_deg,pressure_1_bar"))
    with pytest.raises(WorkbenchError, match="has no time column"):
        read_recording(path)
    assert read_recording(path, mapping={"sample_time_s": 0.1}).time[2] == pytest.approx(0.2)


def test_truncated_gzip_keeps_what_came_before(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = "".join(f"{0.002 * k:.3f},{v:.6f}\n" for k, v in enumerate(rng.normal(size=20000)))
    packed = gzip.compress(("time_s,valve_V\n" + rows).encode())
    recording = read_recording(saved(tmp_path, packed[: len(packed) // 2], "trial.csv.gz"))
    assert 5000 < len(recording) < 15000
    assert "damaged" in recording.notes[-1]


def test_long_file_is_thinned_within_bounded_memory(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    n = 200_000
    time = 0.002 * np.arange(n)
    wave = np.sin(0.5 * time)
    with path.open("w") as stream:
        stream.write("time_s,valve_V,angle_deg\n")
        stream.writelines(f"{t:.3f},5.0,{w:.6f}\n" for t, w in zip(time, wave, strict=True))
    tracemalloc.start()
    recording = read_recording(path, max_rows=5000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # The whole table as numbers and text would take more than 40 MB at once.
    assert peak < 35e6
    assert 2500 <= len(recording) <= 5000
    assert "200000 rows were averaged in groups of 64" in recording.notes[0]
    # Averaging 64 samples of this wave is an error of (w dt)^2 / 24, here 2e-4.
    assert np.allclose(np.rad2deg(recording["angle"]), np.sin(0.5 * recording.time), atol=3e-4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "no rows of numbers"),
        (b"# only a comment\n", "no rows of numbers"),
        (b"hello\nworld\n", "no rows of numbers"),
        (b"\x00\x01\x02" * 100, "not a text file"),
        (b"1" * 3_000_000, "line"),
    ],
)
def test_no_table_at_all(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(WorkbenchError, match=message):
        read_text(saved(tmp_path, content), ReadOptions())


def test_digits_are_kept(tmp_path: Path) -> None:
    values = [0.1, 1 / 3, 1e-300, 123456789.123456789]
    text = "time_s,valve_V\n" + "".join(f"{k},{v!r}\n" for k, v in enumerate(values))
    assert read_text(saved(tmp_path, text), ReadOptions()).values[:, 1].tolist() == values


DATED = {
    "Timestamp": "2024-03-04 23:59:{0:04.1f}|2024-03-05 00:00:{1:04.1f}",
    "Date": "04.03.2024 23:59:{0:04.1f}|05.03.2024 00:00:{1:04.1f}",
    "Time": "2024-03-04T23:59:{0:04.1f}Z|2024-03-05T00:00:{1:04.1f}Z",
    "time": "3/4/2024 11:59:{0:04.1f} PM|3/5/2024 12:00:{1:04.1f} AM",
    "Uhrzeit": "23:59:{0:04.1f}|0:00:{1:04.1f}",
    "Datum;Uhrzeit": "4.3.2024;23:59:{0:04.1f}|5.3.2024;00:00:{1:04.1f}",
}


@pytest.mark.parametrize("header", DATED)
@pytest.mark.parametrize("decimal", [".", ","])
def test_dates_and_times_of_day_over_midnight(tmp_path: Path, header: str, decimal: str) -> None:
    before, after = DATED[header].split("|")
    seconds = 50.5 + np.arange(40) * 0.5
    rows = [
        (before if s < 60 else after).format(s, s - 60)
        + f";{5 + 0.1 * k:.1f};{k}".replace(".", decimal)
        for k, s in enumerate(seconds)
    ]
    text = "\n".join([f"{header};valve [V];angle [deg]", *rows])
    recording = read_recording(saved(tmp_path, text), signals=("valve", "angle"))
    assert np.allclose(recording.time, seconds - seconds[0], atol=1e-6)
    assert recording["valve"][1] == pytest.approx(5.1)
    assert recording.signal("valve").unit == "V"


def test_dates_in_words_are_refused_in_one_sentence(tmp_path: Path) -> None:
    rows = [f"March {k + 1};{k};{k}" for k in range(20)]
    text = "\n".join(["time;valve [V];angle [deg]", *rows])
    with pytest.raises(WorkbenchError, match="'time'.*'March 1' in line 2.*in seconds"):
        read_recording(saved(tmp_path, text))


@pytest.mark.parametrize(
    ("header", "column"),
    [("t,u_V,temp_C", "temp_C"), ("t,u_V,T_C", "T_C"), ("t,u_V,Temp_c,x_C", "Temp_c")],
)
def test_degrees_behind_an_underscore_where_a_temperature_is_asked_for(
    tmp_path: Path, header: str, column: str
) -> None:
    rows = [",".join(f"{20 + k}" for _ in header.split(",")) for k in range(20)]
    path = saved(tmp_path, "\n".join([header, *rows]))
    recording = read_recording(path, signals={"u": "V", "temp": "K"})
    assert recording["temp"][0] == pytest.approx(293.15)
    # What is called so in the model, or beside its like, is a name.
    assert read_recording(path, signals={"u": "V", column: "K"})[column][0] == 20.0


@pytest.mark.parametrize(
    ("header", "second", "zero"),
    [("minutes,u_V,temp (F)", 60.0, 459.67 / 1.8), ("Msec,u_V,temp (C)", 1e-3, 273.15)],
)
def test_a_heading_that_is_a_unit_counts_the_time_and_no_temperature_is_in_farads(
    tmp_path: Path, header: str, second: float, zero: float
) -> None:
    rows = [f"{k},{k},0" for k in range(20)]
    recording = read_recording(
        saved(tmp_path, "\n".join([header, *rows])), signals={"u": "V", "temp": "K"}
    )
    assert recording.time[1] == pytest.approx(second)
    assert recording["temp"][0] == pytest.approx(zero)


def test_a_name_beside_its_like_is_no_unit(tmp_path: Path) -> None:
    rows = [",".join(f"{20 + k}" for _ in range(4)) for k in range(20)]
    path = saved(tmp_path, "\n".join(["t,u_V,T_B,T_C", *rows]))
    with pytest.raises(WorkbenchError, match="temp"):
        read_recording(path, signals={"u": "V", "temp": "K"})


def test_levels_beside_whole_numbers_are_no_names_of_signals(tmp_path: Path) -> None:
    rows = "".join(f"{k / 200}\t{(0.19, -2.5)[k // 9 % 2]}\t{7 * k}\n" for k in range(60))
    table = read_text(saved(tmp_path, f"Time (s)\tForce (N)\tPath (um)\n{rows}"), ReadOptions())
    assert table.headers == ("Time (s)", "Force (N)", "Path (um)")
    assert table.values.shape == (60, 3)
