import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.machines import machine
from tests.recordings.example import Read
from workbench.errors import WorkbenchError
from workbench.model.quantities import Input, Output
from workbench.recordings import Recording, read_mapping, read_recording
from workbench.recordings.column_matching import driven_by
from workbench.recordings.mapping import rules_from


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    path = tmp_path / "trial.csv"
    rows = "".join(f"{2 * k},{k % 7},{10 + k},{1 + 0.01 * k},{2 - 0.01 * k}\n" for k in range(40))
    path.write_text("t_ms,u_V,q1_deg,pA_bar,pB_bar\n" + rows)
    return path


def mapping(folder: Path, text: str) -> Path:
    path = folder / "mapping.toml"
    path.write_text(text)
    return path


def test_rule_with_unit_sign_offset_and_factor(trial: Path, tmp_path: Path) -> None:
    rules = mapping(
        tmp_path,
        """
        [time]
        column = "t_ms"
        [signals.angle]
        column = "q1_deg"
        sign = -1
        offset = 60.0
        [signals.supply]
        column = "u_V"
        factor = 2.5
        unit = "bar"
        role = "measurement"
        reference = "absolute"
        [metadata]
        load_kg = 3
        """,
    )
    recording = read_recording(trial, mapping=rules)
    assert recording.names == ("angle", "supply")
    assert np.rad2deg(recording["angle"][:2]) == pytest.approx([50.0, 49.0])
    # Absolute becomes gauge: 2.5 bar/V, one standard atmosphere less.
    assert recording["supply"][2] == pytest.approx(5.0e5 - 101325.0)
    assert recording.signal("supply").kind == "gauge pressure"
    assert recording.metadata["load_kg"] == 3
    assert recording.time[1] == pytest.approx(0.002)
    printed = str(recording.mapping)
    assert "-column +60" in printed
    assert "not in the mapping" in printed


def test_automatic_mapping_to_a_model(trial: Path) -> None:
    arm = plant("valve V", "angle rad, pressure_1 Pa, pressure_2 Pa")
    recording = read_recording(trial, signals=arm, mapping={"time": {"column": "t_ms"}})
    # u is a synonym of valve; q1 is the only angle; pA and pB are synonyms of the pressures.
    assert recording.names == ("valve", "angle", "pressure_1", "pressure_2")
    assert recording.commands == ("valve",)
    assert recording["pressure_2"][0] == pytest.approx(2e5)
    assert ways(recording) == {
        "time": "mapping file", "valve": "synonym", "angle": "unit",
        "pressure_1": "synonym", "pressure_2": "synonym",
    }  # fmt: skip


@dataclass(frozen=True)
class Plant:
    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]


def plant(inputs: str, outputs: str) -> Plant:
    """A plant of names and units."""
    return Plant(
        tuple(Input(*q.split(" ", 1)) for q in inputs.split(", ")),
        tuple(Output(*q.split(" ", 1)) for q in outputs.split(", ")),
    )


HEATER = plant("power W", "oven K")
COOLER = plant("current A, room K", "cold K, hot K")


def table(*headers: str) -> list[str]:
    rows = (",".join(str(k + 5 * i) for i in range(len(headers))) for k in range(20))
    return [",".join(headers), *rows]


def ways(recording: Recording) -> dict[str, str]:
    return {row.signal: row.how for row in recording.mapping}


def test_the_only_command_and_the_only_output_may_be_called_u_and_y(read: Read) -> None:
    assert read(table("t", "u", "y"), signals=HEATER).names == ("power", "oven")
    # Of several nobody knows which, and volts are no watts.
    with pytest.raises(WorkbenchError, match="no column for signal 'current'"):
        read(table("t", "u", "y"), signals=COOLER)
    with pytest.raises(WorkbenchError, match="no column for signal 'power'"):
        read(table("t", "u [V]", "y"), signals=HEATER)


def test_one_column_is_not_taken_for_two_signals(read: Read) -> None:
    blade = {"read": lambda m: m.u.pitch, "own": lambda m: m.x.pitch}
    plants = {
        how: machine(
            lambda m, of=of: ({"pitch": m.u.pitch - m.x.pitch}, {"pitch": of(m)}),
            "pitch rad", "pitch rad", "pitch rad",
        )
        for how, of in blade.items()
    }  # fmt: skip
    assert read(table("t", "pitch"), signals=plants["read"])["pitch"][0] == 5.0
    with pytest.raises(WorkbenchError, match=r"'pitch' is an input .* as to pitch_command"):
        read(table("t", "pitch"), signals=plants["own"])


def test_a_word_of_the_header_names_the_signal(read: Read) -> None:
    headers = ("t [s]", "I [mA]", "ambient °C", "T_cold [°C]", "T_hot [°C]")
    recording = read(table(*headers), signals=driven_by(COOLER))
    part = "part of its name"
    assert ways(recording) == {
        "time": "name", "current": "unit", "room": "unit", "cold": part, "hot": part
    }  # fmt: skip
    assert recording["hot"][0] == pytest.approx(293.15)
    # What the plant only gives in SI is read as the file is headed.
    assert recording.signal("current").display_unit == "mA"
    assert not recording.notes


@pytest.mark.parametrize("unit", ["m3/s", "m", "g/l", "kV"])
def test_what_has_no_unit_to_be_read_in_is_read_in_that_of_its_heading(
    read: Read, unit: str
) -> None:
    recording = read(table("t [s]", f"s [{unit}]"))
    assert recording.signal("s").display_unit == unit


def test_a_name_of_one_or_two_letters_is_a_word_of_its_header(read: Read) -> None:
    tower = plant("Qt m3/s", "z m, Q m3/s")
    headers = ("t [s]", "Q_turb Qt [m3/s]", "Level Z [m]", "Tunnel Q [m3/s]")
    recording = read(table(*headers), signals=driven_by(tower))
    named = dict(zip(("time", "Qt", "z", "Q"), headers, strict=True))
    assert {r.signal: r.column for r in recording.mapping} == named
    other = ("Tunnel Q [m3/s]", "Spill Q [m3/s]", "Spill [m3/s]")
    (note,) = read(table(*headers[:3], *other[::-1]), signals=driven_by(tower)).notes
    assert 'signals.Q = "Spill Q [m3/s]"' in note
    # Before other words it is a letter for what is measured.
    (note,) = read(table(*headers[:3], "Q_1 [m3/s]", "Q_in [m3/s]"), signals=driven_by(tower)).notes
    assert 'signals.Q = "..."' in note


def test_the_last_word_of_a_topic_names_the_signal(read: Read) -> None:
    head = "__time,/axis/cmd/force,/axis/state/x [mm],/axis/state/n [U/min]"
    lines = [head, *(f"{k},{k % 7},{k},{60 * k}" for k in range(40))]
    found = read(lines, signals={"force": "N", "x": "m", "n": "rad/s"})
    assert found["x"][3] == 0.003 and found["n"][1] == pytest.approx(2 * np.pi)
    assert found["force"][3] == 3.0


def test_a_number_behind_a_name_is_a_word_of_the_header(read: Read) -> None:
    lines = table("t [s]", "heater 1 [%]", "heater 2 [%]")
    recording = read(lines, signals={"heat2": "1", "heat1": "1"})
    assert [row.column for row in recording.mapping][1:] == ["heater 2 [%]", "heater 1 [%]"]


@pytest.mark.parametrize(("unit", "size"), [("m", 1e-9), ("N m", 1.0)])
@pytest.mark.parametrize("name", ["z", "z_nm", "other"])
def test_nm_is_what_is_asked_for(read: Read, unit: str, size: float, name: str) -> None:
    recording = read(table("t [s]", "z_nm"), signals={name: unit})
    assert recording[name][3] == pytest.approx(8.0 * size)
    assert recording.mapping is not None and all(row.unit for row in recording.mapping)


@pytest.mark.parametrize(
    ("header", "name", "unit", "size"),
    [
        ("drive_nN", "drive", "N", 1e-9), ("leak_pA", "leak", "A", 1e-12),
        ("load_pA", "load_pA", "Pa", 1.0),
    ],
)  # fmt: skip
def test_a_small_unit_is_one_where_its_name_is_asked_for(
    read: Read, header: str, name: str, unit: str, size: float
) -> None:
    recording = read(table("t [s]", header), signals={name: unit})
    assert recording[name][3] == pytest.approx(8.0 * size)


def test_a_word_of_two_headers_names_the_one_that_no_other_word_does(read: Read) -> None:
    named = {
        "aero": "aero torque [kNm]", "torque": "generator torque [Nm]",
        "n_rotor": "rotor speed [rpm]", "n_gen": "generator speed [rpm]",
    }  # fmt: skip
    turbine = plant("aero N m, torque N m", "n_rotor rad/s, n_gen rad/s")
    recording = read(table("t [s]", *named.values()), signals=driven_by(turbine))
    assert {r.signal: r.column for r in recording.mapping} == {"time": "t [s]", **named}


@pytest.mark.parametrize(
    "headers",
    [
        ("room left [°C]", "room right [°C]"),
        ("room setpoint [°C]", "wall [°C]"),
        ("room no", "a [°C]", "b [°C]"),
        ("bathroom [°C]", "wall [°C]"),
    ],
)
def test_a_word_that_several_columns_or_a_setpoint_hold_names_none(
    read: Read, headers: tuple[str, ...]
) -> None:
    with pytest.raises(WorkbenchError, match="no column for signal 'room'"):
        read(table("t [s]", *headers), signals={"room": "K"})


def test_an_output_without_a_column_is_told(read: Read) -> None:
    headers = ("t [s]", "I [A]", "room [°C]", "cold [°C]", "sink [°C]")
    recording = read(table(*headers, "p [bar]"), signals=driven_by(COOLER))
    (note,) = recording.notes
    assert note.startswith("no column is called hot; of its unit is 'sink [°C]'")
    line = next(part for part in note.split(", ") if part.startswith("signals.hot"))
    rules = rules_from(tomllib.loads(line))
    assert "hot" in read(table(*headers), signals=driven_by(COOLER), mapping=rules)
    assert not read(table(*headers, "hot [°C]"), signals=driven_by(COOLER)).notes


LINE = plant("pump Pa", "level m, outflow m3/s"), ("pump [bar]", "level [cm]"), "outflow"
STACK = (
    plant("current A, room K", "voltage V, temp K"),
    ("I [A]", "U_cell [V]", "room [°C]"),
    "temp",
)
CYLINDER = plant("valve 1", "s m, p Pa"), ("air valve", "p [bar]"), "s"
WHEEL = plant("brake Pa", "v_car m/s, w_wheel rad/s"), ("brake [bar]", "w_wheel [rad/s]"), "v_car"

DRIVE = plant("supply V", "current A, speed rad/s"), ("supply [V]", "current [A]"), "speed"


@pytest.mark.parametrize(
    ("machine", "header", "taken", "other"),
    [
        # Part of a name, the letter of a quantity, a letter or a number, one word of a name.
        (LINE, "flow [L/s]", True, "spill [L/s]"),
        (LINE, "inflow [L/s]", False, "spill [L/s]"),
        (STACK, "T_stack [°C]", True, "T_wall [°C]"),
        (STACK, "wall [°C]", False, "T_wall [°C]"),
        (STACK, "T_ref [°C]", False, "T_wall [°C]"),
        (CYLINDER, "travel s [mm]", True, ""),
        (CYLINDER, "gap [mm]", False, ""),
        (WHEEL, "v [km/h]", True, ""),
        (WHEEL, "wind [km/h]", False, ""),
        (DRIVE, "shaft velocity [rad/s]", True, "n [rpm]"),
        (DRIVE, "Drehzahl in 1/min", True, ""),
        (DRIVE, "n_rpm", True, ""),
        (DRIVE, "gear [rpm]", False, ""),
    ],
)
def test_what_a_header_may_say_of_a_name(
    read: Read, machine: tuple[Plant, tuple[str, ...], str], header: str, taken: bool, other: str
) -> None:
    known, headers, name = machine
    recording = read(table("t [s]", *headers, header), signals=driven_by(known))
    others = {q.name for q in (*known.inputs, *known.outputs)} - {name}
    assert (name in recording) is taken and others <= set(recording.names)
    assert bool(recording.notes) is not taken
    if other:
        two = read(table("t [s]", *headers, header, other), signals=driven_by(known))
        assert name not in two


@pytest.mark.parametrize("headers", [("q1_deg", "u_V"), ("t [s]", "q1_deg")])
def test_what_to_write_into_a_mapping_file_is_what_such_a_file_may_hold(
    read: Read, headers: tuple[str, ...]
) -> None:
    with pytest.raises(WorkbenchError) as refused:
        read(table(*headers), signals={"force": "N"})
    (line,) = re.findall(r'\S+ = "\.\.\."', str(refused.value))
    rules_from(tomllib.loads(line.replace("...", "q1_deg")))


def test_missing_column_is_named_with_what_there_is(trial: Path) -> None:
    with pytest.raises(WorkbenchError, match=r"no column for signal 'force' \(N\).*q1_deg"):
        read_recording(trial, signals={"force": "N"})
    with pytest.raises(WorkbenchError, match=r"no column for signal 'opening'; the file has"):
        read_recording(trial, signals={"opening": "1"})


def test_wrong_unit_is_named(read: Read) -> None:
    with pytest.raises(WorkbenchError, match="'angle_bar' is in 'bar' but angle is measured"):
        read(table("time_s", "angle_bar"), signals={"angle": "rad"})


@pytest.mark.parametrize(
    ("begins", "numbers", "unit"),
    [(293.0, 23.0, "degC"), (293.0, 296.0, ""), (4.0, 20.0, ""), (1100.0, 850.0, "degC")],
)
def test_temperatures_without_a_unit_count_from_the_nearer_zero(
    read: Read, begins: float, numbers: float, unit: str
) -> None:
    oven = machine(
        lambda m: ({"oven": m.u.heat - m.x.oven / 50.0}, {"oven": m.x.oven}),
        f"oven K {begins} scale=30",
        "heat K/s 0 10",
        "oven K scale=30 display_unit=degC",
    )
    lines = ["time,heat,oven", *(f"{k},1,{numbers + 0.1 * k}" for k in range(30))]
    found = read(lines, signals=oven)
    row = next(r for r in found.mapping or () if r.signal == "oven")
    assert row.unit == unit and bool(row.note) == bool(unit)
    assert found["oven"][0] == pytest.approx(numbers + (273.15 if unit else 0.0))


def test_turns_are_read_where_an_angular_speed_is_asked_for(read: Read) -> None:
    lines = ["time_s,n [1/min],f [Hz],w [1/s]", *(f"{k},{60 * k},{k},{k}" for k in range(5))]
    turned = read(lines, signals={"n": "rad/s", "f": "rad/s", "w": "rad/s"})
    factors = [float(turned[name][1]) for name in ("n", "f", "w")]
    assert factors == pytest.approx([2.0 * np.pi, 2.0 * np.pi, 1.0])
    assert read(lines, signals={"f": "1/s"})["f"][1] == 1.0


def test_unknown_unit_is_left_out_or_an_error(read: Read) -> None:
    lines = table("time_s", "x [furlong]", "y")
    recording = read(lines)
    assert recording.names == ("y",)
    assert "furlong" in str(recording.mapping)
    for wanted in (["x"], {"x": "m"}):
        with pytest.raises(WorkbenchError, match="furlong"):
            read(lines, signals=wanted)
    # What a plant counts without a unit, as it does mU/min or NTU, is a number.
    told = read(lines, signals={"x": "1"})
    assert np.array_equal(told["x"], 5.0 + np.arange(20.0))
    assert any("furlong, which is taken as it stands" in r.note for r in told.mapping or ())
    # So it is where its author left the unit out; what is known otherwise needs its name.
    plain = read(table("time_s", "x [Hz]", "y"), signals={"x": "1"})
    assert np.array_equal(plain["x"], told["x"])
    assert any("Hz, which is taken as it stands" in r.note for r in plain.mapping or ())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[signals.angle]\ncolum = 'q1'", "did you mean 'column'"),
        ("[signals.angle]\ncolumn = 'q1'\nsign = 2", "angle.sign is 2; it must be one of 1, -1"),
        ("[signals.angle]\ncolumn = 'q1'\nunit = 'degg'", "did you mean 'deg'"),
        ("[signals.angle]\ncolumn = 'q1'\noffset = 'a'", "offset.* must be a number"),
        ("[signals.angle]\ncolumn = 'q1'\nrole = 'sensor'", "role"),
        ("[signals]\nangle = 3", "write a column name or a table"),
        ("[signal.angle]\ncolumn = 'q1'", "did you mean 'signals'"),
        ("columns = 'time_s'", "columns.* must be a list"),
        ("sample_time_s = -1", "sample_time_s"),
        ("[time]\nunit = 's'", "names no column"),
        ("= 3", "not valid TOML"),
    ],
)
def test_mistakes_in_a_mapping(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(WorkbenchError, match=message):
        read_mapping(mapping(tmp_path, text))


def test_mapping_names_a_column_that_is_not_there(trial: Path) -> None:
    with pytest.raises(WorkbenchError, match=r"from column 'theta'.*it has: t_ms"):
        read_recording(trial, mapping={"angle": "theta"})


def test_missing_mapping_file(tmp_path: Path) -> None:
    with pytest.raises(WorkbenchError, match="cannot be read"):
        read_mapping(tmp_path / "none.toml")


def test_part_of_a_file(read: Read) -> None:
    lines = ["time_s,angle_rad", *(f"{k / 10},{k}" for k in range(50))]
    recording = read(lines, mapping={"rows": [10, 20]})
    assert recording["angle"].tolist() == list(range(10, 20))
    assert "10 of 50 rows taken" in recording.notes[-1]
    timed = read(lines, mapping={"times_s": [1.0, 1.5]})
    assert timed["angle"].tolist() == list(range(10, 16))
    for bad in ([5, 5], [0.5, 3], "0:5", [1], [-1, 4], [60, 70]):
        with pytest.raises(WorkbenchError, match="rows"):
            read(lines, mapping={"rows": bad})


def test_units_of_the_file(read: Read) -> None:
    lines = ["time_s,angle [tick],raw", *(f"{k},{k},{k}" for k in range(3))]
    rules = {
        "units": {"tick": "0.5 deg"},
        "signals": {"angle": "angle", "motor": {"column": "raw", "unit": "tick", "offset": 2.0}},
    }
    recording = read(lines, mapping=rules)
    assert np.allclose(np.rad2deg(recording["angle"]), [0.0, 0.5, 1.0])
    assert np.allclose(np.rad2deg(recording["motor"]), [1.0, 1.5, 2.0])
    for bad in ("0.5", "half deg", "0.5 furlong", ""):
        with pytest.raises(WorkbenchError, match="unit"):
            read(lines, mapping={"units": {"tick": bad}})


@pytest.mark.parametrize(
    ("supply", "chamber", "apart"),
    [
        ("supply [bar abs]", "chamber [bar abs]", (0.0, 0.0)),
        ("supply [barg]", "chamber [barg]", (1.01325, 1.01325)),
        ("supply [bar abs]", "chamber [barg]", (0.0, 1.01325)),
        ("supply [bar]", "chamber [bar]", (0.0, 0.0)),
    ],
)
def test_pressures_of_a_plant_that_counts_from_vacuum_are_absolute(
    supply: str, chamber: str, apart: tuple[float, float], tmp_path: Path
) -> None:
    # That it does, the chamber tells: it begins at the ambient pressure.
    plant = machine(
        lambda m: (
            {"filled": m.u.supply - m.x.filled},
            {"chamber": m.x.filled, "loss": m.u.supply - m.x.filled},
        ),
        "filled Pa 101325 scale=1e5",
        "supply Pa 0 1e6 7e5",
        "chamber Pa 100 scale=1e5, loss Pa 100 scale=1e5",
    )
    file = tmp_path / "a.csv"
    file.write_text(f"time_s,{supply},{chamber},loss [mbar]\n0,7,1,30\n1,7,2,20\n2,7,6,10\n")
    found = read_recording(file, signals=plant)
    read = found["supply"] / 1e5 - 7.0, found["chamber"] / 1e5 - [1.0, 2.0, 6.0]
    assert np.allclose(read, np.array(apart)[:, None])
    assert found.signal("chamber").kind == "absolute pressure"
    assert found["loss"].tolist() == [3000.0, 2000.0, 1000.0]


def test_a_heading_is_found_without_its_unit_and_behind_a_mark_of_the_encoding(
    tmp_path: Path,
) -> None:
    file, rules = tmp_path / "a.csv", tmp_path / "rules.toml"
    file.write_text("Zeit (s);Température ambiante (°C)\n0;20\n1;21\n2;22\n", encoding="utf-8")
    rules.write_text('signals.room = "Température ambiante"', encoding="utf-8-sig")
    assert read_recording(file, mapping=rules)["room"].tolist() == [293.15, 294.15, 295.15]
