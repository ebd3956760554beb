"""The next input as a file, and played on a machine that hides something."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.shell import Refused, Shell
from workbench.diagnosis import diagnose as stages
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated_recording
from workbench.diagnosis.selection import task
from workbench.physics.library import library
from workbench.physics.stiffness import linear_spring
from workbench.plants.registry import PLANTS
from workbench.plants.servo_axis import servo_axis
from workbench.recordings.saving import write_recording

HIDING = """
from workbench.physics.friction import coulomb_friction
from workbench.plants.servo_axis import servo_axis

def axis():
    plain = servo_axis().without("coulomb_friction")
    # As where it was recorded before: small errors about rest last, and widen the interval.
    rubs = {"level": 20.0, "transition_speed": 1e-3, "upper": 90.0}
    return plain.with_effect(coulomb_friction("axis.force", **rubs, name="hidden"))

class Broken:
    def play(self, experiment):
        raise RuntimeError("the cable is off")

broken = Broken()
number = 3
"""


@pytest.fixture(scope="module")
def diagnosed_already(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two recordings of the axis; the first of the tests leaves its stages there."""
    folder = tmp_path_factory.mktemp("axis")
    (folder / "my_rig.py").write_text(HIDING)
    for seed in (1, 2):
        push = pushes(200, largest=200.0, seed=seed)
        made = simulated_recording(
            servo_axis(), push, sample_time=0.02, name=f"axis {seed}", seed=seed
        )
        write_recording(made, folder / f"{seed}.csv")
    return folder


@pytest.fixture
def given(diagnosed_already: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Two recordings of the axis and a model of it without dry friction; few effects to try."""
    monkeypatch.chdir(diagnosed_already)

    def few(*given: Any, **known: Any) -> Any:
        laws = ("coulomb_friction", "linear_spring")
        return [e for e in library(*given, **known) if e.law in laws]

    for place in (stages, task):
        monkeypatch.setattr(place, "library", few)
    plant = ["--plant", "servo-axis", "--without", "coulomb_friction", "--jobs", "1"]
    return ["diagnose", *plant, "--fit", "1.csv", "--hold-out", "2.csv", "--out", "out"]


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_the_next_input_is_written_and_played(
    given: list[str], diagnosed_already: Path, shell: Shell
) -> None:
    folder = diagnosed_already
    said = shell(*given, "--propose plan.csv --experiment my_rig:axis")
    assert "after the experiment: named: coulomb_friction" in said.out
    files = (folder / "out/verdict.json", folder / "out/experiment/verdict.json")
    first, second = (json.loads(file.read_text()) for file in files)
    assert first["findings"][0]["effect"] == second["findings"][0]["effect"] == "coulomb_friction"
    # More data: a smaller interval.
    spreads = [v["findings"][0]["parameters"]["level"]["std"] for v in (first, second)]
    assert spreads[1] < spreads[0]
    plan = (folder / "plan.csv").read_text()
    assert plan.startswith("time_s,force_N\n0,")
    assert plan == (folder / "out/experiment/plan.csv").read_text()
    assert (folder / "out/experiment/report.html").is_file()
    # What was recorded, a part of it held out, is read again.
    names = {row["recording"] for row in second["data"]}
    assert {"experiment, first part", "experiment, last part"} <= names
    samples = len(np.loadtxt(folder / "plan.csv", delimiter=",", skiprows=1))
    lines = (folder / "out/experiment/recording.csv").read_text().splitlines()
    assert sum(not line.startswith("#") for line in lines) == samples + 1


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("machine", "said"),
    [
        ("my_rig:broken", "the cable is off"),
        ("my_rig:number", "my_rig:number"),
        ("arm", "machine 'arm' has the inputs valve; what is diagnosed has force"),
    ],
)
def test_a_machine_that_cannot_be_played_on_is_one_sentence(
    given: list[str], machine: str, said: str, refused: Refused
) -> None:
    assert said in refused(*given, "--experiment", machine)


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_a_law_without_a_name_becomes_a_law_of_the_user(
    here: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    sprung = servo_axis().with_effect(linear_spring("axis.force", stiffness=200.0, upper=1000.0))
    for seed in (1, 2):
        push = pushes(400, largest=200.0, seed=seed)
        made = simulated_recording(sprung, push, sample_time=0.01, name=f"axis {seed}")
        write_recording(made, here / f"{seed}.csv")

    def without_springs(*given: Any, **options: Any) -> Any:
        every = library(*given, **options)
        return [h for h in every if h.name in ("stribeck_friction", "found")]

    for place in (stages, task):
        monkeypatch.setattr(place, "library", without_springs)
    asked = ["diagnose", "--plant", "servo-axis", "--jobs", "1"]
    asked += ["--fit", "1.csv", "--hold-out", "2.csv"]
    assert "has the shape of linear spring" in shell(*asked, "--out out").out
    assert "Shapes of the library" in (here / "out/report.html").read_text()
    monkeypatch.chdir(here / "out")
    there = [word.replace("1.csv", "../1.csv").replace("2.csv", "../2.csv") for word in asked]
    said = shell(*there, "--effects law:found --out again").out
    assert "named: Missing: found at axis.force, size -200" in said
    # The verdict is a plant, with the law of the user.
    (attached,) = PLANTS.get("again/verdict.json", folder=Path()).model().effects[-1:]
    assert attached.name == "found" and attached.ports == ("axis.force",)
    # So it is where the law was attached from the start.
    options = ["--effect", "law:found", "-p", "found.size=-200", "--out", "given"]
    shell(*there, *options)
    assert "found" in {e.name for e in PLANTS.get("given/verdict.json").model().effects}
