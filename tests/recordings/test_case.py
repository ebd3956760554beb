import shutil
from pathlib import Path

import pytest

from workbench.data_folder import shipped_data
from workbench.errors import WorkbenchError
from workbench.recordings import read_case


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(shipped_data("practice-07"), tmp_path / "case"))


def test_case(folder: Path) -> None:
    case = read_case(folder)
    assert case.options == {"load": 3.0, "plane": "horizontal", "supply": 6.0}
    assert (case.plant.name, case.settings["sample_rate_Hz"]) == ("arm", 500)
    assert list(case.fit) == ["identify_open", "identify_closed"]
    assert list(case.hold_out) == ["validate_open", "validate_closed"]
    recording = case.recordings["identify_open"]
    assert recording.names == ("valve", "angle", "pressure_1", "pressure_2")
    assert recording.commands == ("valve",)
    assert recording.signal("pressure_1").kind == "gauge pressure"
    assert recording.metadata["load_kg"] == 3
    assert recording.name == "case/identify_open"
    assert "hold out" in str(case)


def test_missing_recording_is_noted(folder: Path) -> None:
    (folder / "validate_closed.csv.gz").unlink()
    assert "validate_closed is missing" in read_case(folder).notes


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("load_kg = 3", "load_kg = 30"), "load_kg of case case is 30 kg"),
        (('"horizontal"', '"horizontl"'), "did you mean 'horizontal'"),
        (("supply_bar = 6.0", "supply_bar = 'six'"), "supply_bar.* not a number"),
        (("load_kg = 3", "load_kg = = 3"), "not valid TOML"),
    ],
)
def test_wrong_settings(folder: Path, change: tuple[str, str], message: str) -> None:
    settings = folder / "case.toml"
    settings.write_text(settings.read_text().replace(*change))
    with pytest.raises(WorkbenchError, match=message):
        read_case(folder)


def test_missing_setting_is_named_when_it_is_needed(folder: Path) -> None:
    (folder / "case.toml").write_text("note = 'another machine'")
    with pytest.raises(WorkbenchError, match="does not give load_kg"):
        read_case(folder).model()


def test_what_is_no_case(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(WorkbenchError, match="neither a folder with a case"):
        read_case(tmp_path / "none")
    for path in folder.glob("identify*"):
        path.unlink()
    with pytest.raises(WorkbenchError, match="no recording to fit on"):
        read_case(folder)
    (folder / "case.toml").unlink()
    with pytest.raises(WorkbenchError, match=r"has no case.toml"):
        read_case(folder)


def test_two_files_for_one_role(folder: Path) -> None:
    (folder / "identify_open.csv").write_text("time_s,valve_V\n0,5\n1,6\n2,5\n")
    with pytest.raises(WorkbenchError, match="keep one of them"):
        read_case(folder)


def test_mapping_in_the_folder(folder: Path) -> None:
    (folder / "mapping.toml").write_text('[signals]\ntheta = "angle_deg"\n')
    assert read_case(folder).recordings["identify_open"].names == ("theta",)
