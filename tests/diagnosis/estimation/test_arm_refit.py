"""Refits of the arm: shipped case, independent rig, gauges."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from workbench.data_folder import shipped_data
from workbench.diagnosis.estimation.priors import default_priors
from workbench.diagnosis.estimation.refit import refit
from workbench.diagnosis.problem import problem_of_case
from workbench.diagnosis.refit_report import run_refit
from workbench.evaluation.rig.cases import make_case
from workbench.recordings.case import read_case


def test_the_refit_reaches_the_noise_floor_where_nothing_is_hidden() -> None:
    report = run_refit(problem_of_case(read_case(shipped_data("practice-07"))))
    assert report.refit.converged
    assert report.reaches_floor
    rows = {(r.recording, r.output): r for r in report.rows}
    for role in ("validate_open", "validate_closed"):
        angle = rows[f"practice-07/{role}", "angle"]
        # Steps of 0.002 deg; parameters known to some per mille leave a few of them.
        assert angle.refitted < 0.005
        assert angle.nominal > 0.2
        for pressure in ("pressure_1", "pressure_2"):
            # 6 mbar of noise and a converter of 2.44 mbar: 6.04 mbar.
            assert rows[f"practice-07/{role}", pressure].refitted < 0.0063
    assert all(0.8 < value < 1.1 for value in report.refit.whiteness.values())
    assert report.refit.unidentifiable == ()
    assert not any(estimate.on_bound for estimate in report.refit.estimates)


@pytest.mark.long
def test_the_refit_stays_above_the_floor_where_hysteresis_is_hidden() -> None:
    report = run_refit(problem_of_case(read_case(shipped_data("practice-08"))))
    assert not report.reaches_floor
    rows = {(r.recording, r.output): r for r in report.rows}
    assert rows["practice-08/validate_open", "angle"].refitted > 0.1


@pytest.fixture(scope="module")
def rig_case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A case of the independent rig without hidden effects."""
    return make_case(5, [], 3.0, tmp_path_factory.mktemp("rig"), seconds=10.0)


def test_parameters_of_the_independent_rig_lie_in_their_intervals(rig_case: Path) -> None:
    rig = json.loads((rig_case / "truth.json").read_text())["parameters"]
    task = problem_of_case(read_case(rig_case))
    seen = [task.observed(recording) for recording in task.fit]
    found = refit(task.model, seen)
    # Pressures only show volumes relative to conductances: the refit holds the volume at nominal.
    gauge = rig["volume_gain"]
    truth = {
        "arm_inertia": rig["arm_inertia"],
        "force_gain": rig["force_gain"],
        "dead_volume": rig["dead_volume"] / gauge,
        "valve_conductance": rig["conductance"] / gauge,
        "heat_exchange.coefficient": rig["heat_transfer"] / gauge,
        "centre_leakage.fraction": rig["centre_leakage"],
        "damper.coefficient": rig["viscous"],
        "bearing_friction.level": rig["coulomb"],
    }
    assert {e.name for e in found.estimates} == set(truth)
    for name, value in truth.items():
        estimate = found.estimate(name)
        # Eight intervals at once: 3.3 standard deviations hold all of them with 99 %.
        assert abs(estimate.value - value) < 3.3 * estimate.std, name
    # What pressures show directly is known to per cent, far closer than before.
    for name in ("valve_conductance", "dead_volume", "centre_leakage.fraction"):
        assert abs(found.estimate(name).value / truth[name] - 1) < 0.01, name


def test_force_and_inertia_cannot_be_told_apart_away_from_the_stops(rig_case: Path) -> None:
    task = problem_of_case(read_case(rig_case))
    seen = [task.observed(recording) for recording in task.fit]
    closed = [r for r in seen if r.name.endswith("identify_closed")]
    found = refit(task.model, closed)
    named = [text for text in found.unidentifiable if "arm_inertia" in text]
    assert len(named) == 1
    # The loaded inertia, forces and frictions grow together without any measurement changing.
    scale = found.estimate("force_gain")
    names = [e.name for e in found.estimates]
    i, j = names.index("arm_inertia"), names.index("force_gain")
    shared = found.covariance[i, j] / np.sqrt(found.covariance[i, i] * found.covariance[j, j])
    assert shared > 0.98
    assert scale.std > 0.005


def test_volumes_and_conductances_cannot_be_told_apart(rig_case: Path) -> None:
    task = problem_of_case(read_case(rig_case))
    seen = [task.observed(recording) for recording in task.fit]
    priors = (*default_priors(task.model), *default_priors(task.model, ["volume_gain"]))
    found = refit(task.model, seen, priors=priors)
    named = [text for text in found.unidentifiable if "volume_gain" in text]
    assert len(named) == 1
    assert "valve_conductance" in named[0]


@pytest.mark.long
@pytest.mark.system
@pytest.mark.parametrize(
    "number", [2, *(pytest.param(n, marks=pytest.mark.long) for n in (1, 3, 4, 5, 6))]
)
def test_a_case_with_hidden_physics_stays_above_the_floor(
    number: int, external_folder: Path
) -> None:
    folder = external_folder / "practice" / f"practice-{number:02d}"
    if not folder.is_dir():
        pytest.skip(f"the data folder holds no {folder.name}")
    report = run_refit(problem_of_case(read_case(folder)))
    assert not report.reaches_floor
    # Ten steps of the encoder: no refit of the nominal plant hides what these cases hide.
    assert max(row.refitted for row in report.rows if row.output == "angle") > 0.02
