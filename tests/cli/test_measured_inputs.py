"""An input that nobody sets is a disturbance to every verb; what a loop leaves rests as told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.recordings.example import recorded
from tests.shell import Refused, Shell
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.experiment.menu import menu
from workbench.linearisation import linearise
from workbench.operating_point import operating_point
from workbench.physics.library import library
from workbench.plants.registry import PLANTS
from workbench.study.read import load_study
from workbench.study.tasks import execute, tasks

PLANT = """
from workbench.model import Input, Model, Output, Parameter, State

def boiler():
    def equations(m):
        flow = m.u.draw * (m.u.feed - m.x.T)
        return {"T": (m.u.power / m.p.rho_c + flow) / m.p.V}, {"T": m.x.T}
    return Model("boiler", equations,
        states=(State("T", "K", initial=320.0),),
        inputs=(
            Input("feed", "K", nominal=285.0, display_unit="degC", commanded=False),
            Input("power", "W", nominal=4e4, lower=0.0, upper=1e5, display_unit="kW"),
            Input("draw", "m3/s", nominal=3e-4, lower=1e-5, upper=1e-3, display_unit="l/min")),
        outputs=(Output("T", "K", display_unit="degC", noise_rms=0.1),),
        parameters=(
            Parameter("V", "m3", value=0.05, lower=0.01, upper=0.3, fitted=True),
            Parameter("rho_c", "J/(m3 K)", value=4.18e6)))
"""


@pytest.fixture
def folder(here: Path) -> Path:
    (here / "boilers.py").write_text(PLANT)
    return here


def test_a_feed_is_no_command(folder: Path) -> None:
    model = PLANTS.get("boilers:boiler", folder=folder).model()
    assert [q.name for q in model.commands] == ["power", "draw"]
    point = operating_point(model, {"T": 320.0})
    assert point["feed"] == 285.0
    # Its sensor may be wrong, but nothing limits or delays what nobody commands.
    offered = {h.name for h in library(model)}
    assert {n for n in offered if "feed" in n and n.startswith("sensor_")}
    assert not {n for n in offered if "feed" in n and n.startswith(("slew", "saturation", "dead"))}
    assert "slew_limit_power_command" in offered
    assert linearise(point, verdict=False).input_names == ("feed", "power", "draw")


def test_no_experiment_asks_for_a_feed(folder: Path) -> None:
    model = PLANTS.get("boilers:boiler", folder=folder).model()
    rng, time = np.random.default_rng(1), 10.0 * np.arange(400)
    ends = {"feed K": (280, 290), "power W": (2e4, 8e4), "draw m3/s": (2e-4, 6e-4)}
    held = {name: np.repeat(rng.uniform(*two, 20), 20) for name, two in ends.items()}
    run = recorded(time, held, {"T K": rng.uniform(290.0, 350.0, 400)})
    offered = menu(model, [observe(model, run)])
    assert offered and all(np.ptp(e.inputs[:, 0]) == 0.0 for e in offered)
    assert any(np.ptp(e.inputs[:, 1]) > 0.0 for e in offered)


@pytest.mark.long
def test_a_loop_is_designed_where_what_it_leaves_rests(folder: Path, shell: Shell) -> None:
    words = "verify --plant boilers:boiler --from 60degC --to 61degC --json"
    told = shell(words)
    runs = json.loads(told.out)["runs"]
    assert "what a design does not command rests, such as draw" in told.err
    assert len(runs) > 3
    for found in runs:
        assert found["metrics"]["command_lowest.draw"]["value"] == pytest.approx(3e-4)
        assert abs(found["metrics"]["steady_error"]["value"]) < 0.05, found["controller"]
        # At rest the loop stands where its linear model does: it begins without a bump.
        assert found["metrics"]["lowest"]["value"] > 333.15 - 0.5, found["controller"]


def test_plants_says_what_is_only_measured(folder: Path, shell: Shell, refused: Refused) -> None:
    told = shell("plants boilers:boiler").out
    assert "feed (°C, only measured), power (kW), draw (l/min)" in told
    refused("verify --plant boilers:boiler --feed 300K")


@pytest.mark.long
def test_a_step_that_nobody_sized_is_one_that_the_plant_can_hold(
    folder: Path, shell: Shell
) -> None:
    # All that 100 kW bring at the nominal draw is 365 K; a quarter of the range is beyond that.
    (folder / "boilers.py").write_text(PLANT.replace("nominal=4e4", "nominal=9e4"))
    (found,) = shell("verify --plant boilers:boiler -c plain-pid --json").result["runs"]
    assert found["metrics"]["highest"]["value"] < 285.0 + 1e5 / (4.18e6 * 3e-4)
    assert abs(found["metrics"]["steady_error"]["value"]) < 0.1


@pytest.mark.long
def test_commands_that_are_late_are_reckoned_with(
    folder: Path, shell: Shell, refused: Refused
) -> None:
    step = ["verify", "--plant", "boilers:boiler", "--from", "40degC", "--to", "60degC"]
    step += ["-c", "plain-pid", "--sample-time", "2s", "--json"]
    settled = []
    for late, told in ((), ""), (("--delay", "29s"), "late by 15 samples of 2 s, 30 s"):
        said = shell(*step, *late)
        assert told in said.err
        (found,) = json.loads(said.out)["runs"]
        assert found["metrics"]["overshoot"]["value"] < 0.2
        settled.append(found["metrics"]["settling_time"]["value"])
    # Nothing is seen of a command within its delay.
    assert settled[0] + 30.0 < settled[1] < 20.0 * 30.0
    # Where nobody says how often, a whole number of samples is as long as the delay.
    own = [part for part in step if part not in ("--sample-time", "2s")]
    assert "late by 20 samples of 1.47 s, 29.3 s" in shell(*own, "--delay 29.3s").err
    assert "delay" in refused(*step, "--delay -1s")
    assert "less than 1% of a sample, 2 s" in refused(*step, "--delay 5ms")


@pytest.mark.long
def test_a_delay_of_hours_is_of_as_many_samples_as_steps_reckon_with(shell: Shell) -> None:
    plant = ["verify", "--plant", "1/((5086*s+1)*(3600*s+1))", "--limit", "1"]
    said = shell(*plant, "-c", "lqi", "--delay", "2h", "--json")
    assert "late by 40 samples of 180 s" in said.err
    (found,) = json.loads(said.out)["runs"]
    assert found["metrics"]["overshoot"]["value"] < 0.05


@pytest.mark.long
def test_one_of_several_designs_that_does_not_suit_the_plant_is_a_run_that_failed(
    folder: Path, shell: Shell, refused: Refused
) -> None:
    words = "verify --plant boilers:boiler --from 60degC --to 61degC"
    refused(words, "-c angle-pd")
    said = shell(words, "-c plain-pid -c angle-pd", status=1).out
    assert "plain-pid on boiler" in said and "failed: angle-pd" in said
    assert "1 of 2 runs failed" in said


def test_a_run_starts_at_rest_and_says_so_or_where_the_plant_begins(
    folder: Path, shell: Shell, refused: Refused
) -> None:
    words = "simulate --plant boilers:boiler --power 0:40kW --duration 60s"
    assert "(T 43.75°C for 46.85°C): --initial starts there" in shell(words, "--out rest.csv").err
    assert not shell(words, "--initial --out begun.csv").err
    first = [np.loadtxt(f, delimiter=",", skiprows=1)[0, -1] for f in ("rest.csv", "begun.csv")]
    assert first == pytest.approx([316.897 - 273.15, 320.0 - 273.15], abs=1e-3)
    refused(words, "--initial --T 50degC")


def test_a_plant_that_does_not_rest_is_run_from_where_it_begins(
    folder: Path, shell: Shell, refused: Refused
) -> None:
    # What heats can be turned down, and not off.
    told = PLANT.replace("flow = m.u.draw *", "flow = 0.0 *")
    (folder / "boilers.py").write_text(told.replace("4e4, lower=0.0", "4e4, lower=1e4"))
    words = "simulate --plant boilers:boiler --power 0:41.8kW --out run.csv"
    assert "no operating point" in refused(words)
    assert "it starts at the initial values" in shell(words, "--duration 50s").err
    seen = np.loadtxt("run.csv", delimiter=",", skiprows=1)
    # 41.8 kW warm 50 l by 0.2 K/s.
    assert seen[[0, 500], -1] == pytest.approx([46.85, 51.85], abs=1e-3)


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_a_study_is_begun_with_a_plant_of_ones_own(folder: Path, shell: Shell) -> None:
    shell("new-study mine.toml --plant boilers:boiler")
    text = Path("mine.toml").read_text()
    assert "servo-axis" not in text and "mm" not in text.replace("comm", "")
    words = "compare mine.toml --out comparison --jobs 1"
    shell(words)
    results = json.loads(Path("comparison/results.json").read_text())
    assert results["passed"] and results["robustness"]
    assert {found["variation"] for found in results["runs"]} == {"nominal", "more V"}
    (folder / "boilers.py").write_text(PLANT.replace(", lower=0.01, upper=0.3, fitted=True", ""))
    shell("new-study fixed.toml --plant boilers:boiler")
    assert not any(execute(task).failed for task in tasks(load_study("fixed.toml")))


def test_what_rests_on_its_bound_is_pulsed_from_there(folder: Path, shell: Shell) -> None:
    (folder / "ovens.py").write_text(
        PLANT.replace("boiler", "oven").replace("nominal=4e4, lower=0.0", "lower=0.0")
    )
    words = "simulate --plant ovens:oven --pulses power=20kW --period 60s"
    shell(words, "--duration 120s --sample-time 1s --out run.csv")
    header = (folder / "run.csv").read_text().splitlines()[0].split(",")
    rows = np.loadtxt("run.csv", delimiter=",", skiprows=1)
    power = rows[:, next(i for i, name in enumerate(header) if "power" in name)]
    assert power.tolist() == np.tile(np.repeat([20.0, 0.0], 30), 2).tolist()
