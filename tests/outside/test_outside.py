"""A package outside the workbench adds one member to every registry, seen in every verb.

The package stands installed on the path of a fresh interpreter: a module and the metadata with its
entry points, as an installer leaves them.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

pytestmark = pytest.mark.system

PACKAGE = Path(__file__).parent
ROOT = PACKAGE.parents[1]

STUDY = """
schema = 1
name = "hoist"

[plant]
kind = "outside-hoist"
mass = "5 kg"

[variations.braked]
effects = ["outside_cubic_brake"]
parameters = { "outside_cubic_brake.coefficient" = 3.0 }

[controllers.PD]
design = "outside-pd"
at = { height = 0.0 }
specification = { bandwidth = 6.0 }

[scenarios.lift]
duration = "3 s"
sample_time = "10 ms"

[scenarios.lift.references.height]
kind = "outside-lift"
unit = "m"
low = 0.0
high = 0.5
duration = 1.0

[[requirements]]
metric = "rmse"
limit = 0.2
unit = "m"

[[requirements]]
metric = "outside_peak_pull"
limit = 60.0
unit = "N"
"""


RUN_EACH = """
import json, sys
from workbench.cli.main import run
from workbench.diagnosis.selection import task
library, laws = task.library, sys.argv[2:]
if laws:
    task.library = lambda *of, **known: tuple(e for e in library(*of, **known) if e.law in laws)
for command in json.loads(sys.argv[1]):
    print("$", *command)
    if run(command):
        sys.exit(" ".join(command) + " failed")
"""


def _workbench(
    *commands: list[str], folder: Path, installed: bool = True, laws: tuple[str, ...] = ()
) -> str:
    """Run commands in one fresh interpreter, with some laws or all, and return what they print."""
    path = [str(PACKAGE)] * installed + [str(ROOT)]
    run = subprocess.run(
        [sys.executable, "-c", RUN_EACH, json.dumps(commands), *laws],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path), "COLUMNS": "120"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def _brake(x: npt.NDArray[np.float64], pull: float) -> npt.NDArray[np.float64]:
    """Rates of the real hoist: 5 kg, a viscous brake of 8 N s/m and one of 9 N s3/m3."""
    return np.array([x[1], (pull - 8.0 * x[1] - 9.0 * x[1] ** 3) / 5.0])


def _log(folder: Path, name: str, seed: int, n: int = 1200) -> Path:
    """Write a log of n samples, made by a fixed-step Runge-Kutta method of its own."""
    rng = np.random.default_rng(seed)
    h = 0.01
    pull = np.repeat(rng.uniform(-40.0, 40.0, n // 40), 40)
    x, height = np.zeros(2), np.zeros(n)
    for k in range(n):
        height[k] = x[0]
        for _ in range(4):
            d = h / 4
            a = _brake(x, pull[k])
            b = _brake(x + 0.5 * d * a, pull[k])
            c = _brake(x + 0.5 * d * b, pull[k])
            x = x + d / 6 * (a + 2 * b + 2 * c + _brake(x + d * c, pull[k]))
    height += 1e-4 * rng.standard_normal(n)
    rows = [f"{h * k:.4f};{pull[k]:.6f};{height[k]:.7f}" for k in range(n)]
    path = folder / f"{name}.hoist"
    path.write_text("\n".join(["time_s;pull_N;height_m", *rows]))
    return path


@pytest.mark.parametrize("installed", [True, False], ids=["entry points", "module:object"])
def test_every_verb_takes_what_an_outside_package_brings(installed: bool, tmp_path: Path) -> None:
    """The names of entry points, and the objects of a module that stands beside the data."""
    names = ("outside-hoist", "outside_cubic_brake", "outside-pd", "outside_peak_pull")
    if not installed:
        shutil.copy(PACKAGE / "outside_rig.py", tmp_path)
        names = tuple(f"outside_rig:{o}" for o in ("HOIST", "cubic_brake", "DESIGN", "METRIC"))
    plant, effect, design, metric = names
    logs = [_log(tmp_path, name, seed).name for seed, name in enumerate(("a", "b"))]
    (tmp_path / "mapping.toml").write_text('format = "outside_rig:FORMAT"\n')
    read = [] if installed else ["--mapping", "mapping.toml"]
    named = ["--plant", plant, "--option", "mass=5kg"]
    braked = ["--effect", effect, "-p", "outside_cubic_brake.coefficient=3"]
    commands = {
        "simulate": [*named, *braked, "--pull", "0:5", "--duration", "1s"],
        "linearise": named,
        "plants": [plant],
        "verify": [*named, *braked, "-c", design, "--to", "0.3m", "--sample-time", "10ms"]
        + ["--require", f"{metric}=60N", "--require", "settling_time=1.5s"],
        "recording": [logs[0], "--plant", plant, *read],
        "refit": [*named, *read, "--fit", logs[0], "--hold-out", logs[1], "--out", "refit"],
    }
    # Both read the same plant, effect, design, metric and format from then on.
    asked = commands if installed else ["plants", "verify", "recording"]
    said = _workbench(
        ["simulate", "--help"],
        *([verb, *commands[verb]] for verb in asked),
        # What an installed package measures is left out where a plant has no such signal.
        ["verify", "--plant", "servo-axis", "-c", "plain-pid"],
        folder=tmp_path,
        installed=installed,
    )
    assert installed == ("outside-hoist" in said.split("\n$ ")[0])
    parts = {part.split()[0]: part for part in said.split("\n$ ")[1:-1]}
    assert "1 to 20 kg" in parts["plants"]
    assert installed == ("outside_cubic_brake" in parts["plants"])
    assert "verify passed: 2 of 2" in parts["verify"]
    if installed:
        estimated = json.loads((tmp_path / "refit" / "results.json").read_text())["parameters"]
        assert {"mass", "brake"} <= set(estimated)


def test_every_kind_of_member_serves_in_a_study_and_its_page(tmp_path: Path) -> None:
    (tmp_path / "hoist.toml").write_text(STUDY)
    _workbench(
        ["compare", "hoist.toml", "--out", "out", "--jobs", "1"],
        ["report", "hoist.toml", "--bode", "--option", "mass=8kg", "--out", "heavier"],
        folder=tmp_path,
    )
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert "outside_peak_pull" in json.dumps(results)
    page = (tmp_path / "out" / "report.html").read_text()
    for shown in ("outside peak pull", "Outside figure", "braked"):
        assert shown in page


def test_a_law_and_a_format_serve_in_a_diagnosis(tmp_path: Path) -> None:
    logs = [_log(tmp_path, name, seed, 400) for seed, name in enumerate(("a", "b"))]
    _workbench(
        ["diagnose", "--plant", "outside-hoist", "--option", "mass=5kg"]
        + ["--fit", str(logs[0]), "--hold-out", str(logs[1]), "--out", "out", "--jobs", "1"],
        folder=tmp_path,
        laws=("outside_cubic_brake", "quadratic_drag", "linear_spring", "sensor_lag"),
    )
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert verdict["verdict"].startswith("named")
    finding = verdict["findings"][0]
    assert "outside_cubic_brake" in (finding["effect"], *finding["class"])
    assert "outside_cubic_brake" in (tmp_path / "out" / "report.html").read_text().replace(" ", "_")
