"""The verb `notebook`: a starter that runs as it stands, of any plant at any operating point."""

from __future__ import annotations

import json
import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from tests.shell import Refused
from workbench.cli.main import run

OWN = """
from workbench.model import Input, Model, Output, State


def tank(area_m2: float = 2.0) -> Model:
    def equations(m):
        return {"level": m.u.pump / area_m2 - 0.3 * m.x.level}, {"level": m.x.level}

    return Model(
        "tank",
        equations,
        states=(State("level", "m"),),
        inputs=(Input("pump", "m3/s"),),
        outputs=(Output("level", "m"),),
    )
"""


def written(out: Path, *words: str) -> str:
    """Return the code of the starter that a command writes."""
    assert run(["notebook", *words, "--out", str(out)]) == 0
    notebook = nbformat.read(out, as_version=4)
    nbformat.validate(notebook)
    assert out.read_text(encoding="utf-8") == nbformat.writes(notebook) + "\n"
    return "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")


def executed(out: Path) -> tuple[str, int]:
    """Return what a notebook prints, and how many pictures it shows."""
    notebook = nbformat.read(out, as_version=4)
    where = {"metadata": {"path": str(out.parent)}}
    NotebookClient(notebook, timeout=120, kernel_name="python3", resources=where).execute()
    shown = [out for cell in notebook.cells for out in cell.get("outputs", ())]
    pictures = sum("image/png" in out.get("data", {}) for out in shown)
    return "".join(out.get("text", "") for out in shown), pictures


@pytest.mark.long
@pytest.mark.system
def test_a_starter_of_the_arm_runs_as_it_stands(tmp_path: Path) -> None:
    out = tmp_path / "arm.ipynb"
    code = written(out, "--angle", "30deg", "--load", "3kg", "--hysteresis")
    assert "{'angle': to_si(30, 'deg')}" in code
    assert "options = {'load': '3 kg'}" in code
    assert "full = plant.model(options, effects=['hysteresis'])" in code
    printed, pictures = executed(out)
    assert "cascade PID on arm" in printed and "sliding mode on arm" in printed
    assert pictures == 2


def in_this_process(code: str) -> dict[str, object]:
    """Return the names that a notebook's code defines."""
    names: dict[str, object] = {}
    exec(compile(code.replace("%matplotlib inline", ""), "notebook", "exec"), names)
    return names


@pytest.mark.long
def test_a_starter_of_another_plant_runs_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["--plant", "servo-axis", "--position", "100mm", "-p", "mass=80kg"]
    code = written(tmp_path / "axis.ipynb", *words)
    assert "{'position': to_si(100, 'mm')}" in code
    assert "full = plant.model(options, parameters=['mass=80 kg'])" in code
    found = in_this_process(code)
    assert found["full"].parameter("mass").value == 80.0  # type: ignore[attr-defined]
    assert len(found["runs"]) >= 2  # type: ignore[arg-type]


@pytest.mark.long
def test_a_starter_of_a_plant_of_ones_own(here: Path) -> None:
    Path("starter_tank.py").write_text(OWN)
    code = written(Path("tank.ipynb"), "--plant", "starter_tank:tank", "--level", "0.5")
    found = in_this_process(code)
    assert found["point"]["pump"] == pytest.approx(0.3)  # type: ignore[index]
    assert len(found["runs"]) >= 2  # type: ignore[arg-type]


def test_a_plant_that_no_design_fits_gets_a_starter_without(here: Path) -> None:
    Path("still_tank.py").write_text(OWN.replace("m.u.pump / area_m2", "0.0 * m.u.pump"))
    assert "wb.verify" not in written(Path("tank.ipynb"), "--plant", "still_tank:tank")


@pytest.mark.long
@pytest.mark.parametrize("plant", ["cylinder", "pendulum", "two-valve-arm"])
def test_a_starter_tries_what_verify_tries(tmp_path: Path, plant: str) -> None:
    assert "wb.verify" in written(tmp_path / "starter.ipynb", "--plant", plant)


@pytest.mark.long
def test_a_starter_steps_and_samples_as_verify_does(here: Path) -> None:
    # Its step was sampled five times as slowly as its laws are, so that the notebook ended there.
    code = written(Path("drone.ipynb"), "--plant", "tests.cli.test_slow_plant:drone")
    (h,) = re.findall(r"duration=[\d.]+, sample_time=([\d.]+)\)", code)
    assert code.count(f"'sample_time': {h}}}") == 5


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("--angle 90deg", "angle is 90 deg"),
        ("--angel 30deg", "did you mean --angle?"),
        ("--out starter.txt", "does not end in .ipynb"),
        ("--out there.ipynb", "exists; give another name, nothing was changed"),
    ],
)
def test_a_mistake_writes_nothing(words: str, sentence: str, here: Path, refused: Refused) -> None:
    Path("there.ipynb").write_text(json.dumps({}))
    assert sentence in refused("notebook", words)
    assert [p.name for p in here.iterdir()] == ["there.ipynb"]
    assert Path("there.ipynb").read_text() == "{}"
