import gzip
import tracemalloc
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from tests.recordings.example import Read
from workbench.errors import WorkbenchError
from workbench.recordings import read_recording

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


SAME = [
    *(table(separator, ".") for separator in (",", ";", "\t", "|", "  ")),
    *(table(separator, ",") for separator in (";", "\t", "|", "  ")),
    table(header="time [s],valve [V],angle [deg]"),
    table(header="time (s),valve (V),angle (deg)"),
    table(header="time / s,valve / V,angle / deg"),
    table(header='"time_s","valve_V","angle_deg"'),
    table(header="time_sec,valve_volt,angle_degrees"),
    "% recorded on the bench\n% time_s,valve_V,angle_deg\n" + table(header=""),
    "Logger 3000\nSerial: 17\nfree text; here\n" + table(),
    *(table().replace("\n", end) for end in ("\r\n", "\r")),
    *(table(header="time [s],valve [V],angle [°]").encode(e)
      for e in ("utf-8", "utf-8-sig", "utf-16", "latin-1")),
]  # fmt: skip


@pytest.mark.parametrize("content", SAME)
def test_files_that_hold_the_same(read: Read, content: str | bytes) -> None:
    recording = read(content)
    assert (recording.names, recording.notes) == (("valve", "angle"), ())
    # The file holds six decimals.
    assert np.allclose(recording.time, TIME, atol=1e-6)
    assert np.allclose(recording["valve"], VALVE, atol=1e-6)
    assert np.allclose(np.rad2deg(recording["angle"]), ANGLE, atol=1e-6)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("2024-01-31 ", "2024-02-01 "),
        ("31.01.2024 ", "01.02.2024 "),
        ("31.1.24 ", "1.2.24 "),
        ("31-Jan-2024 ", "01-Feb-2024 "),
        ("1/31/2024 ", "2/1/2024 "),
        ("31/01/2024 ", "01/02/2024 "),
        # Neither says by itself which number is the day.
        ("5/6/2024 ", "6/6/2024 "),
        ("6/5/24 ", "6/6/24 "),
    ],
)
def test_a_date_may_be_written_in_any_order(read: Read, before: str, after: str) -> None:
    rows = [f"{before}23:59:{s:02d},{s}" for s in range(50, 60)]
    rows += [f"{after}00:00:{s:02d},{10 + s}" for s in range(10)]
    recording = read("stamp,angle_deg\n" + "\n".join(rows))
    assert np.array_equal(recording.time, np.arange(20.0))


def test_row_of_units_and_comments(read: Read) -> None:
    recording = read("# rig: 2\n# load_kg = 3\n\n" + table(header="time,valve,angle\nms,V,deg"))
    assert np.allclose(recording.time, TIME / 1000)
    assert recording.metadata == {"rig": 2.0, "load_kg": 3.0}
    assert recording.signal("angle").kind == "angle"


@pytest.mark.parametrize("volt", ["Volt", "VOLT"])
def test_an_oscilloscope_writes_its_step_among_the_units(read: Read, volt: str) -> None:
    head = f"X,CH1,CH2,Start,Increment,\nSequence,{volt},{volt},-3.0e+00,1.0e-02\n"
    rows = "".join(f"{k},{k / 9:.4e},{1 / (k + 1):.4e},,\n" for k in range(50))
    recording = read(head + rows)
    assert np.allclose(recording.time, 0.01 * np.arange(50))
    assert recording.signal("CH1").unit == "V" and recording["CH2"][1] == 0.5


def test_channels_that_have_numbers_for_names(read: Read) -> None:
    rows = "".join(f"{0.01 * k - 5:.8E},{k:+.6E},{k * k:+.6E}\n" for k in range(9))
    text = "x-axis,1,2\nsecond,Volt,Ampere\n" + rows
    found = read(text, mapping={"time": {"column": "x-axis"}, "signals": {"current": "2"}})
    assert found["current"][3] == 9.0 and found.signal("current").unit == "A"


def test_a_row_of_units_stands_above_what_a_title_ends_in(read: Read) -> None:
    head = "Time,Channel A,Channel B\n(ms),(V),(mm)\n\n"
    rows = "".join(f"{k},{k},{k}\n" for k in range(9))
    recording = read(head + rows)
    assert [s.unit for s in recording.signals] == ["V", "m"]
    assert recording.names == ("Channel_A", "Channel_B") and recording.time[1] == 0.001


@pytest.mark.parametrize(("winter", "summer"), [("+01:00", "+02:00"), (" CET", " CEST")])
def test_a_night_in_which_clocks_change_has_no_gap(read: Read, winter: str, summer: str) -> None:
    rows = [f"2024-03-31T01:59:{k:02d}{winter},{k}" for k in range(50, 60)]
    rows += [f"2024-03-31T03:00:{k:02d}{summer},{k}" for k in range(10)]
    assert np.array_equal(read(["time,x_mm", *rows]).time, np.arange(20.0))


def test_no_header_needs_names(read: Read) -> None:
    text = table(header="")
    with pytest.raises(WorkbenchError, match=r"has no header; name its 3 columns"):
        read(text)
    names = ["time_s", "valve_V", "angle_deg"]
    assert read(text, mapping={"columns": names}).names == ("valve", "angle")
    with pytest.raises(WorkbenchError, match=r"names 2 columns but trial.csv has 3"):
        read(text, mapping={"columns": names[:2]})


@pytest.mark.parametrize("cell", ["error", "1e305", "-1e160", "1e999", "inf"])
def test_text_and_numbers_no_sensor_gives_are_missing(read: Read, cell: str) -> None:
    lines = table().splitlines()
    lines[7] = lines[7].rsplit(",", 1)[0] + f",{cell}"
    recording = read(lines)
    assert np.flatnonzero(np.isnan(recording["angle"])).tolist() == [6]
    assert cell != "error" or "'error' in line 8" in recording.notes[0]


def test_incomplete_last_row_is_left_out(read: Read) -> None:
    recording = read(table()[:-14])
    assert len(recording) == 49
    assert "incomplete row(s) left out (line 51" in recording.notes[0]


def test_too_many_broken_rows_are_an_error(read: Read) -> None:
    lines = table().splitlines()
    for k in range(10, 30):
        lines[k] += ",1"
    with pytest.raises(WorkbenchError, match="another number of columns"):
        read(lines)


def test_text_column(read: Read) -> None:
    head, *rows = table().splitlines()
    lines = [head + ",remark", *(row + ",ok" for row in rows)]
    recording = read(lines)
    assert recording.names == ("valve", "angle")
    why = "holds text in 100 % of its rows (first: 'ok' in line 2)"
    assert recording.mapping.unused == (("remark", why),)
    with pytest.raises(WorkbenchError, match="needed for 'remark', holds text"):
        read(lines, signals=["remark"])


def test_a_table_of_words_with_few_numbers_says_what_its_words_are(read: Read) -> None:
    rows = [f"{k};{'EIN' if k % 3 else 'AUS'};Tag;TRUE;{k},5" for k in range(20)]
    lines = ["Zeit [s];Brenner;Betriebsart;bereit;T [°C]", *rows]
    found = read(lines)
    assert (found.names, found["bereit"][0], found["T"][1]) == (("bereit", "T"), 1.0, 274.65)
    rules = {"words": {"EIN": 1, "AUS": 0}, "signals": {"burner": {"column": "Brenner"}}}
    assert list(read(lines, mapping=rules)["burner"][:4]) == [0.0, 1.0, 1.0, 0.0]
    with pytest.raises(WorkbenchError, match=r"100 % of its rows \(first: 'AUS' in line 2\)"):
        read(lines, mapping={"burner": "Brenner"})


@pytest.mark.parametrize("decimal", [",", ".", "'"])
def test_thousands_may_be_set_apart(decimal: str, read: Read) -> None:
    rows = [(k, 1013.5 + k, 950.0 + k) for k in range(0, 200, 10)]
    texts = [f'{t};"{p:,.1f}";"{n:,.0f}"' for t, p, n in rows]
    if decimal == ",":
        texts = [text.translate(str.maketrans(".,", ",.")) for text in texts]
    elif decimal == "'":
        texts = [text.replace(",", "'") for text in texts]
    found = read(["t [s];p [Pa];n", *texts])
    assert np.array_equal(np.c_[found.time, found["p"], found["n"]], rows)


def test_number_in_the_first_row_only_is_a_setting(read: Read) -> None:
    head, first, *rows = table(header="u,y,z").splitlines()
    recording = read([head + ",Ts,", first + ",4,", *(row + ",," for row in rows)])
    assert recording.metadata == {"Ts": 4.0}
    assert recording.time[-1] == 4.0 * 49


def test_missing_time_column(read: Read) -> None:
    text = table(header="valve_V,angle_deg,pressure_1_bar")
    with pytest.raises(WorkbenchError, match="has no time column"):
        read(text)
    assert read(text, mapping={"sample_time_s": 0.1}).time[2] == pytest.approx(0.2)


def test_truncated_gzip_keeps_what_came_before(read: Read) -> None:
    rng = np.random.default_rng(0)
    rows = "".join(f"{0.002 * k:.3f},{v:.6f}\n" for k, v in enumerate(rng.normal(size=20000)))
    packed = gzip.compress(("time_s,valve_V\n" + rows).encode())
    recording = read(packed[: len(packed) // 2], "trial.csv.gz")
    assert 5000 < len(recording) < 15000
    assert "damaged" in recording.notes[-1]


def test_long_file_is_thinned_within_bounded_memory(tmp_path: Path) -> None:
    time = 0.002 * np.arange(200_000)
    rows = np.c_[time, 0 * time + 5, np.sin(0.5 * time)]
    path = tmp_path / "long.csv"
    np.savetxt(path, rows, "%.6f", ",", header="time_s,valve_V,angle_deg", comments="")
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
def test_no_table_at_all(read: Read, content: bytes, message: str) -> None:
    with pytest.raises(WorkbenchError, match=message):
        read(content)


def test_digits_are_kept(read: Read) -> None:
    values = [0.1, 1 / 3, 1e-300, 123456789.123456789]
    rows = [f"{k},{v!r}" for k, v in enumerate(values)]
    assert read(["time_s,valve_V", *rows])["valve"].tolist() == values


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
def test_dates_and_times_of_day_over_midnight(read: Read, header: str, decimal: str) -> None:
    before, after = DATED[header].split("|")
    seconds = 50.5 + np.arange(40) * 0.5
    rows = [
        (before if s < 60 else after).format(s, s - 60)
        + f";{5 + 0.1 * k:.1f};{k}".replace(".", decimal)
        for k, s in enumerate(seconds)
    ]
    recording = read([f"{header};valve [V];angle [deg]", *rows], signals=("valve", "angle"))
    assert np.allclose(recording.time, seconds - seconds[0], atol=1e-6)
    assert recording["valve"][1] == pytest.approx(5.1)
    assert recording.signal("valve").unit == "V"


@pytest.mark.parametrize(("hour", "word"), [(3600.0, "forward"), (-3600.0, "back")])
def test_an_hour_by_which_a_clock_is_put_is_undone(read: Read, hour: float, word: str) -> None:
    begun = datetime.fromisoformat("2026-03-29 01:59:50")
    ahead = [0.5 * k + (hour if k >= 20 else 0.0) for k in range(40)]
    rows = [f"{begun + timedelta(seconds=t)};{k % 3};{k}" for k, t in enumerate(ahead)]
    recording = read(["time;u [V];y [V]", *rows])
    assert recording.time == pytest.approx(0.5 * np.arange(40), abs=1e-3)
    assert [n for n in recording.notes if f"put {word} by an hour after 9.5 s" in n]
    # An hour without rows is a gap.
    rows = [f"{begun + timedelta(seconds=t + 2.0 * (t > 100.0))};1;2" for t in ahead]
    if hour > 0.0:
        assert read(["time;u [V];y [V]", *rows]).time[-1] > 3600.0


def test_dates_in_words_are_refused_in_one_sentence(read: Read) -> None:
    rows = [f"March {k + 1};{k};{k}" for k in range(20)]
    with pytest.raises(WorkbenchError, match="'time'.*'March 1' in line 2.*in seconds"):
        read(["time;valve [V];angle [deg]", *rows])


@pytest.mark.parametrize(
    ("header", "column"),
    [("t,u_V,temp_C", "temp_C"), ("t,u_V,T_C", "T_C"), ("t,u_V,Temp_c,x_C", "Temp_c")],
)
def test_degrees_behind_an_underscore_where_a_temperature_is_asked_for(
    read: Read, header: str, column: str
) -> None:
    rows = [",".join(f"{20 + k}" for _ in header.split(",")) for k in range(20)]
    recording = read([header, *rows], signals={"u": "V", "temp": "K"})
    assert recording["temp"][0] == pytest.approx(293.15)
    # What is called so in the model, or beside its like, is a name.
    assert read([header, *rows], signals={"u": "V", column: "K"})[column][0] == 20.0


@pytest.mark.parametrize(
    ("header", "second", "zero"),
    [("minutes,u_V,temp (F)", 60.0, 459.67 / 1.8), ("Msec,u_V,temp (C)", 1e-3, 273.15)],
)
def test_a_heading_that_is_a_unit_counts_the_time_and_no_temperature_is_in_farads(
    read: Read, header: str, second: float, zero: float
) -> None:
    rows = [f"{k},{k},0" for k in range(20)]
    recording = read([header, *rows], signals={"u": "V", "temp": "K"})
    assert recording.time[1] == pytest.approx(second)
    assert recording["temp"][0] == pytest.approx(zero)


@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", ","), ("\t", ".")])
def test_cells_may_hold_their_unit(read: Read, separator: str, point: str) -> None:
    def row(k: int) -> str:
        # A meter changes its range.
        y = f"{20 * k:.1f} mV" if k < 30 else f"{0.02 * k:.4f} V"
        cells = (f"{0.1 * k:.1f} s", f"{k % 7}.5 V", y, f"{2 + 0.01 * k:.2f} bar (g)")
        return separator.join(cells).replace(".", point)

    headers = separator.join(("time", "u", "y", "p [mbar]"))
    recording = read([headers, *map(row, range(40))])
    assert (recording.time[1], recording["u"][3]) == pytest.approx((0.1, 3.5))
    assert recording["y"] == pytest.approx(0.02 * np.arange(40))
    assert recording["p"][10] - recording["p"][0] == pytest.approx(1e4)
    assert [recording.signal(n).display_unit for n in ("u", "y", "p")] == ["V", "mV", "mbar"]


def test_a_cell_with_a_unit_of_another_kind_is_no_number(read: Read) -> None:
    rows = [f"{k},{k} V,{k} Pa" for k in range(500)]
    recording = read(["t,u,y", *rows, "500,500 V,3 V"])
    assert np.isnan(recording["y"][-1])
    assert (recording["u"][-1], recording["y"][-2]) == (500.0, 499.0)


def test_a_name_beside_its_like_is_no_unit(read: Read) -> None:
    rows = [",".join(f"{20 + k}" for _ in range(4)) for k in range(20)]
    with pytest.raises(WorkbenchError, match="temp"):
        read(["t,u_V,T_B,T_C", *rows], signals={"u": "V", "temp": "K"})


def test_levels_beside_whole_numbers_are_no_names_of_signals(read: Read) -> None:
    rows = [f"{k / 200}\t{(0.19, -2.5)[k // 9 % 2]}\t{7 * k}" for k in range(60)]
    recording = read(["Time (s)\tForce (N)\tPath (um)", *rows])
    assert (recording.names, len(recording)) == (("Force", "Path"), 60)


@pytest.mark.parametrize("mark", ["-9999", "999.9", "99999"])
def test_numbers_that_stand_for_none_are_missing(read: Read, mark: str) -> None:
    rows = [[str(k), str(900 + k), mark if k in (5, 6) else str(k % 7)] for k in range(40)]
    recording = read(["t_s,p_mbar,n_V", *map(",".join, rows)])
    assert np.flatnonzero(np.isnan(recording["n"])).tolist() == [5, 6]
    # What counts so far, or stands at two levels, is no mark.
    assert np.isfinite(recording["p"]).all()
    rows = [[str(k), mark if k % 9 == 5 else "0"] for k in range(40)]
    assert np.isfinite(read(["t_s,n_V", *map(",".join, rows)])["n"]).all()


@pytest.mark.parametrize(
    ("good", "bad"), [("Good", "Bad"), ("192", "24"), ("1", "0"), ("true", "false")]
)
def test_values_that_a_column_beside_them_calls_bad_are_missing(
    read: Read, good: str, bad: str
) -> None:
    rows = [f"{k},{k % 7},{bad if 9 < k < 13 else good},{k}" for k in range(40)]
    recording = read(["t_s,n_rpm,n_quality,air quality", *rows])
    assert np.flatnonzero(np.isnan(recording["n"])).tolist() == [10, 11, 12]
    assert recording.names == ("n", "air_quality")
    assert "3 value(s) of 'n_rpm' are bad by 'n_quality'" in recording.notes
