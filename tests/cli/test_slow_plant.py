"""A process of hours is tried over hours: no default is that of a fast machine."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controllers.design import DESIGNS
from controllers.plain.limits import LoopSpecification
from controllers.plain.loop import loop_of
from controllers.plain.selection import settled_after
from tests.controllers.families import designed
from tests.machines import machine
from tests.shell import Refused, Shell
from workbench.linearisation import LinearModel, linearise
from workbench.linearisation.first_step import _reached
from workbench.linearisation.time_scales import reach_of, step_time, usual_sample_time
from workbench.model import Input, Model, Output, State
from workbench.operating_point import operating_point
from workbench.study import step_trial
from workbench.study.designs import ControllerRecipe
from workbench.study.plants import PlantRecipe
from workbench.study.step_trial import StepTrial
from workbench.verification import metrics, step_scenario, verify

PLANT = """
from workbench.model import Input, Model, Output, Parameter, State

def oven(capacity_kJ: float = 5.0):
    def equations(m):
        heat = m.port("coil.heat", m.p.power * m.u.duty - m.p.loss * m.x.rise, unit="W",
                      scale=100.0, signals={"rise": m.x.rise}, disturbance=2.0)
        return {"rise": heat / m.p.capacity}, {"rise": m.x.rise}
    return Model("oven", equations,
        states=(State("rise", "K", 50.0),),
        inputs=(Input("duty", "1", lower=0.0, upper=1.0),),
        outputs=(Output("rise", "K", 50.0, noise_rms=0.05),),
        parameters=(
            Parameter("power", "W", value=300.0, lower=100.0, upper=600.0, fitted=True),
            Parameter("loss", "W/K", value=2.0, lower=0.1, upper=10.0, fitted=True),
            Parameter("capacity", "J/K", value=1e3 * capacity_kJ)))
"""


@pytest.fixture
def oven(here: Path) -> list[str]:
    """The plant, in a module beside a recording of less than half of its time constant."""
    (here / "ovens.py").write_text(PLANT)
    rng = np.random.default_rng(1)
    duty, rise = np.repeat(rng.uniform(0.0, 1.0, 20), 50), np.zeros(1000)
    for k in range(999):
        rise[k + 1] = rise[k] + (300.0 * duty[k] - 2.0 * rise[k]) / 5000.0
    table = np.c_[np.arange(1000.0), duty, rise + rng.normal(0.0, 0.05, 1000)]
    np.savetxt("a.csv", table, delimiter=",", header="time_s,duty,rise_K", comments="")
    return ["--plant", "ovens:oven"]


def test_a_step_is_run_until_it_shows(oven: list[str], shell: Shell) -> None:
    words = ["verify", *oven, "-c", "lqi", "--from", "20K", "--to", "40K", "--json"]
    (found,) = shell(*words, "--require settling_time=5000s").result["runs"]
    assert found["metrics"]["rise_time"]["value"] > 50.0


def test_times_of_hours_are_told_in_hours(oven: list[str], shell: Shell) -> None:
    words = ["verify", *oven, "--capacity", "50kJ", "-c", "lqi", "--from", "20K", "--to", "40K"]
    told = shell(*words, "--json")
    (found,) = json.loads(told.out)["runs"]
    hours = found["metrics"]["rise_time"]["value"] / 3600.0
    said = " ".join(told.err.split())
    assert f"rise_time {hours:.4g} h" in said
    assert f"iae {found['metrics']['iae']['value'] / 3600.0:.4g} K h" in said


@pytest.mark.parametrize("sampled", ["", "--sample-time 7.2s"])
@pytest.mark.parametrize(("on", "off"), [(73.0, 74.0), (80.0, 100.0), (60.0, 600.0), (0.4, 0.7)])
def test_an_input_switches_when_it_is_told_to_whatever_the_sample_time(
    oven: list[str], shell: Shell, sampled: str, on: float, off: float
) -> None:
    steps = f"--duty 0:0,{on}s:1,{off}s:0 --duration 2h --out run.csv"
    shell("simulate", *oven, steps, sampled)
    time, duty, rise = np.loadtxt("run.csv", delimiter=",", skiprows=1).T
    assert len(time) < 20001 and (len(time) == 1000 or not sampled)
    assert np.array_equal(duty, (time > on - 1e-9) & (time < off - 1e-9))
    heated, left = (np.maximum(time - at, 0.0) / 2500.0 for at in (on, off))
    assert rise == pytest.approx(150.0 * (np.exp(-left) - np.exp(-heated)), abs=1e-5)


def test_a_recording_may_be_short_beside_the_plant(
    oven: list[str], shell: Shell, refused: Refused
) -> None:
    # Its inputs move it by most of what was read, long before its time constant.
    said = shell("recording a.csv", *oven, "--capacity 5").out
    assert "time base" in said and "doubtful" not in said
    assert "name it with --plant" in refused("recording a.csv --capacity 5")


@pytest.mark.long
def test_a_loop_that_is_slower_than_the_plants_poles_is_run_until_it_settles(
    here: Path, shell: Shell
) -> None:
    # The only pole that decays is that of the motor, 20 ms; the ball rolls for seconds.
    (here / "balls.py").write_text(
        """
from workbench.model import Input, Model, Output, State

def ball():
    return Model("ball",
        lambda m: ({"x": m.x.v, "v": 7.0 * m.x.tilt, "tilt": 50.0 * (m.u.asked - m.x.tilt)},
                   {"x": m.x.x}),
        states=(State("x", "m", 0.1), State("v", "m/s", 0.2), State("tilt", "rad", 0.1)),
        inputs=(Input("asked", "rad", 0.1, lower=-0.2, upper=0.2),),
        outputs=(Output("x", "m", 0.1, noise_rms=5e-4),))
"""
    )
    words = "verify --plant balls:ball -c lqi --from 0m --to 0.1m"
    (found,) = shell(words, "--require settling_time=10s --json").result["runs"]
    assert found["metrics"]["settling_time"]["value"] > 0.2
    shell(words, "--require settling_time=10s --hold 0.2s", status=1)


def test_a_slow_output_beside_a_fast_one_is_run_until_it_settles(here: Path, shell: Shell) -> None:
    (here / "boilers.py").write_text(
        "import control\n"
        "G = control.tf([[[-8.0, 1.0], [0.0]], [[0.0], [1.0]]],"
        " [[[25.0, 10.0, 1.0], [1.0]], [[1.0], [0.5, 1.0]]])\n"
    )
    runs = shell("verify --plant boilers:G -c lqi --json").result["runs"]
    slow, fast = (run["metrics"] for run in runs)
    assert slow["y_0.settling_time"]["value"] > 10.0 > fast["y_1.settling_time"]["value"]


def test_a_step_that_takes_all_of_a_command_is_run_until_it_settles(
    here: Path, shell: Shell
) -> None:
    # The shaft swings at 21 Hz, and all of the torque takes half a second to the speed.
    (here / "drives.py").write_text(
        """
import numpy as np
from workbench.model import Input, Model, Output, State

def two_masses():
    def equations(m):
        shaft = 300.0 * m.x.twist + 0.2 * (m.x.motor - m.x.load)
        rub = 0.5 * np.tanh(m.x.load / 0.05) + 0.02 * m.x.load
        rates = {"motor": (m.u.torque - shaft - 0.01 * m.x.motor) / 0.02}
        rates |= {"load": (shaft - rub) / 0.1, "twist": m.x.motor - m.x.load}
        return rates, {"n": m.x.load}

    return Model("two masses", equations,
        states=(State("motor", "rad/s"), State("load", "rad/s"), State("twist", "rad")),
        inputs=(Input("torque", "N m", lower=-20.0, upper=20.0),),
        outputs=(Output("n", "rad/s", noise_rms=0.02),))
"""
    )
    (found,) = shell("verify --plant drives:two_masses -c lqi --json").result["runs"]
    assert 0.4 < found["metrics"]["settling_time"]["value"] < 0.7


def greenhouse() -> Model:
    """Air that is warm within minutes, above soil that takes half a day."""
    return machine(
        lambda m: {
            "air": (m.u.heat - 600.0 * m.x.air - 900.0 * (m.x.air - m.x.soil)) / 4e5,
            "soil": 900.0 * (m.x.air - m.x.soil) / 8e6,
        },
        "air K scale=5, soil K scale=5",
        "heat W 0 20000 6000 scale=5000",
        "air K 0.05 scale=5",
    )


def test_what_is_fast_on_a_slow_plant_is_sampled_as_fast_and_tried_no_longer() -> None:
    linear = linearise(operating_point(greenhouse()), verdict=False)
    assert step_time(linear) == 2e5
    assert usual_sample_time(linear) == 200.0
    h = usual_sample_time(linear, ["air"])
    assert 0.01 < h * 1500.0 / 4e5 < 0.1
    law = designed("plain-sliding-mode", linear, sample_time=h)
    # The soil is a zero, slower than the loop.
    assert settled_after(law, linear, {"air": 5.0}) < 1000.0


def test_a_fast_loop_of_a_slow_plant_is_run_no_longer_than_it_needs(
    here: Path, shell: Shell
) -> None:
    lossless = PLANT.replace("2.0, lower=0.1", "0.02, lower=0.001")
    (here / "ovens.py").write_text(lossless.replace("lower=0.0", "lower=-1.0"))
    # The oven alone takes 9 d to settle; all of its power heats or cools it within 6 min.
    words = "verify --plant ovens:oven -c lqi --from 20K --to 40K"
    told = shell(words, "--json").result
    assert 300.0 < told["runs"][0]["metrics"]["settling_time"]["value"] < 1500.0
    assert told["work"]["integrator_steps"] < 20000


def poisoned() -> Model:
    """A quick power, most of which is lost over a day to what the power makes slowly."""
    return machine(
        lambda m: (
            {"quick": m.u.rod - m.x.quick, "slow": (m.u.rod - m.x.slow) / 1e5},
            {"power": m.x.quick - 0.8 * m.x.slow},
        ),
        "quick 1 scale=1, slow 1 scale=1",
        "rod 1 -1 1 scale=1",
        "power 1 0.001 scale=0.5",
    )


def test_a_step_that_takes_most_of_a_command_in_the_end_is_held_for_few_samples() -> None:
    machine = PlantRecipe(f"{__name__}:poisoned")
    trial = StepTrial(machine, ControllerRecipe("", "", machine, ()), designs=("lqi",))
    _, (scenario, *_) = trial.prepared()
    # As long as the slow part takes, with samples that show the quick one: 2.25 million.
    assert 10_000 < scenario.samples < 15_000


def test_a_design_that_leaves_a_command_at_rest_is_said_where_others_leave_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    two = [DESIGNS.get(name) for name in ("plain-pid", "lqi")]
    monkeypatch.setattr(step_trial, "designs_for", lambda linear: two)
    machine, said = PlantRecipe(f"{__name__}:three_heaters"), list[str]()
    base = ControllerRecipe("", "", machine, ())
    recipes, _ = StepTrial(machine, base, say=said.append).prepared()
    assert [made.name for made in recipes] == ["lqi"]
    assert "plain-pid: leaves c at rest, and is left out; -c plain-pid runs it" in said


def three_heaters() -> Model:
    return machine(
        lambda m: (
            {"x": m.u.a + 0.1 * m.u.c - m.x.x, "y": m.u.b + 0.1 * m.u.c - 2.0 * m.x.y},
            {"x": m.x.x, "y": m.x.y},
        ),
        "x 1, y 1",
        "a 1 -1 1, b 1 -1 1, c 1 -1 1",
        "x 1, y 1",
    )


class Proportional:
    """A controller of somebody's own, which says nothing of when it settles."""

    name, sample_time, preview = "P", 0.002, 0
    sensors = controlled = ("power",)
    actuators = ("rod",)

    def initial_state(self, measurement: tuple[float, ...]) -> None: ...

    def step(
        self, state: None, measurement: tuple[float, ...], reference: tuple[float, ...]
    ) -> Any:
        return (2.0 * (reference[0] - measurement[0]),), None, {}

    def linear_command(self, command: Any) -> Any:
        return command


def proportional(linear: LinearModel, specification: object) -> Proportional:
    return Proportional()


def test_an_own_law_is_run_on_a_slow_plant_for_seconds_of_computing_and_that_is_said() -> None:
    machine, said = PlantRecipe(f"{__name__}:poisoned"), list[str]()
    own = (f"{__name__}:proportional",)
    base = ControllerRecipe("", "", machine, ())
    _, (scenario, *_) = StepTrial(machine, base, own, say=said.append).prepared()
    # The plant takes 200 million samples of that controller.
    assert scenario.samples == 450_000
    assert any("--hold" in sentence for sentence in said)


def test_a_heater_that_rests_near_its_end_is_as_fast_as_its_power() -> None:
    oven = machine(
        lambda m: {"rise": (300.0 * m.u.duty - 0.02 * m.x.rise) / 5e3},
        "rise K scale=50",
        "duty 1 0 1",
        "rise K 0.05 scale=50",
    )
    linear = linearise(operating_point(oven, {"rise": 20.0}), verdict=False)
    h = usual_sample_time(linear, ["rise"])
    law = designed("plain-pid", linear, sample_time=h)
    warmer = step_scenario("rise", 20.0, 40.0, hold=5000.0, sample_time=h)
    found = metrics(verify(law, oven, warmer))
    # 20 K take 333 s at all of the power. What overshoots cools for hours.
    assert found["settling_time"].value < 600.0 and found["overshoot"].value < 0.02


def test_a_loop_far_slower_than_its_plant_is_not_waited_for(
    oven: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    # Without a page nobody sees the linear model beside the plant.
    monkeypatch.delattr("workbench.verification.loop.LinearPlant")
    (tmp_path / "slow.py").write_text(
        "from controllers.plain.transfer_law import pid_by_hand\n"
        "def design(linear, specification):\n"
        "    told = {'measured': 'rise', 'actuator': 'duty', 'upper': 1.0, 'sample_time': 0.2}\n"
        "    return pid_by_hand(0.0, 1e-5, **told)\n"
    )
    words = ["verify", *oven, "-c", "slow:design", "--from", "20K", "--to", "40K"]
    told = shell(*words, "--sample-time 200ms --json")
    assert re.search(r"slow:design settles in [\d.]+ h, later than .*--hold [\d.]+h runs", told.err)
    (found,) = json.loads(told.out)["runs"]
    assert found["metrics"]["settling_time"]["value"] is None


FURNACE = """
from workbench.model import Input, Model, Output, State

def furnace():
    def equations(m):
        loss = 9e-9 * (m.x.T**4 - 300.0**4)
        lining = 40.0 * (m.x.T - m.x.lining)
        return {
            "T": (m.u.power - loss - lining) / 1.95e5,
            "lining": (lining - 15.0 * (m.x.lining - 300.0)) / 1.8e5,
        }, {"T": m.x.T}

    return Model("furnace", equations,
        states=(State("T", "K", 1500.0, initial=1500.0), State("lining", "K", initial=1100.0)),
        inputs=(Input("power", "W", nominal=6e4, lower=0.0, upper=2.5e5),),
        outputs=(Output("T", "K", noise_rms=1.0),))

def leaning():
    def equations(m):
        return {"lean": m.x.rate, "rate": 9.8 * m.x.lean + 25.0 * m.x.fork,
            "fork": 10.0 * (m.u.steer - m.x.fork)}, {"lean": m.x.lean}
    return Model("leaning", equations,
        states=(State("lean", "rad", 0.1), State("rate", "rad/s", 0.3), State("fork", "rad", 0.1)),
        inputs=(Input("steer", "rad", lower=-0.7, upper=0.7),),
        outputs=(Output("lean", "rad", noise_rms=0.002),))
"""


@pytest.mark.parametrize(
    ("plant", "noise", "most"), [("furnace", 1.0, 800.0), ("leaning", 0.002, 3.0)]
)
def test_a_step_of_what_is_large_or_noisy_is_sampled_so_and_goes_so_far_that_it_settles(
    plant: str, noise: float, most: float, here: Path, shell: Shell
) -> None:
    (here / "shop.py").write_text(FURNACE)
    (found,) = shell("verify --plant", f"shop:{plant}", "-c lqi --json").result["runs"]
    assert found["metrics"]["settling_time"]["value"] < most
    before, after = re.findall(r"[\d.]+", found["scenario"])
    assert float(after) - float(before) > 40.0 * noise


def drum() -> Model:
    """A drum between 0 and 2 m that a pump empties in minutes: all that it does is integrate."""
    return Model(
        "drum",
        lambda m: ({"h": (m.u.inflow - m.u.pump) / 3.0}, {"h": m.x.h}),
        states=(State("h", "m", initial=1.0, lower=0.0, upper=2.0),),
        inputs=(
            Input("pump", "m3/s", lower=0.0, upper=0.02),
            Input("inflow", "m3/s", nominal=0.01, commanded=False),
        ),
        outputs=(Output("h", "m", noise_rms=0.005),),
    )


def upright() -> Model:
    """A body on two wheels: what grows within 0.2 s moves far in the time of its rest."""
    return machine(
        lambda m: {
            "way": m.x.speed,
            "speed": 0.385 * m.u.torque - 0.24 * m.x.speed - 10.0 * m.x.pitch,
            "pitch": m.x.rate,
            "rate": 28.3 * m.x.pitch - 0.645 * m.u.torque + 0.34 * m.x.speed,
        },
        "way m, speed m/s, pitch rad, rate 1/s",
        "torque N m -60 60",
        "way m 0.001, pitch rad 0.002",
    )


def drone() -> Model:
    """A rotor that lifts: a fast lag, two integrators and a drag that hardly counts."""
    return machine(
        lambda m: {
            "z": m.x.v,
            "v": m.x.thrust / 1.2 - 9.81 - 0.07 * m.x.v,
            "thrust": (36.0 * m.u.throttle - m.x.thrust) / 0.06,
        },
        "z m 1, v m/s, thrust N",
        "throttle 1 0 1",
        "z m 0.01",
    )


@pytest.mark.parametrize(
    ("plant", "most", "time"), [(drum, 2.0, 2000.0), (upright, 3.0, 100.0), (drone, 10.0, 100.0)]
)
def test_what_integrates_goes_as_far_as_it_is_led_in_a_good_loop(
    plant: Callable[[], Model], most: float, time: float
) -> None:
    # A drum was told of 2 s, in which it moves by 7 mm; the others to step 4e21 m and 150 m.
    linear = linearise(operating_point(plant()), verdict=False)
    assert 0.2 * most < reach_of(linear, linear.output_names[0]) <= 1.001 * most
    assert step_time(linear) == time
    # What the equations tell of its size makes no more noise of it than its sensor has.
    (noise,) = LoopSpecification().loop_noise(loop_of(linear, linear.output_names[0]))
    assert noise == linear.operating_point.model.outputs[0].noise_rms


def test_what_stands_still_at_the_end_of_its_command_steps_to_where_it_can() -> None:
    oven = machine(
        lambda m: {"T": (300.0 - m.x.T - 20.0 * m.u.cooling) / 600.0},
        "T K",
        "cooling 1 0 1",
        "T K 0.01",
    )
    linear = linearise(operating_point(oven), verdict=False)
    assert _reached(oven, linear, "T", 5.0, {"T": 300.0}) == -5.0


def test_a_step_goes_no_farther_than_the_plant_can_rest_however_little_that_is() -> None:
    pot = machine(
        lambda m: ({"cold": (m.u.jacket - m.x.cold) / 900.0}, {"excess": 1e-3 * m.x.cold}),
        "cold 1 2",
        "jacket 1 0 5 2",
        "excess 1 1e-05 scale=1",
    )
    linear = linearise(operating_point(pot), verdict=False)
    step = _reached(pot, linear, "excess", 1.0, {"excess": 2e-3}, "jacket")
    assert 1e-4 < abs(step) < 3e-3


def test_a_short_run_of_a_slow_plant_is_sampled_as_it_lasts(
    tmp_path: Path, shell: Shell, refused: Refused
) -> None:
    words = "simulate --plant 1/((s+1)(1e6s+1)) --input u=0:1 --duration"
    file = tmp_path / "run.csv"
    shell(words, "3s", "--out", file)
    assert len(file.read_text().splitlines()) >= 200
    assert "duration is -3 s" in refused(words, "-3s")
