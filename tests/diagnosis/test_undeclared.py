"""What a plant declares of its sensors, and what the recordings show instead."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.newcomers import oscillator
from workbench.diagnosis.problem import problem_of_files
from workbench.diagnosis.undeclared import as_coarse_as_recorded
from workbench.model import Output
from workbench.recordings.recording import Recording, Signal


def _swinging(step: float) -> Recording:
    time = 0.01 * np.arange(2000)
    position = np.sin(time) + 1e-3 * np.random.default_rng(1).normal(size=len(time))
    if step:
        position = step * np.round(position / step)
    signals = Signal("drive", 0.0 * time, "N", role="command"), Signal("position", position, "m")
    return Recording("swinging", time, signals)


def test_steps_coarser_than_declared_count_as_noise() -> None:
    model, (row,) = as_coarse_as_recorded(oscillator(), [_swinging(0.0), _swinging(0.02)])
    assert model.outputs[0].resolution == pytest.approx(0.02)
    assert row["result"] == "corrected" and "steps of 0.02 m" in row["note"]


def test_a_problem_of_files_says_what_its_recordings_lack_and_what_leaves_its_range(
    tmp_path: Path,
) -> None:
    plant = oscillator()
    plant = replace(
        plant,
        inputs=(replace(plant.inputs[0], lower=-0.5),),
        outputs=(*plant.outputs, Output("acceleration", "m/s2", 1.0)),
        equations=lambda m: (
            {"position": m.x.speed, "speed": m.u.drive},
            {"position": m.x.position, "acceleration": m.u.drive},
        ),
    )
    time = 0.01 * np.arange(2000)
    for name, size in (("a", 0.4), ("b", 0.8)):
        columns = np.column_stack([time, size * np.sin(time), np.sin(time), np.cos(time)])
        header = "t [s],drive [N],position [m],acc z [g]"
        np.savetxt(tmp_path / f"{name}.csv", columns, "%.6g", ",", header=header, comments="")
    notes = problem_of_files(plant, [tmp_path / "a.csv"], [tmp_path / "b.csv"]).notes
    assert [note for note in notes if "clipped" in note] == [
        "b: drive runs from -0.8 to 0.8 N, the plant declares -0.5 to inf: no measurement shows it"
        " clipped, so the range is taken as wide"
    ]
    (missing,) = (note for note in notes if "no column is called acceleration" in note)
    assert "'acc z [g]'" in missing


def test_steps_below_the_declared_noise_or_resolution_change_nothing() -> None:
    declared = oscillator()
    fine = replace(declared, outputs=(replace(declared.outputs[0], resolution=0.02),))
    for model, step in ((declared, 0.0), (declared, 1e-3), (fine, 0.02)):
        assert as_coarse_as_recorded(model, [_swinging(step)]) == (model, ())
