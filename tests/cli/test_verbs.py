"""Each verb does what its help says and prints numbers that an independent route gives."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.machines import machine
from tests.shell import Shell
from tests.study.small_study import small_study
from workbench.cli.main import INTERRUPTED
from workbench.cli.options import summary
from workbench.cli.plant import value_at_rest
from workbench.cli.simulate import simulate
from workbench.data_folder import shipped_folder
from workbench.model.units import quantity
from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.recordings import read_recording
from workbench.study.result import installed_version


@pytest.mark.parametrize(
    "verb", ["demo", "simulate", "linearise", "verify", "diagnose", "evaluate blind"]
)
def test_help_says_what_a_verb_does(verb: str, shell: Shell) -> None:
    text = shell(verb, "--help").out
    assert "--out" in text and "--help" in text and "Usage" in text


def test_a_paragraph_of_help_breaks_where_the_screen_ends() -> None:
    said = summary(simulate).split("\n\n")
    assert len(said) > 2 and not any("\n" in paragraph for paragraph in said)


def test_help_lists_the_verbs_and_where_to_start(shell: Shell) -> None:
    text = shell("--help").out
    for word in ("demo", "simulate", "linearise", "verify", "30deg"):
        assert word in text


def test_the_version_is_told(shell: Shell) -> None:
    assert shell("--version").out.strip() == f"workbench {installed_version()}"


def test_simulate_writes_a_recording_that_reads_back(tmp_path: Path, shell: Shell) -> None:
    out = tmp_path / "run.csv"
    steps = "--valve 0:5.6 --valve 500ms:4.4V"
    assert "tighter run" in shell("simulate", steps, "--duration 1s --out", out).out
    recording = read_recording(out)
    assert len(recording) == 500
    valve = recording["valve"]
    assert set(np.unique(valve)) == {4.4, 5.6}
    assert valve[249] == 5.6 and valve[250] == 4.4
    # The run starts at rest at 30 deg; the valve then fills muscle 1, which raises the angle.
    assert math.degrees(recording["angle"][0]) == pytest.approx(30.0, abs=1e-4)
    assert recording["angle"][250] > recording["angle"][0]


def test_simulate_uses_the_changed_plant(tmp_path: Path, shell: Shell) -> None:
    ends = []
    for load in ("3kg", "8kg"):
        shell("simulate --valve 0:5.9 --duration 0.3s --load", load, "--out", tmp_path / "a.csv")
        ends.append(read_recording(tmp_path / "a.csv")["angle"][-1])
    assert ends[0] > ends[1] + math.radians(1.0)


def test_linearise_writes_the_matrices(tmp_path: Path, shell: Shell) -> None:
    out = tmp_path / "linear.json"
    arguments = "linearise --angle 0.349066rad --mean-pressure 300kPa"
    assert "operating point of arm" in shell(arguments, "--out", out).out
    content = json.loads(out.read_text())
    # The paper's plant rests at 20 deg with 2.54 and 3.46 bar when both add up to 6 bar.
    assert content["outputs"]["pressure_1"] / 1e5 == pytest.approx(2.54, abs=0.01)
    assert content["outputs"]["pressure_2"] / 1e5 == pytest.approx(3.46, abs=0.01)
    # The swing of the arm with 3 kg, 1.7 to 2.3 Hz, must be among the poles of the matrix.
    poles = np.linalg.eigvals(np.array(content["A"]))
    swings = np.abs(poles[np.abs(poles.imag) > 1.0]) / (2 * math.pi)
    assert any(1.7 <= f <= 2.3 for f in swings)


def test_linearise_writes_for_matlab(tmp_path: Path, shell: Shell) -> None:
    from scipy.io import loadmat

    arguments = "linearise --plant servo-axis --out"
    for name in ("axis.mat", "axis.json"):
        shell(arguments, tmp_path / name)
    told = json.loads((tmp_path / "axis.json").read_text())
    found = loadmat(tmp_path / "axis.mat", simplify_cells=True, mat_dtype=True)
    for name in "ABCD":
        np.testing.assert_allclose(np.reshape(found[name], np.shape(told[name])), told[name])
    assert np.atleast_1d(found["states"]).tolist() == list(told["states"])


def test_linearise_uses_parameters_with_units(tmp_path: Path, shell: Shell) -> None:
    out = tmp_path / "linear.json"
    arguments = "linearise -p supply_pressure=5.5bar --without bearing_friction"
    shell(arguments, "--out", out)
    model = arm(3).without("bearing_friction").with_parameters({"supply_pressure": 5.5e5})
    point = operating_point(model, {"angle": math.radians(30)})
    found = json.loads(out.read_text())["outputs"]["pressure_1"]
    assert found == pytest.approx(point["pressure_1"], rel=1e-9)


@pytest.mark.usefixtures("undrawn")
def test_verify_scores_a_controller(tmp_path: Path, shell: Shell) -> None:
    text = shell("verify -c pid --hysteresis --out", tmp_path / "out").out
    assert "steady_error" in text and "verify passed: 5 of 5 hard requirements met" in text
    (found,) = json.loads((tmp_path / "out" / "results.json").read_text())["runs"]
    assert found["controller"] == "pid"
    assert found["metrics"]["steady_error"]["value"] < math.radians(0.3)
    # The page is that of any study, with the run on the linear model beside that on the plant.
    page = (tmp_path / "out" / "report.html").read_text()
    assert "workbench verify" in page and "step 15 to 45 deg and back" in page


def test_what_no_design_commands_rests(shell: Shell) -> None:
    said = shell("verify --plant pendulum --hold 1s")
    assert "rests, such as gain, supply, enabled" in said.err
    title, _, *rows = said.out.splitlines()
    assert title.startswith("servo pendulum, step") and any(r.startswith("plain-pid") for r in rows)


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_redesign_of_a_machine_that_is_no_arm(tmp_path: Path, shell: Shell) -> None:
    # Refitted, its force at rest is not zero.
    found = {"name": "servo-axis", "parameters": {"mass": 140.0, "offset": 5.0}}
    (tmp_path / "verdict.json").write_text(json.dumps({"plant": found}))
    arguments = ["redesign", str(tmp_path / "verdict.json"), "-f", "lqi", "--out"]
    said = shell(*arguments, tmp_path / "out").out
    title, _, *rows = said.splitlines()
    assert title == "servo axis, step 0 to 100 mm and back"
    assert rows[0].startswith("lqi, nominal") and rows[1].startswith("lqi, redesigned")
    assert (tmp_path / "out" / "lqi.c").exists()
    # Both have the colour of their family, each in a picture of its own.
    page = (tmp_path / "out" / "report.html").read_text()
    assert "tracking-1-part-2" in page
    # First of all, what knowing the machine is worth.
    assert page.index("What knowing the machine is worth") < page.index("Scenario step")
    assert page.index("versions") < page.index("tracking-1") and "Not drawn" not in page
    # No table without rows, and no article before a name.
    assert "Every requirement at its worst" not in page and "opened at position" in page
    runs = json.loads((tmp_path / "out" / "results.json").read_text())["runs"]
    rmse = {r["controller"]: r["metrics"]["rmse"]["value"] for r in runs}
    assert rmse["lqi, nominal"] != rmse["lqi, redesigned"]
    more = "--at position=100mm -f plain-pid"
    told = shell(*arguments, tmp_path / "there", more)
    assert "servo axis, step 100 to" in told.out
    # What takes time is told, for the nominal plant and for the machine.
    assert told.err.count("designs: 0 of") == 2 and "writing the report" in told.err


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("effect", ["sensor_delay_position", "delay_force"])
def test_a_delay_that_was_found_is_one_in_a_redesign(
    effect: str, tmp_path: Path, shell: Shell
) -> None:
    found = {"name": "servo-axis", "effects": [effect], "parameters": {f"{effect}.time": 0.04}}
    (tmp_path / "verdict.json").write_text(json.dumps({"plant": found}))
    said = shell("redesign", tmp_path / "verdict.json", "-f lqi --out", tmp_path / "out")
    assert f"commands are late by 40 ms, which is what {effect} comes to" in said.err
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Its commands are late by 40" in page
    assert "lqi, nominal: no margins; the table says why." in page
    kept = json.loads((tmp_path / "out" / "results.json").read_text())
    (scenario,) = kept["conditions"]["scenarios"].values()
    assert scenario["late_samples"] * scenario["sample_time"] == pytest.approx(0.04)
    settled = {r["controller"]: r["metrics"]["settling_time"]["value"] for r in kept["runs"]}
    assert settled["lqi, redesigned"] < 1.0 and settled["lqi, nominal"] is None
    step = shell("verify -c lqi --json --plant", tmp_path / "verdict.json")
    (found,) = step.result["runs"]
    assert found["metrics"]["settling_time"]["value"] == settled["lqi, redesigned"]


@pytest.mark.usefixtures("undrawn")
def test_a_redesign_is_run_until_its_loops_have_settled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    from workbench.study import step_trial

    found = {"name": "servo-axis", "effects": ["stribeck_friction"]}
    (tmp_path / "verdict.json").write_text(json.dumps({"plant": found}))
    monkeypatch.setattr(step_trial, "settling", lambda *_: step_trial.Needed(4.0, {}))
    out = tmp_path / "out"
    said = shell("redesign", tmp_path / "verdict.json", "-f lqi --out", out)
    # What was found is dry, and in no linear model.
    assert "stribeck_friction has no slope at rest" in said.err
    conditions = json.loads((out / "results.json").read_text())["conditions"]
    (scenario,) = conditions["scenarios"].values()
    (signal,) = scenario["references"].values()
    assert np.diff(signal["times"]).tolist() == [1.0, 4.0]


def test_a_number_at_rest_is_in_the_unit_that_its_quantity_declares() -> None:
    reactor = machine(
        lambda m: {"c": m.u.feed - 0.1 * m.x.c, "rotor": m.u.feed - m.x.rotor},
        "c mol/l, rotor rad/s display_unit=rpm",
        "feed mol/(l*s)",
        "c mol/l",
    )
    assert value_at_rest(reactor, "c=0.2") == ("c", pytest.approx(200.0))
    assert value_at_rest(reactor, "rotor=30") == ("rotor", pytest.approx(math.pi))
    assert value_at_rest(reactor, "rotor=2rad/s") == ("rotor", pytest.approx(2.0))


def test_a_run_goes_on_after_the_last_switch_of_an_input(shell: Shell) -> None:
    usual, longer = (
        float(re.search(r"0 to ([\d.]+) s", shell(f"simulate --plant pendulum {given}").out)[1])
        for given in ("--gain 0:1", "--gain 0:1,40s:0.5")
    )
    assert usual < 40.0 < longer


def test_verify_writes_controllers_as_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    monkeypatch.chdir(tmp_path)
    shell("new-controller my_law.py")
    said = shell("verify --plant servo-axis -c plain-pid -c my_law:design --c rig")
    assert "plain_pid.c and plain_pid.h: " in said.err
    # What one cannot do costs the other nothing.
    assert "cannot be written as C" in said.err
    header = (tmp_path / "rig" / "plain_pid.h").read_text(encoding="utf-8")
    assert "plain_pid_missed" in header and "m: 1 mm is 0.001" in header


def test_verify_says_when_a_requirement_is_missed(shell: Shell) -> None:
    # A controller designed for 1 kg moves eight times that inertia: it cannot stay within 10 %.
    arguments = "verify -c pid --load 8kg --design-load 1kg"
    assert "FAILED" in shell(arguments, "--to 55deg", status=1).out


def test_ctrl_c_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, shell: Shell
) -> None:
    import workbench.demo

    def interrupt(*args: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(workbench.demo, "run_demo", interrupt)
    said = shell("demo --out", tmp_path / "out", status=INTERRUPTED).err
    assert said.splitlines()[-1].startswith("workbench: interrupted")


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("30", "deg", 30.0),
        ("0.5 rad", "deg", 28.6478897565),
        ("300kPa", "bar", 3.0),
        ("-.5e1", "V", -5.0),
        ("2ms", "s", 0.002),
        ("3000 g", "kg", 3.0),
    ],
)
def test_values_carry_their_unit(text: str, unit: str, value: float) -> None:
    assert quantity("value", text, unit) == pytest.approx(value, rel=1e-10)


JSON = {
    "A": ["linearise --angle 30deg"],
    "runs": ["verify --plant servo-axis -c lqi"],
    "checks": ["recording", shipped_folder() / "practice-07" / "identify_open.csv.gz"],
    "requirements": ["compare small.toml --out out --jobs 1"],
}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("key", JSON)
def test_a_script_gets_json_and_nothing_else(
    key: str, here: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    small_study(here)
    printed = shell(*JSON[key], "--json")
    assert printed.result[key]
    # What a person reads is still there.
    assert len(printed.err.splitlines()) > 2


def test_a_shell_completes_verbs_and_options() -> None:
    program = "import sys; sys.argv = ['workbench']; from workbench.cli import main; main()"
    for words, wanted in (("workbench dia", "diagnose"), ("workbench compare --ba", "--baseline")):
        variables = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        told = {**os.environ, "_WORKBENCH_COMPLETE": "complete_bash", **variables}
        command = [sys.executable, "-c", program]
        found = subprocess.run(command, env=told, capture_output=True, text=True, check=False)
        assert found.stdout.split() == [wanted], found
