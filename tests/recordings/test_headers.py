import pytest

from workbench.recordings.headers import read_header


@pytest.mark.parametrize(
    ("column", "name", "unit", "reference"),
    [
        ("pressure_1_bar", "pressure_1", "bar", ""),
        ("angle_deg", "angle", "deg", ""),
        ("valve_V", "valve", "V", ""),
        ("time_ms", "time", "ms", ""),
        ("angle [deg]", "angle", "deg", ""),
        ("angle (°)", "angle", "°", ""),
        ("Voltage (volt)", "Voltage", "V", ""),
        ("Mass flow rate (g/sec)", "Mass_flow_rate", "g/s", ""),
        ("speed_rad_s", "speed", "rad/s", ""),
        ("speed_deg_per_s", "speed", "deg/s", ""),
        ("torque_N_m", "torque", "N m", ""),
        ("supply [barg]", "supply", "bar", "gauge"),
        ("pressure_abs_bar", "pressure", "bar", "absolute"),
        ("pressure_bar_abs", "pressure", "bar", "absolute"),
        ("p1 (bar(a))", "p1", "bar", "absolute"),
        # A trailing letter that names a chamber, an index that names a muscle.
        ("pressure_A", "pressure_A", "", ""),
        ("pressure_1", "pressure_1", "", ""),
        ("muscle_2", "muscle_2", "", ""),
        ("uEst", "uEst", "", ""),
    ],
)
def test_headers(column: str, name: str, unit: str, reference: str) -> None:
    header = read_header(column)
    assert (header.name, header.unit, header.reference) == (name, unit, reference)


def test_unknown_unit_in_brackets_is_a_problem() -> None:
    assert "furlong" in read_header("stroke [furlong]").problem
    assert read_header("pressure [1]").problem == ""
