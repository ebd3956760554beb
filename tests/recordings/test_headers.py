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
        # As the standard for quantities writes them; a unit alone and an index name nothing.
        ("Time/ms", "Time", "ms", ""),
        ("t/s", "t", "s", ""),
        ("M/mNm", "M", "mNm", ""),
        ("M [Ncm]", "M", "Ncm", ""),
        ("I/A", "I", "A", ""),
        ("p_1/bar", "p_1", "bar", ""),
        ("acid/l/min", "acid", "l/min", ""),
        ("flow l/min", "flow", "l/min", ""),
        ("flow_l/min", "flow", "l/min", ""),
        ("x_2_m/s", "x_2", "m/s", ""),
        ("shaft_rad/s^2", "shaft", "rad/s^2", ""),
        ("heat_kJ/kg", "heat", "kJ/kg", ""),
        ("shaft_1/min", "shaft", "1/min", ""),
        ("P_A/bar", "P_A", "bar", ""),
        ("flow_A/l/min", "flow_A", "l/min", ""),
        ("Temperature (deg C)", "Temperature", "degC", ""),
        ("Temp [Celsius]", "Temp", "degC", ""),
        ("m/s", "m_s", "", ""),
        ("uEst/yEst", "uEst_yEst", "", ""),
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
        # An inflow, a desired value, a difference, a calibrated one: no inches, days, teslas.
        ("T_in", "T_in", "", ""),
        ("p in bar", "p_in", "bar", ""),
        ("p_bar_in", "p_bar_in", "", ""),
        ("theta_d", "theta_d", "", ""),
        ("temp_C", "temp_C", "", ""),
        ("T_deg_C", "T_deg_C", "", ""),
        ("x_dT", "x_dT", "", ""),
        ("torque_nm", "torque_nm", "", ""),
        ("p_atm", "p_atm", "", ""),
        ("temperature_F", "temperature_F", "", ""),
        ("stroke [in]", "stroke", "in", ""),
        ("T [C]", "T", "degC", ""),
        ("Body acc [g]", "Body_acc", "gn", ""),
        ("acceleration_z (g)", "acceleration_z", "gn", ""),
        ("acc_g", "acc", "gn", ""),
        ("accumulated [g]", "accumulated", "g", ""),
        ("Oven temp. (F)", "Oven_temp", "degF", ""),
        ("charge [C]", "charge", "C", ""),
        ("speed_kn", "speed", "kn", ""),
        ("stroke_cm", "stroke", "cm", ""),
        ("flow_l_h", "flow", "l/h", ""),
        ("energy_kW_h", "energy", "kW h", ""),
        ("U_amp_V", "U_amp", "V", ""),
        ("tau_m_Nm", "tau_m", "Nm", ""),
        ("p_m_s", "p", "m/s", ""),
        ("turn_rate_rad_sec", "turn_rate", "rad/s", ""),
        ("c_mol_l", "c", "mol/l", ""),
    ],
)
def test_headers(column: str, name: str, unit: str, reference: str) -> None:
    header = read_header(column)
    assert (header.name, header.unit, header.reference) == (name, unit, reference)


def test_unknown_unit_in_brackets_is_a_problem() -> None:
    assert "furlong" in read_header("stroke [furlong]").problem
    assert read_header("pressure [1]").problem == ""
