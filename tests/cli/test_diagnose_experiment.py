"""The next input as a file, and played on a machine that hides something."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.cli.main import WRONG_USE, run
from workbench.diagnosis import problem
from workbench.diagnosis.estimation.made_up import made_up_recording, pushes
from workbench.physics.library import library
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.saving import write_recording

HIDING = """
from workbench.physics.friction import coulomb_friction
from workbench.plants.servo_axis import servo_axis

def axis():
    plain = servo_axis().without("coulomb_friction")
    return plain.with_effect(coulomb_friction("axis.force", level=20.0, upper=90.0, name="hidden"))

class Broken:
    def play(self, experiment):
        raise RuntimeError("the cable is off")

broken = Broken()
number = 3
"""


@pytest.fixture
def given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Two recordings of the axis and a model of it without dry friction; few effects to try."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_rig.py").write_text(HIDING)
    for seed in (1, 2):
        push = pushes(300, largest=200.0, seed=seed)
        made = made_up_recording(
            servo_axis(), push, sample_time=0.01, name=f"axis {seed}", seed=seed
        )
        write_recording(made, tmp_path / f"{seed}.csv")

    def few(model: Any, *_: Any, **__: Any) -> Any:
        return [e for e in library(model) if e.law in ("coulomb_friction", "linear_spring")]

    monkeypatch.setattr(problem, "own_hypotheses", few)
    plant = ["--plant", "servo-axis", "--without", "coulomb_friction", "--jobs", "1"]
    return ["diagnose", *plant, "--fit", "1.csv", "--hold-out", "2.csv"]


def test_the_next_input_is_written_and_played(
    given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--propose", "plan.csv", "--experiment", "my_rig:axis", "--out", "out"]
    assert run([*given, *asked]) == 0
    said = capsys.readouterr()
    assert "after the experiment: named: coulomb_friction" in said.out
    first, second = (
        json.loads((tmp_path / "out" / where / "verdict.json").read_text())
        for where in (".", "experiment")
    )
    assert first["findings"][0]["effect"] == second["findings"][0]["effect"] == "coulomb_friction"
    # More data: a smaller interval.
    spreads = [v["findings"][0]["parameters"]["level"]["std"] for v in (first, second)]
    assert spreads[1] < spreads[0]
    plan = (tmp_path / "plan.csv").read_text()
    assert plan.startswith("time_s,force_N\n0,")
    assert plan == (tmp_path / "out/experiment/plan.csv").read_text()
    assert (tmp_path / "out/experiment/report.html").is_file()
    # What was recorded, a part of it held out, is read again.
    names = {row["recording"] for row in second["data"]}
    assert {"experiment, first part", "experiment, last part"} <= names
    samples = len(np.loadtxt(tmp_path / "plan.csv", delimiter=",", skiprows=1))
    lines = (tmp_path / "out/experiment/recording.csv").read_text().splitlines()
    assert sum(not line.startswith("#") for line in lines) == samples + 1


@pytest.mark.parametrize(
    ("machine", "said"),
    [
        ("my_rig:broken", "the cable is off"),
        ("my_rig:number", "my_rig:number"),
        ("arm", "machine 'arm' has the inputs valve; what is diagnosed has force"),
    ],
)
def test_a_machine_that_cannot_be_played_on_is_one_sentence(
    given: list[str], machine: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*given, "--experiment", machine]) == WRONG_USE
    text = capsys.readouterr().err
    assert said in text and "Traceback" not in text
