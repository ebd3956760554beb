"""A mistake gets one clear sentence on the error stream, status 2, and leaves no file."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.shell import Refused, Shell
from workbench.cli.main import WRONG_USE

CASES: list[tuple[str, ...]] = [
    # what is typed, and parts of the one sentence
    ("linearise --angle 75", "angle is 75 deg", "-1 to 61 deg"),
    ("verify --to 62deg", "angle after the step is 62 deg", "-1 to 61 deg"),
    ("linearise --load 12kg", "load is 12 kg", "0 to 8 kg"),
    ("simulate --pulses 0.9 --load -1", "load is -1 kg", "0 to 8 kg"),
    (
        "linearise -p valve_conductanc=3e-8",
        "parameter is 'valve_conductanc'",
        "did you mean 'valve_conductance'",
    ),
    ("linearise -p critical_ratio=2", "critical_ratio is 2", "0.15 to 0.4"),
    ("linearise -p load", "has no value", "NAME=VALUE"),
    (
        "verify -c pid --require settling_time",
        "requirement 'settling_time' has no value",
        "NAME=VALUE",
    ),
    ("linearise --angle 30degr", "unit 'degr'", "did you mean 'deg'"),
    ("linearise --mean-pressure 3kg", "mean pressure '3kg'", "does not measure it", "3bar"),
    ("linearise --angle nan", "angle 'nan' is not a finite number"),
    ("simulate --valve 0:inf", "'inf' is not a finite number"),
    ("linearise --mean-pressure 1e999", "not a finite number"),
    ("linearise --load three", "load 'three' is not a number", "3kg"),
    # 8 kg held horizontal needs 30.8 N m; 6 bar give 52.6 N m there, so 2 bar hold half of it.
    (
        "linearise --plane vertical --angle 0 --load 8kg --supply 2bar",
        "8 kg",
        "possible would be load from 0 to 4.",
        "supply pressure from 3.5",
    ),
    ("linearise --plane sideways", "plane is 'sideways'", "vertical"),
    ("linearise --without frictoin", "effect is 'frictoin'", "bearing_friction"),
    (
        "linearise --plant servo-axis --effect cubic_dragg",
        "one of those that 'workbench plants servo-axis' lists; did you mean 'cubic_drag'?",
    ),
    ("verify -c pdi", "design is 'pdi'", "did you mean 'pid'"),
    ("linearise --supply 20bar", "supply pressure is 20 bar"),
    ("simulate", "no input is given", "--valve 0:1"),
    ("simulate --valve 0:12V", "valve is 12 V", "0 to 10 V"),
    ("simulate --valve 0:5,6", "no value", "TIME:VALUE", "0:6"),
    ("simulate --valve 0:5 --pulses 1", "both --valve and --pulses"),
    ("simulate --pulses 7V", "pulse height of valve is 7 V"),
    ("demo --data no-such-folder", "data folder 'no-such-folder' does not exist"),
    ("linearise --angel 30", "No such option: --angel", "linearise --help"),
    ("linearize", "linearize", "--help"),
    ("verify --from 15deg --from=20deg --to 45deg", "--from is given twice, '15deg' and '20deg'"),
    ("linearise --angle", "--angle", "--help"),
    ("diagnose", "there is nothing to work on"),
    ("diagnose nowhere", "neither a folder with a case nor one of"),
    ("diagnose nowhere.csv --hold-out b.csv", "there is no file nowhere.csv"),
    ("recording .", ". is a folder"),
    ("compare .", "study '.' is a folder", "--out"),
    ("diagnose practice-07 --fit a.csv", "keep one of them"),
    ("diagnose --fit a.csv --hold-out b.csv --plant robot", "plant is 'robot'"),
    ("diagnose --fit a.csv --hold-out b.csv --plant emps --load 3", "No such option: --load"),
    ("diagnose --fit a.csv --hold-out a.csv", "given twice"),
    ("diagnose --fit a.csv --hold-out b.csv", "a.csv"),
    ("diagnose practice-07 --time-limit 0", "time limit is 0"),
    ("diagnose practice-07 --time-limit 2min --quick", "--time-limit 120 is given too"),
    ("diagnose practice-07 --quick --time-limit 9", "keep one of them"),
    ("diagnose practice-07 --jobs 0", "number of processes is 0"),
    ("diagnose practice-07 --load 3V", "does not measure it"),
    ("refit practice-77", "neither a folder with a case nor one of"),
    ("refit emps --data nowhere", "does not exist"),
    ("force-map nowhere.csv", "nowhere.csv"),
    ("recording nowhere.csv", "nowhere.csv"),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case[0])
def test_one_sentence_and_status_2(case: tuple[str, ...], here: Path, shell: Shell) -> None:
    typed, *words = case
    out = "" if typed in ("linearize", "linearise --angle") else "--out result"
    said = shell(typed, out, status=WRONG_USE)
    assert said.out == "" and said.err.startswith("workbench: ")
    assert said.err.count("\n") == 1 and "Traceback" not in said.err
    assert [word for word in words if word not in said.err] == []
    assert not list(here.iterdir())


@pytest.mark.parametrize("typed", ["", "evaluate"])
def test_the_help_alone_answers_no_word_at_all(typed: str, shell: Shell) -> None:
    said = shell(typed, status=WRONG_USE)
    assert "--help" in said.out + said.err and "workbench: " not in said.err


@pytest.mark.parametrize("verb", ["demo", "linearise", "simulate --valve 0:5"])
def test_an_unwritable_place_is_one_sentence(verb: str, tmp_path: Path, refused: Refused) -> None:
    # A file in the way cannot be written into by anyone, the administrator included.
    (tmp_path / "file").write_text("precious")
    sentence = refused(verb, "--out", tmp_path / "file" / "out").splitlines()[-1]
    assert "cannot be written" in sentence and "where you may write" in sentence
    assert (tmp_path / "file").read_text() == "precious"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_without_permission_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    import tempfile

    def refuse(*args: object, **options: object) -> str:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(tempfile, "mkdtemp", refuse)
    assert "permission denied" in refused("demo --out", tmp_path / "out")


@pytest.mark.parametrize("verb", ["demo", "diagnose practice-07"])
def test_output_that_is_a_file_is_refused(verb: str, tmp_path: Path, refused: Refused) -> None:
    target = tmp_path / "out"
    target.write_text("precious")
    assert "is a file; give the name of a folder" in refused(verb, "--out", target)
    assert target.read_text() == "precious"


@pytest.mark.parametrize("verb", ["diagnose", "refit"])
def test_a_recording_of_another_machine_is_one_sentence(
    verb: str, tmp_path: Path, refused: Refused
) -> None:
    tank = tmp_path / "tank.csv"
    tank.write_text("time_s,u,level\n" + "".join(f"{4 * k},3.0,5.0\n" for k in range(200)))
    said = refused(verb, tank if verb == "diagnose" else f"--fit {tank}")
    assert "no output of 'arm'; it has: valve, level; wanted: angle" in said
    assert "name yours with --plant" in said


def test_a_data_folder_without_the_force_maps_is_refused(tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "data").mkdir()
    assert "holds no" in refused("demo --out", tmp_path / "out", "--data", tmp_path / "data")
    assert not (tmp_path / "out").exists()


def test_main_leaves_with_the_status(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from workbench.cli import main

    monkeypatch.setattr(sys, "argv", ["workbench", "linearise", "--angle", "75"])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == WRONG_USE
    assert "angle is 75 deg" in capsys.readouterr().err
