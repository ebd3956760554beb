import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

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
    class Arm:
        inputs = (Input("valve", "V"),)
        outputs = (
            Output("angle", "rad", display_unit="deg"),
            Output("pressure_1", "Pa"),
            Output("pressure_2", "Pa"),
        )

    recording = read_recording(trial, signals=Arm(), mapping={"time": {"column": "t_ms"}})
    # u is a synonym of valve; q1 is the only angle; pA and pB are synonyms of the pressures.
    assert recording.names == ("valve", "angle", "pressure_1", "pressure_2")
    assert recording.commands == ("valve",)
    assert recording["pressure_2"][0] == pytest.approx(2e5)
    assert {row.signal: row.how for row in recording.mapping} == {
        "time": "mapping file",
        "valve": "synonym",
        "angle": "unit",
        "pressure_1": "synonym",
        "pressure_2": "synonym",
    }


class _Heater:
    inputs = (Input("power", "W"),)
    outputs = (Output("oven", "K"),)


def test_the_only_command_and_the_only_output_may_be_called_u_and_y(tmp_path: Path) -> None:
    recording = read_recording(_file(tmp_path, "t", "u", "y"), signals=_Heater())
    assert recording.names == ("power", "oven")
    # Of several nobody knows which, and volts are no watts.
    with pytest.raises(WorkbenchError, match="no column for signal 'current'"):
        read_recording(_file(tmp_path, "t", "u", "y"), signals=_Cooler())
    with pytest.raises(WorkbenchError, match="no column for signal 'power'"):
        read_recording(_file(tmp_path, "t", "u [V]", "y"), signals=_Heater())


class _Cooler:
    inputs = (Input("current", "A"), Input("room", "K"))
    outputs = (Output("cold", "K"), Output("hot", "K"))


def _file(folder: Path, *headers: str) -> Path:
    path = folder / "trial.csv"
    rows = "".join(",".join(str(k + 5 * i) for i in range(len(headers))) + "\n" for k in range(20))
    path.write_text(",".join(headers) + "\n" + rows)
    return path


def _ways(recording: Recording) -> dict[str, str]:
    return {row.signal: row.how for row in recording.mapping}


def test_a_word_of_the_header_names_the_signal(tmp_path: Path) -> None:
    path = _file(tmp_path, "t [s]", "I [mA]", "ambient °C", "T_cold [°C]", "T_hot [°C]")
    recording = read_recording(path, signals=driven_by(_Cooler()))
    part = "part of its name"
    assert _ways(recording) == {
        "time": "name", "current": "unit", "room": "unit", "cold": part, "hot": part
    }  # fmt: skip
    assert recording["hot"][0] == pytest.approx(293.15)
    # What the plant only gives in SI is read as the file is headed.
    assert recording.signal("current").display_unit == "mA"
    assert not recording.notes


def test_the_last_word_of_a_topic_names_the_signal(tmp_path: Path) -> None:
    path = tmp_path / "bag.csv"
    head = "__time,/axis/cmd/force,/axis/state/x [mm],/axis/state/n [U/min]\n"
    path.write_text(head + "".join(f"{k},{k % 7},{k},{60 * k}\n" for k in range(40)))
    found = read_recording(path, signals={"force": "N", "x": "m", "n": "rad/s"})
    assert found["x"][3] == 0.003 and found["n"][1] == pytest.approx(2 * np.pi)
    assert found["force"][3] == 3.0


def test_a_number_behind_a_name_is_a_word_of_the_header(tmp_path: Path) -> None:
    path = _file(tmp_path, "t [s]", "heater 1 [%]", "heater 2 [%]")
    recording = read_recording(path, signals={"heat2": "1", "heat1": "1"})
    assert [row.column for row in recording.mapping][1:] == ["heater 2 [%]", "heater 1 [%]"]


@pytest.mark.parametrize(("unit", "size"), [("m", 1e-9), ("N m", 1.0)])
@pytest.mark.parametrize("name", ["z", "z_nm", "other"])
def test_nm_is_what_is_asked_for(tmp_path: Path, unit: str, size: float, name: str) -> None:
    recording = read_recording(_file(tmp_path, "t [s]", "z_nm"), signals={name: unit})
    assert recording[name][3] == pytest.approx(8.0 * size)
    assert recording.mapping is not None and all(row.unit for row in recording.mapping)


class _Turbine:
    inputs = (Input("aero", "N m"), Input("torque", "N m"))
    outputs = (Output("n_rotor", "rad/s"), Output("n_gen", "rad/s"))


def test_a_word_of_two_headers_names_the_one_that_no_other_word_does(tmp_path: Path) -> None:
    path = _file(
        tmp_path, "t [s]", "aero torque [kNm]", "generator torque [Nm]", "rotor speed [rpm]",
        "generator speed [rpm]",
    )  # fmt: skip
    recording = read_recording(path, signals=driven_by(_Turbine()))
    columns = {row.signal: row.column for row in recording.mapping}
    assert columns["aero"] == "aero torque [kNm]" and columns["torque"] == "generator torque [Nm]"
    assert columns["n_rotor"] == "rotor speed [rpm]"
    assert columns["n_gen"] == "generator speed [rpm]"


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
    tmp_path: Path, headers: tuple[str, ...]
) -> None:
    path = _file(tmp_path, "t [s]", *headers)
    with pytest.raises(WorkbenchError, match="no column for signal 'room'"):
        read_recording(path, signals={"room": "K"})


def test_an_output_without_a_column_is_told(tmp_path: Path) -> None:
    path = _file(tmp_path, "t [s]", "I [A]", "room [°C]", "cold [°C]", "sink [°C]", "p [bar]")
    recording = read_recording(path, signals=driven_by(_Cooler()))
    (note,) = recording.notes
    assert note.startswith("no column is called hot; of its unit is 'sink [°C]'")
    line = next(part for part in note.split(", ") if part.startswith("signals.hot"))
    mapped = read_recording(
        _file(tmp_path, "t [s]", "I [A]", "room [°C]", "cold [°C]", "sink [°C]"),
        signals=driven_by(_Cooler()),
        mapping=rules_from(tomllib.loads(line)),
    )
    assert "hot" in mapped
    everything = read_recording(
        _file(tmp_path, "t [s]", "I [A]", "room [°C]", "cold [°C]", "hot [°C]", "sink [°C]"),
        signals=driven_by(_Cooler()),
    )
    assert not everything.notes


class _Line:
    inputs = (Input("pump", "Pa"),)
    outputs = (Output("level", "m"), Output("outflow", "m3/s"))


@pytest.mark.parametrize(("header", "taken"), [("flow [L/s]", True), ("inflow [L/s]", False)])
def test_a_header_may_say_part_of_a_name(tmp_path: Path, header: str, taken: bool) -> None:
    path = _file(tmp_path, "t [s]", "pump [bar]", "level [cm]", header)
    recording = read_recording(path, signals=driven_by(_Line()))
    assert ("outflow" in recording) is taken and bool(recording.notes) is not taken
    two = _file(tmp_path, "t [s]", "pump [bar]", "level [cm]", header, "spill [L/s]")
    assert "outflow" not in read_recording(two, signals=driven_by(_Line()))


class _Stack:
    inputs = (Input("current", "A"), Input("room", "K"))
    outputs = (Output("voltage", "V"), Output("temp", "K"))


@pytest.mark.parametrize(
    ("header", "taken"), [("T_stack [°C]", True), ("wall [°C]", False), ("T_ref [°C]", False)]
)
def test_a_header_may_begin_with_the_letter_of_its_quantity(
    tmp_path: Path, header: str, taken: bool
) -> None:
    path = _file(tmp_path, "t [s]", "I [A]", "U_cell [V]", "room [°C]", header)
    recording = read_recording(path, signals=driven_by(_Stack()))
    assert "voltage" in recording and ("temp" in recording) is taken
    two = _file(tmp_path, "t [s]", "I [A]", "U_cell [V]", "room [°C]", header, "T_wall [°C]")
    assert ("temp" in read_recording(two, signals=driven_by(_Stack()))) is False


class _Cylinder:
    inputs = (Input("valve", "1"),)
    outputs = (Output("s", "m"), Output("p", "Pa"))


@pytest.mark.parametrize(("header", "taken"), [("travel s [mm]", True), ("gap [mm]", False)])
def test_a_letter_or_a_number_without_a_unit_is_a_word_of_a_header(
    tmp_path: Path, header: str, taken: bool
) -> None:
    path = _file(tmp_path, "t [s]", "air valve", "p [bar]", header)
    recording = read_recording(path, signals=driven_by(_Cylinder()))
    assert "valve" in recording and ("s" in recording) is taken


class _Wheel:
    inputs = (Input("brake", "Pa"),)
    outputs = (Output("v_car", "m/s"), Output("w_wheel", "rad/s"))


@pytest.mark.parametrize(("header", "taken"), [("v [km/h]", True), ("wind [km/h]", False)])
def test_a_header_may_say_one_word_of_a_name(tmp_path: Path, header: str, taken: bool) -> None:
    path = _file(tmp_path, "t [s]", "brake [bar]", "w_wheel [rad/s]", header)
    assert ("v_car" in read_recording(path, signals=driven_by(_Wheel()))) is taken


@pytest.mark.parametrize("headers", [("q1_deg", "u_V"), ("t [s]", "q1_deg")])
def test_what_to_write_into_a_mapping_file_is_what_such_a_file_may_hold(
    tmp_path: Path, headers: tuple[str, ...]
) -> None:
    with pytest.raises(WorkbenchError) as refused:
        read_recording(_file(tmp_path, *headers), signals={"force": "N"})
    (line,) = re.findall(r'\S+ = "\.\.\."', str(refused.value))
    rules_from(tomllib.loads(line.replace("...", "q1_deg")))


def test_missing_column_is_named_with_what_there_is(trial: Path) -> None:
    with pytest.raises(WorkbenchError, match=r"no column for signal 'force' \(N\).*q1_deg"):
        read_recording(trial, signals={"force": "N"})
    with pytest.raises(WorkbenchError, match=r"no column for signal 'opening'; the file has"):
        read_recording(trial, signals={"opening": "1"})


def test_wrong_unit_is_named(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text("time_s,angle_bar\n" + "".join(f"{k},{k}\n" for k in range(5)))
    with pytest.raises(WorkbenchError, match="'angle_bar' is in 'bar' but angle is measured"):
        read_recording(path, signals={"angle": "rad"})


def test_turns_are_read_where_an_angular_speed_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    rows = "".join(f"{k},{60 * k},{k},{k}\n" for k in range(5))
    path.write_text("time_s,n [1/min],f [Hz],w [1/s]\n" + rows)
    read = read_recording(path, signals={"n": "rad/s", "f": "rad/s", "w": "rad/s"})
    factors = [float(read[name][1]) for name in ("n", "f", "w")]
    assert factors == pytest.approx([2.0 * np.pi, 2.0 * np.pi, 1.0])
    both = read_recording(path, signals={"f": "1/s"})
    assert both["f"][1] == 1.0


def test_unknown_unit_is_left_out_or_an_error(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text("time_s,x [furlong],y\n" + "".join(f"{k},{k},{k}\n" for k in range(5)))
    recording = read_recording(path)
    assert recording.names == ("y",)
    assert "furlong" in str(recording.mapping)
    with pytest.raises(WorkbenchError, match="furlong"):
        read_recording(path, signals=["x"])
    with pytest.raises(WorkbenchError, match="furlong"):
        read_recording(path, signals={"x": "m"})
    # What a plant counts without a unit, as it does mU/min or NTU, is a number.
    told = read_recording(path, signals={"x": "1"})
    assert np.array_equal(told["x"], np.arange(5.0))
    assert any("furlong, which is taken as it stands" in r.note for r in told.mapping or ())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[signals.angle]\ncolum = 'q1'", "did you mean 'column'"),
        (
            "[signals.angle]\ncolumn = 'q1'\nsign = 2",
            "signals.angle.sign is 2; it must be one of 1, -1",
        ),
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


def test_part_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text("time_s,angle_rad\n" + "".join(f"{k / 10},{k}\n" for k in range(50)))
    recording = read_recording(path, mapping={"rows": [10, 20]})
    assert recording["angle"].tolist() == list(range(10, 20))
    assert "10 of 50 rows taken" in recording.notes[-1]
    recording = read_recording(path, mapping={"times_s": [1.0, 1.5]})
    assert recording["angle"].tolist() == list(range(10, 16))
    for bad in ([5, 5], [0.5, 3], "0:5", [1], [-1, 4], [60, 70]):
        with pytest.raises(WorkbenchError, match="rows"):
            read_recording(path, mapping={"rows": bad})


def test_units_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_text("time_s,angle [tick],raw\n" + "".join(f"{k},{k},{k}\n" for k in range(3)))
    rules = {
        "units": {"tick": "0.5 deg"},
        "signals": {"angle": "angle", "motor": {"column": "raw", "unit": "tick", "offset": 2.0}},
    }
    recording = read_recording(path, mapping=rules)
    assert np.allclose(np.rad2deg(recording["angle"]), [0.0, 0.5, 1.0])
    assert np.allclose(np.rad2deg(recording["motor"]), [1.0, 1.5, 2.0])
    for bad in ("0.5", "half deg", "0.5 furlong", ""):
        with pytest.raises(WorkbenchError, match="unit"):
            read_recording(path, mapping={"units": {"tick": bad}})
