"""Recordings of real machines, as their makers published them."""

from pathlib import Path

import numpy as np
import pytest

from workbench.recordings import Recording, check_recording, read_recording, read_table

EMPS = """
time = { column = "t", unit = "s" }
[signals]
force = { column = "vir", factor = 35.15065, unit = "N", role = "command" }
position = { column = "qm", unit = "m" }
goal = { column = "qg", unit = "m", role = "reference" }
"""
ZILLEN = """
columns = ["time_ms", "laser_V", "pressure_V", "force_V", "laser_mm", "pressure_bar", "force_N"]
time = { column = "time_ms" }
signals = { position = "laser_mm", pressure = "pressure_bar", force = "force_N" }
"""
TANKS = """
[signals]
pump = { column = "uEst", unit = "V", role = "command" }
level = { column = "yEst", unit = "V" }
"""
SERVO = """
time = { column = "timestamp" }
[signals]
position = { column = "position", unit = "rad" }
goal = { column = "goal_position", unit = "rad", role = "reference" }
supply = { column = "input_volts", unit = "V", role = "measurement" }
"""


@pytest.fixture
def real(external_folder: Path) -> Path:
    if not (external_folder / "real").is_dir():
        pytest.skip("the data folder has no recordings of real machines")
    return external_folder / "real"


def read(path: Path, mapping: str, folder: Path) -> Recording:
    rules = folder / "mapping.toml"
    rules.write_text(mapping)
    return read_recording(path, mapping=rules)


@pytest.mark.parametrize("name", ["DATA_EMPS", "DATA_EMPS_PULSES"])
def test_emps(real: Path, tmp_path: Path, name: str) -> None:
    recording = read(real / "emps" / f"{name}.mat", EMPS, tmp_path)
    assert len(recording) == 24841
    assert recording.sample_time == pytest.approx(1e-3, rel=1e-4)
    assert recording.metadata["kp"] == pytest.approx(160.18)
    report = check_recording(recording)
    assert report.result == "pass", str(report)
    assert report.check("loop").values["loop"] == "closed"
    # SciPy reads the same file by other code.
    from scipy.io import loadmat

    content = loadmat(real / "emps" / f"{name}.mat", squeeze_me=True)
    assert np.array_equal(recording["position"], content["qm"])
    assert np.allclose(recording["force"], 35.15065 * content["vir"], rtol=1e-15)
    assert np.array_equal(recording.time, content["t"])


def test_cascaded_tanks(real: Path, tmp_path: Path) -> None:
    path = real / "cascaded-tanks" / "dataBenchmark.csv"
    recording = read(path, TANKS, tmp_path)
    assert (len(recording), recording.sample_time) == (1024, 4.0)
    assert recording["pump"][0] == 3.2567
    report = check_recording(recording)
    # The level sensor ends at 10 V, where the tank overflows.
    assert report.check("clipping").values["limits"] == {"level": 10.0}
    assert int((~report.recording.valid("level")).sum()) == int((recording["level"] == 10.0).sum())
    assert report.fit
    assert read_recording(path).names == ("uEst", "uVal", "yEst", "yVal")


def test_servo_logs(real: Path, tmp_path: Path) -> None:
    paths = sorted((real / "bam-servo-friction").glob("*.json"))
    assert len(paths) == 16
    for path in paths:
        recording = read(path, SERVO, tmp_path)
        assert recording.metadata["motor"] == "xl330"
        assert 5.5 < recording.duration < 6.5
        report = check_recording(recording, required=["position"])
        assert report.check("uniformity").result == "corrected"
        assert report.fit, str(report)
        # 4096 counts per turn.
        step = report.check("quantisation").values["steps"]["position"]
        assert step == pytest.approx(2 * np.pi / 4096, rel=1e-3)


def test_seal_friction(real: Path, tmp_path: Path) -> None:
    folder = real / "zillen-pneumatic-seal-friction"
    paths = sorted(folder.glob("*.csv"))
    assert len(paths) == 15
    for path in paths:
        recording = read(path, ZILLEN, tmp_path)
        assert recording.names == ("position", "pressure", "force")
        stated = float(path.stem.split("_")[-1].removesuffix("bar"))
        assert np.median(recording["pressure"]) / 1e5 == pytest.approx(stated, abs=0.1)
    report = check_recording(read(folder / "NAPN_1bar.csv", ZILLEN, tmp_path))
    assert report.fit
    assert report.check("quantisation").values["steps"]["position"] == pytest.approx(1e-6, rel=1e-3)
    # Ten strokes.
    assert report.check("excitation").values["directions"]["position"].reversals >= 9


def test_force_maps(real: Path) -> None:
    folder = real / "martens2017-festo-force-maps"
    for name, points, force in (("dmsp-20-300", 126, 1653.5), ("dmsp-10-250", 85, 542.5)):
        table = read_table(folder / f"{name}_static_force.csv")
        assert [s.unit for s in table.signals] == ["Pa", "m", "N"]
        assert len(table["force"]) == points
        assert table["force"].max() == force


def test_valve_curve(real: Path) -> None:
    table = read_table(real / "festo-mpye-valve-zhu2006" / "valve_data.csv")
    kinds = ["voltage", "length", "area", "mass flow", "volume flow", "volume flow"]
    assert [s.kind for s in table.signals] == kinds
    assert table["Exp_Vol_flow_rate"].max() == pytest.approx(100 / 60000)
