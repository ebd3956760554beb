"""Force laws fitted to force maps: made maps give their law back, the measured one ranks them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from workbench.data_folder import external_data
from workbench.demo.force_map_study import FAMILIES, ForceMap, fit_law, study_map
from workbench.demo.force_maps import FILE, force_maps_part, read_force_map


def made(name: str) -> ForceMap:
    lengths = 0.3 * np.array([1.0, 0.97, 0.94, 0.91, 0.88, 0.85])
    length, pressure = np.meshgrid(lengths, np.linspace(0.5e5, 6e5, 9))
    law = FAMILIES[name].build(np.array(FAMILIES[name].start))
    points = ForceMap(pressure.ravel(), length.ravel(), np.zeros(length.size))
    force = np.asarray(law.force(points.contraction, points.pressure))
    return ForceMap(points.pressure, points.length, force)


@pytest.mark.parametrize("name", FAMILIES)
def test_a_made_map_gives_its_law_back(name: str) -> None:
    points = made(name)
    # The forces reach 1600 N; the fit stops when a step changes them by less than 1e-8 of it.
    law = fit_law(FAMILIES[name], points)[2]
    error = np.asarray(law.force(points.contraction, points.pressure)) - points.force
    assert np.sqrt(np.mean(error**2)) < 0.05


def test_a_slack_point_does_not_pull_the_law_to_zero() -> None:
    points = made("paper")
    assert (points.force < 1.0).any()
    fitted = fit_law(FAMILIES["paper"], points)[2]
    slack = points.force < 1.0
    tension = np.asarray(fitted.tension(points.contraction[slack], points.pressure[slack]))
    assert tension.min() < -50.0


def test_contractions_are_those_of_a_200_mm_muscle() -> None:
    points = ForceMap(np.zeros(2), np.array([0.296, 0.2664]), np.zeros(2))
    # 10 % of contraction is 20 mm of a 200 mm muscle.
    np.testing.assert_allclose(points.contraction, [0.0, 0.02], atol=1e-12)


def test_the_measured_map_ranks_the_laws(external_folder: Path) -> None:
    measured = read_force_map(external_data(FILE, external_folder))
    study = study_map(measured, "DMSP-20", families=FAMILIES)
    for fit in study.laws:
        assert fit.fitted_rms_N < min(fit.lengths_held_out_rms_N, fit.published_rms_N)
    held_out = {law.name: law.lengths_held_out_rms_N for law in study.laws}
    # A pressure-independent part halves the error of the same polynomial without it; Sarosi's law
    # stays within 2 % of the largest force, 1654 N, on lengths that it has not seen.
    assert held_out["paper"] < 0.5 * held_out["petrovic"]
    assert held_out["sarosi"] < 0.02 * 1654.0


def test_the_section_says_that_no_folder_was_given() -> None:
    part = force_maps_part(None)
    assert "--data FOLDER" in str(part.section.blocks[0])
