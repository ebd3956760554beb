"""Finding recordings: the shipped ones are complete, a wrong folder is one clear sentence."""

from __future__ import annotations

import gzip
import os
import tomllib
from pathlib import Path

import numpy as np
import pytest

from workbench.data_folder import (
    data_folder,
    external_data,
    shipped_cases,
    shipped_data,
    shipped_folder,
)
from workbench.errors import WorkbenchError

RECORDINGS = {
    "identify_open": 10_000,
    "identify_closed": 10_000,
    "validate_open": 8_000,
    "validate_closed": 10_000,
}


@pytest.mark.parametrize("case", ["practice-07", "practice-08"])
def test_shipped_case_is_complete(case: str) -> None:
    folder = shipped_data(case)
    description = tomllib.loads((folder / "case.toml").read_text())
    assert description == {
        "load_kg": 3,
        "plane": "horizontal",
        "supply_bar": 6.0,
        "sample_rate_Hz": 500,
    }
    assert {path.name for path in folder.glob("*.gz")} == {f"{name}.csv.gz" for name in RECORDINGS}


@pytest.mark.parametrize("case", ["practice-07", "practice-08"])
@pytest.mark.parametrize(("name", "samples"), RECORDINGS.items())
def test_shipped_recording_is_sound(case: str, name: str, samples: int) -> None:
    with gzip.open(shipped_data(case) / f"{name}.csv.gz", "rt") as stream:
        header = stream.readline().strip().split(",")
        values = np.loadtxt(stream, delimiter=",")
    assert header == ["time_s", "valve_V", "angle_deg", "pressure_1_bar", "pressure_2_bar"]
    assert values.shape == (samples, 5)
    assert np.isfinite(values).all()
    # The time column is printed to the millisecond, so only rounding remains.
    np.testing.assert_allclose(values[:, 0], np.arange(samples) / 500, atol=1e-9)
    # Between the stops, and gauge pressures between the room's and the supply's 6 bar.
    assert -2 < values[:, 2].min() < values[:, 2].max() < 62
    assert values[:, 3:].min() >= 0
    assert values[:, 3:].max() < 6.05


def test_the_cases_differ() -> None:
    texts = {
        gzip.decompress((shipped_data(case) / "validate_open.csv.gz").read_bytes())
        for case in shipped_cases()
    }
    assert len(texts) == 2


def test_compression_carries_no_time_stamp() -> None:
    # Bytes 4 to 8 of a gzip file are its time stamp: zero makes the archive reproducible.
    for path in shipped_folder().rglob("*.gz"):
        assert path.read_bytes()[4:8] == bytes(4), path.name


def test_shipped_recordings_stay_small() -> None:
    assert sum(path.stat().st_size for path in shipped_folder().rglob("*.gz")) < 2_000_000


def test_unknown_shipped_case_names_the_nearest() -> None:
    with pytest.raises(WorkbenchError, match=r"'practice-7'.*did you mean 'practice-07'"):
        shipped_data("practice-7")


def test_given_folder_wins_over_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, named = tmp_path / "given", tmp_path / "named"
    given.mkdir()
    named.mkdir()
    monkeypatch.setenv("WORKBENCH_DATA", str(named))
    assert data_folder(given) == given
    assert data_folder() == named


def test_no_folder_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WORKBENCH_DATA", raising=False)
    with pytest.raises(WorkbenchError, match="--data FOLDER or set .* WORKBENCH_DATA"):
        data_folder()


def test_empty_name_is_not_the_current_folder() -> None:
    with pytest.raises(WorkbenchError, match="no data folder is named"):
        data_folder("")


def test_missing_folder_says_which_and_from_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = tmp_path / "missing"
    with pytest.raises(WorkbenchError, match=r"missing' does not exist"):
        data_folder(missing)
    monkeypatch.setenv("WORKBENCH_DATA", str(missing))
    with pytest.raises(WorkbenchError, match=r"named by WORKBENCH_DATA.*does not exist"):
        data_folder()


def test_file_instead_of_folder(tmp_path: Path) -> None:
    file = tmp_path / "recording.csv"
    file.touch()
    with pytest.raises(WorkbenchError, match="is a file"):
        data_folder(file)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="permissions do not bind root")
def test_unreadable_folder(tmp_path: Path) -> None:
    folder = tmp_path / "closed"
    folder.mkdir(mode=0)
    with pytest.raises(WorkbenchError, match="cannot be read"):
        data_folder(folder)


def test_external_data_inside_and_outside(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    assert external_data("real", tmp_path) == tmp_path / "real"
    with pytest.raises(WorkbenchError, match="holds no 'force-maps'"):
        external_data("force-maps", tmp_path)
    with pytest.raises(WorkbenchError, match="leaves the data folder"):
        external_data("..", tmp_path)
