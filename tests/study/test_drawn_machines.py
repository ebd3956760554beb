"""Machines that differ from what designs know, by what their plant declares."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.shell import Shell
from workbench.study.drawn_machines import differences, drawn, each
from workbench.study.plants import PlantRecipe

PLANT = """
from workbench.model import Input, Model, Output, Parameter, State

def bath(volume_m3=0.05):
    return Model(
        "bath",
        lambda m: (
            {"warmth": (m.u.heat - m.p.loss * (m.x.warmth - m.p.room)) / (4.18e6 * volume_m3)},
            {"warmth": m.x.warmth},
        ),
        states=(State("warmth", "K", initial=293.15),),
        inputs=(Input("heat", "W", lower=0.0, upper=3000.0, nominal=600.0),),
        outputs=(Output("warmth", "K", display_unit="degC", noise_rms=0.01),),
        parameters=(Parameter("loss", "W/K", value=20.0), Parameter("room", "K", value=293.15)),
    )
"""

FLAP = """
from workbench.model import Input, Model, Output, State

def flap():
    def equations(m):
        torque = 0.4 * m.x.i - 0.3 * m.x.angle - 0.03 * m.x.speed
        dropped = 1.8 * m.x.i + 0.4 * m.x.speed
        rates = {"angle": m.x.speed, "speed": 500 * torque, "i": 500 * (m.u.volts - dropped)}
        return rates, {"angle": m.x.angle}

    return Model(
        "flap",
        equations,
        states=(State("angle", "rad"), State("speed", "rad/s"), State("i", "A")),
        inputs=(Input("volts", "V", lower=-12.0, upper=12.0),),
        outputs=(Output("angle", "rad"),),
    )
"""


@pytest.fixture
def bath(here: Path) -> PlantRecipe:
    (here / "my_bath.py").write_text(PLANT)
    return PlantRecipe("my_bath:bath", folder=here)


def test_what_may_differ_follows_from_the_plant(bath: PlantRecipe) -> None:
    found = {one.name: one for one in differences(bath, ["warmth"], 1.0)}
    assert found["sensor_lag_warmth"].told(1e-3) == "10 ms"
    assert {"loss", "volume", "noise", "delay_heat_command", "sensor_lag_warmth"} <= set(found)
    # Temperatures have no part of themselves; a loop cannot see what falsifies its own sensor.
    assert not {"room", "sensor_offset_warmth", "sensor_gain_warmth"} & set(found)
    less = found["loss"].made(bath, -1.0, 0.0).build()
    assert less.parameter("loss").value == pytest.approx(16.0)
    assert dict(found["volume"].made(bath, 0.5, 0.0).options)["volume"] == pytest.approx(0.055)
    assert found["noise"].made(bath, 1.0, 0.0).noise == 2.0
    machines = {one.name: one for one in each(bath, tuple(found.values()))}
    assert {"loss 16 W/K", "loss 24 W/K", "noise x 2", "volume 0.06 m³"} <= set(machines)
    for machine in machines.values():
        assert machine.plant != bath and machine.plant.build().parameters


def test_no_machine_runs_away_by_itself_that_rests_without_a_difference(here: Path) -> None:
    (here / "my_flap.py").write_text(FLAP)
    flap = PlantRecipe("my_flap:flap", folder=here)
    names = {one.name for one in differences(flap, ["angle"], 2e-3)}
    assert {"delay_volts_command", "drive_lag_volts_command"} <= names
    # Its own drop of voltage, ten milliseconds late, would make a coil of one millisecond grow.
    assert not {"delay_i_rate", "drive_lag_i_rate"} & names


@pytest.mark.long
def test_a_plant_that_says_what_it_tolerates_is_taken_at_its_word() -> None:
    ends = {one.name: one for one in differences(PlantRecipe(), ["angle"], 0.002)}
    more = ends["load"].made(PlantRecipe(), 1.0, 0.0)
    assert dict(more.parameters)["load"] == pytest.approx(5.0) and "lever_arm" not in ends


def test_machines_are_drawn_again_for_the_same_seed(bath: PlantRecipe) -> None:
    found = differences(bath, ["warmth"], 1.0)
    machines = list(drawn(bath, found, 8, 5))
    assert machines == list(drawn(bath, found, 8, 5)) != list(drawn(bath, found, 8, 6))
    assert [len(one.differs) for one in machines[:4]] == [1, 3, 1, 3]


@pytest.mark.long
def test_designs_run_on_machines_that_differ(bath: PlantRecipe, shell: Shell) -> None:
    words = "controllers --plant my_bath:bath -f lqi --jobs 1 --blind"
    words += " --draws 2 --out"
    said = shell(words, "table").out
    assert "Machines that differ: 2" in said and "of 2" in said
    table = json.loads(Path("table/results.json").read_text())
    assert {r["variation"] for r in table["runs"]} == {"nominal", "machine 1", "machine 2"}
    page = Path("table/report.html").read_text()
    assert "Machines that differ from what the designs know" in page
    # Nothing hard is required: what is told first is on how many plants the limits are held.
    assert "limits held" in page and re.search(r"[0-3]\sof\s3\b", page)
    assert "worst score in the box" not in Path("table/summary.md").read_text()
    # What is required and missed is told by the exit status.
    shell(words, "strict --require settling_time=1min", status=1)
