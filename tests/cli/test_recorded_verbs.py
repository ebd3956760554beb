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
    assert "at the noise floor" in printed
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
