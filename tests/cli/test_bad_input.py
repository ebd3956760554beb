"""A mistake gets one clear sentence on the error stream, status 2, and leaves no file."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.shell import Shell
from workbench.cli.main import WRONG_USE

CASES: dict[str, tuple[str, tuple[str, ...]]] = {
    "angle outside": ("linearise --angle 75", ("angle is 75 deg", "-1 to 61 deg")),
    "angle of a verification": (
        "verify --to 62deg",
        ("angle after the step is 62 deg", "-1 to 61 deg"),
    ),
    "load outside": ("linearise --load 12kg", ("load is 12 kg", "0 to 8 kg")),
    "load of a run": ("simulate --pulses 0.9 --load -1", ("load is -1 kg", "0 to 8 kg")),
    "unknown parameter": (
        "linearise -p valve_conductanc=3e-8",
        ("parameter is 'valve_conductanc'", "did you mean 'valve_conductance'"),
    ),
    "parameter outside": ("linearise -p critical_ratio=2", ("critical_ratio is 2", "0.15 to 0.4")),
    "parameter without value": ("linearise -p load", ("has no value", "NAME=VALUE")),
    "requirement without value": (
        "verify -c pid --require settling_time",
        ("requirement 'settling_time' has no value", "NAME=VALUE"),
    ),
    "unknown unit": ("linearise --angle 30degr", ("unit 'degr'", "did you mean 'deg'")),
    "wrong unit": (
        "linearise --mean-pressure 3kg",
        ("mean pressure '3kg'", "does not measure it", "3bar"),
    ),
    "not finite": ("linearise --angle nan", ("angle 'nan' is not a finite number",)),
    "infinite": ("simulate --valve 0:inf", ("'inf' is not a finite number",)),
    "huge": ("linearise --mean-pressure 1e999", ("not a finite number",)),
    "not a number": ("linearise --load three", ("load 'three' is not a number", "3kg")),
    # 8 kg held horizontal needs 30.8 N m; 6 bar give 52.6 N m there, so 2 bar hold half of it.
    "unreachable trim": (
        "linearise --plane vertical --angle 0 --load 8kg --supply 2bar",
        ("8 kg", "possible would be load from 0 to 4.", "supply pressure from 3.5"),
    ),
    "unknown plane": ("linearise --plane sideways", ("plane is 'sideways'", "vertical")),
    "unknown effect": (
        "linearise --without frictoin",
        ("effect is 'frictoin'", "bearing_friction"),
    ),
    "unknown effect to attach": (
        "linearise --plant servo-axis --effect cubic_dragg",
        ("one of those that 'workbench plants servo-axis' lists; did you mean 'cubic_drag'?",),
    ),
    "unknown controller": ("verify -c pdi", ("design is 'pdi'", "did you mean 'pid'")),
    "supply outside": ("linearise --supply 20bar", ("supply pressure is 20 bar",)),
    "no input": ("simulate", ("no input is given", "--valve 0:1")),
    "voltage outside": ("simulate --valve 0:12V", ("valve is 12 V", "0 to 10 V")),
    "step without value": ("simulate --valve 5", ("no value", "TIME:VALUE", "0:5")),
    "two kinds of voltage": ("simulate --valve 0:5 --pulses 1", ("both --valve and --pulses",)),
    "pulses too high": ("simulate --pulses 7V", ("pulse height of valve is 7 V",)),
    "missing data folder": (
        "demo --data no-such-folder",
        ("data folder 'no-such-folder' does not exist",),
    ),
    "unknown option": ("linearise --angel 30", ("No such option: --angel", "linearise --help")),
    "unknown verb": ("linearize", ("linearize", "--help")),
    "an option twice": (
        "verify --from 15deg --from=20deg --to 45deg",
        ("--from is given twice, '15deg' and '20deg'",),
    ),
    "option without value": ("linearise --angle", ("--angle", "--help")),
}


@pytest.mark.parametrize("name", CASES)
def test_one_sentence_and_status_2(name: str, here: Path, shell: Shell) -> None:
    arguments, words = CASES[name]
    out = "" if name in ("unknown verb", "option without value") else "--out result"
    printed = shell(arguments, out, status=WRONG_USE)
    assert printed.out == ""
    assert printed.err.count("\n") == 1 and "Traceback" not in printed.err
    assert printed.err.startswith("workbench: ")
    for word in words:
        assert word in printed.err
    assert not list(here.iterdir())


@pytest.mark.parametrize("verb", ["demo", "linearise", "simulate --valve 0:5"])
def test_an_unwritable_place_is_one_sentence(verb: str, tmp_path: Path, shell: Shell) -> None:
    # A file in the way cannot be written into by anyone, the administrator included.
    (tmp_path / "file").write_text("precious")
    sentence = shell(verb, "--out", tmp_path / "file" / "out", status=WRONG_USE).err.splitlines()[
        -1
    ]
    assert "cannot be written" in sentence and "where you may write" in sentence
    assert (tmp_path / "file").read_text() == "precious"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_without_permission_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    import tempfile

    def refuse(*args: object, **options: object) -> str:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(tempfile, "mkdtemp", refuse)
    assert "permission denied" in shell("demo --out", tmp_path / "out", status=WRONG_USE).err


def test_demo_onto_a_file_is_refused(tmp_path: Path, shell: Shell) -> None:
    target = tmp_path / "demo"
    target.write_text("precious")
    assert (
        "is a file; give the name of a folder" in shell("demo --out", target, status=WRONG_USE).err
    )
    assert target.read_text() == "precious"


def test_a_data_folder_without_the_force_maps_is_refused(tmp_path: Path, shell: Shell) -> None:
    (tmp_path / "data").mkdir()
    assert (
        "holds no"
        in shell("demo --out", tmp_path / "out", "--data", tmp_path / "data", status=2).err
    )
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
