"""The verbs that read recordings: refit, force-map, recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.demo.made_up_map import made_up_map
from tests.shell import Refused, Shell
from workbench.data_folder import shipped_data
from workbench.evaluation.rig.cases import make_case


@pytest.mark.system
def test_refit_writes_a_page_with_the_estimates(tmp_path: Path, shell: Shell) -> None:
    case = make_case(5, [], 3.0, tmp_path / "rig", seconds=4.0)
    printed = shell("refit", case, "--out", tmp_path).out
    assert "valve_conductance" in printed
    assert "at the noise" in printed
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["reaches_noise_floor"] is True
    low, high = results["parameters"]["force_gain"]["interval"]
    assert low < results["parameters"]["force_gain"]["value"] < high
    page = (tmp_path / "report.html").read_text()
    assert "valve_conductance" in page
    assert page.count("<svg") == 4
    (picture,) = tmp_path.glob("held-out-*-validate-open.png")
    assert picture.stat().st_size > 10_000


def test_force_map_compares_the_laws(tmp_path: Path, shell: Shell) -> None:
    points = made_up_map()
    table = np.column_stack([points.pressure, points.length, points.force])
    file = tmp_path / "map.csv"
    np.savetxt(file, table, delimiter=",", header="pressure_Pa,length_m,force_N", comments="")
    assert "Without phi" in shell("force-map", file, "--out", tmp_path / "out").out
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["laws"]["paper_3"]["fitted_rms_N"] < results["laws"]["petrovic"]["fitted_rms_N"]


def test_recording_shows_its_checks(tmp_path: Path, shell: Shell) -> None:
    file = shipped_data("practice-07") / "validate_open.csv.gz"
    printed = shell("recording", file, "--out", tmp_path).out
    assert "noise floor" in printed
    page = (tmp_path / "report.html").read_text()
    assert "Is it fit to judge a model on?" in page
    assert (tmp_path / "signals.png").is_file()


def test_who_has_data_alone_is_told_which_plant_was_taken(tmp_path: Path, refused: Refused) -> None:
    rows = "".join(f"{k},{k % 7}\n" for k in range(40))
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file in files:
        file.write_text(f"time [s],level [m]\n{rows}")
    for given in (("refit --fit", files[0]), ("refit", files[0])):
        message = refused(*given, "--hold-out", files[1])
        assert "no plant is named, so the arm is taken: name yours with --plant" in message
    assert "there is no file" in refused("diagnose", tmp_path / "c.csv")
    assert "there is no file" in refused("diagnose", *files, "c.csv")
    assert "there is no file 'practice-07'" in refused("refit", files[0], "practice-07")


def test_recordings_are_named_side_by_side(tmp_path: Path, shell: Shell) -> None:
    (tmp_path / "pots.py").write_text(POT)
    for seed, name in enumerate("ab"):
        heat = np.repeat(np.random.default_rng(seed).uniform(0.0, 1.0, 40), 10)
        warm = np.zeros(len(heat))
        for k in range(1, len(heat)):
            warm[k] = warm[k - 1] * np.exp(-0.05) + heat[k - 1] * (1.0 - np.exp(-0.05))
        rows = np.column_stack([np.arange(len(heat)), heat, warm])
        np.savetxt(
            tmp_path / f"{name}.csv", rows, delimiter=",", header="time,heat,warm", comments=""
        )
    files = tmp_path / "a.csv", tmp_path / "b.csv"
    printed = shell("refit", *files, "--plant", f"{tmp_path / 'pots.py'}:pot").out
    assert "no recording is held out (--hold-out), so b is" in printed


POT = """
from workbench.model import Input, Model, Output, Parameter, State

def pot():
    return Model(
        "pot",
        lambda m: ({"warm": m.p.pace * (m.u.heat - m.x.warm)}, {"warm": m.x.warm}),
        states=(State("warm", "1", 1.0),),
        inputs=(Input("heat", "1", 0.0, 0.0, 1.0),),
        outputs=(Output("warm", "1"),),
        parameters=(Parameter("pace", "1/s", value=0.1, lower=0.01, upper=1.0, fitted=True),),
    )
"""


def test_a_recording_without_what_a_plant_reads_is_told(tmp_path: Path, shell: Shell) -> None:
    file = tmp_path / "axis.csv"
    rows = "".join(f"{0.01 * k:.2f},{k % 7},{20 + k % 3}\n" for k in range(400))
    file.write_text(f"time [s],force [N],room [degC]\n{rows}")
    assert "has no output of" in shell("recording", file, "--plant", "servo-axis").err
