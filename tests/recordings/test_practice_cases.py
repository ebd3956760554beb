"""The fitness checks on cases whose making is known: 500 Hz, 12-bit converters, 6 mbar of noise."""

from pathlib import Path

import numpy as np
import pytest

from workbench.data_folder import shipped_cases, shipped_data
from workbench.recordings import CheckReport, check_recording, read_case

CASES = [f"practice-{k:02d}" for k in range(1, 9)]


def reports(folder: Path) -> dict[str, CheckReport]:
    case = read_case(folder)
    return {role: check_recording(recording) for role, recording in case.recordings.items()}


def assert_fit(found: dict[str, CheckReport]) -> None:
    for role, report in found.items():
        assert report.result == "pass", str(report)
        assert report.check("loop").values["loop"] == role.split("_")[1], str(report.check("loop"))
        assert report.recording.sample_time == pytest.approx(0.002)
        floors = report.check("noise floor").values["floors"]
        for name in ("pressure_1", "pressure_2"):
            noise = floors[name]
            # 12 bit on 10 bar, printed with four digits; 6 mbar rms, known to 5 % from 100 blocks.
            assert noise.step == pytest.approx(240.0, rel=0.02)
            assert noise.noise_rms == pytest.approx(600.0, rel=0.06)
        angle = floors["angle"]
        assert np.rad2deg(angle.step) == pytest.approx(0.002, rel=1e-3)
        assert np.rad2deg(angle.floor) == pytest.approx(0.002 / np.sqrt(12), rel=0.05)
        assert np.isnan(angle.noise_rms)
        if role != "validate_open":  # Its two levels do not tell the converter's step.
            assert report.check("quantisation").values["steps"]["valve"] == pytest.approx(
                10 / 4096, rel=0.01
            )


@pytest.mark.parametrize("name", shipped_cases())
def test_shipped_cases(name: str) -> None:
    assert_fit(reports(shipped_data(name)))


@pytest.mark.parametrize("name", CASES)
def test_every_practice_case(name: str, external_folder: Path) -> None:
    folder = external_folder / "practice" / name
    if not folder.is_dir():
        pytest.skip(f"the data folder has no {folder.name}")
    found = reports(folder)
    assert_fit(found)
    # The valve's spool and a rising pressure show after some samples, never at once.
    delays = found["identify_open"].check("delay").values["delays"]
    onsets = [d.onset for d in delays if d.response != "angle"]
    assert all(0.002 <= onset <= 0.02 for onset in onsets)


def test_lagging_sensors_show_in_the_delay(external_folder: Path) -> None:
    onset = {}
    for name in ("practice-06", "practice-07"):
        folder = external_folder / "practice" / name
        if not folder.is_dir():
            pytest.skip(f"the data folder has no {name}")
        delays = reports(folder)["identify_open"].check("delay").values["delays"]
        onset[name] = next(d.onset for d in delays if d.response == "pressure_1")
    assert onset["practice-06"] > onset["practice-07"] + 0.005
