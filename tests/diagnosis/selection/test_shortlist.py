"""What is refitted, by its score, by where the mismatch is and by what recordings show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.selection.candidates import entries, made_score
from workbench.diagnosis.selection.score import Scores
from workbench.diagnosis.selection.shortlist import MOST_AT_FIRST, shortlist, to_refit, where
from workbench.physics.friction import coulomb_friction
from workbench.physics.hypothesis import Hypothesis
from workbench.physics.library import library
from workbench.plants.arm import arm


def _chosen(
    entries: tuple[Hypothesis, ...],
    gains: Mapping[str, float] | None = None,
    *,
    quiet: bool = False,
    leading: tuple[str, ...] = (),
) -> list[str]:
    """Names of what is refitted first where the joint lacks something and its laws score best."""
    model = arm()
    task: Any = SimpleNamespace(
        base=SimpleNamespace(model=model),
        location=SimpleNamespace(alone={"joint": 100.0, "chamber_1": 1.0}),
        priors=[q for q in model.parameters if q.fitted],
        longer=lambda _: 1.0,
    )
    score = {e.name: 50.0 * (e.group == "process") for e in entries} if gains is None else gains
    rated = [SimpleNamespace(entry=e, gain=score.get(e.name, 0.0), testable=True) for e in entries]
    ordered = tuple(sorted(rated, key=lambda s: -s.gain))
    scores: Any = SimpleNamespace(scores=ordered, look_alikes=lambda *_, **__: (), leading=leading)
    chosen, later = to_refit(task, scores, MOST_AT_FIRST, model, quiet=quiet)
    names = [s.entry.name for s in (*chosen, *later)]
    assert len(set(names)) == len(names)
    return [s.entry.name for s in chosen]


def test_a_late_sensor_is_tried_wherever_the_mismatch_is_and_whatever_it_scores() -> None:
    assert "sensor_delay_angle" in _chosen(library(arm()))


def test_near_the_noise_too_what_scores_half_of_the_best_where_that_is_is_tried() -> None:
    # A spring in a narrow band: without a place of rest it scores half of what it gains.
    entries = library(arm())
    elsewhere = [e.name for e in entries if e.group == "sensor"][: MOST_AT_FIRST + 3]
    gains = dict.fromkeys(elsewhere, 90.0) | {"creep": 100.0, "stribeck_friction": 95.0}
    gains |= {"linear_spring": 54.0, "constant_torque": 46.0}
    chosen = _chosen(entries, gains, quiet=True)
    assert "linear_spring" in chosen
    assert "constant_torque" not in chosen


def test_what_leads_where_parameters_are_on_their_bounds_is_tried() -> None:
    entries = library(arm())
    gains = {e.name: 90.0 for e in entries} | {"muscle_viscosity": 20.0}
    assert "muscle_viscosity" not in _chosen(entries, gains)
    assert "muscle_viscosity" in _chosen(entries, gains, leading=("muscle_viscosity",))


def test_what_recordings_show_comes_first_whatever_it_scores() -> None:
    entries = library(arm())
    (clipped,) = (e for e in entries if e.name == "sensor_clipping_pressure_1")
    assert clipped.name not in _chosen(entries)
    shown = tuple(replace(e, evident=True) if e is clipped else e for e in entries)
    assert _chosen(shown)[0] == clipped.name


def test_what_is_simpler_and_scores_nearly_as_well_at_a_place_is_tried_too() -> None:
    entries = {e.name: e for e in library(arm())}
    at_joint = [n for n, e in entries.items() if e.ports == ("joint.torque",)]
    rated = {name: 100.0 * 0.75**i + 11.0 for i, name in enumerate(at_joint)}
    rated |= {"sensor_bend_angle": 10.0, "sensor_offset_angle": 9.0, "sensor_gain_angle": 7.0}
    rows = [SimpleNamespace(entry=entries[n], gain=g, testable=True) for n, g in rated.items()]
    scores: Any = SimpleNamespace(scores=tuple(rows), look_alikes=lambda *_, **__: ())
    chosen = [s.entry.name for s in shortlist(scores, most=MOST_AT_FIRST)]
    assert len(chosen) == MOST_AT_FIRST < len(rated)
    assert {"sensor_bend_angle", "sensor_offset_angle"} <= set(chosen)
    assert "sensor_gain_angle" not in chosen


def test_with_levels_by_recording_what_is_the_same_in_all_of_them_is_tried() -> None:
    by_recording = "sensor_offset_by_recording_angle"
    ranked = [made_score(by_recording, 900.0), made_score("tilt_gravity", 800.0)]
    ranked += [made_score("sensor_offset_angle", 20.0), made_score("sensor_offset_pressure_1", 7.0)]
    scores = Scores((*ranked, made_score("sensor_drift_angle", 8.0)), np.eye(5))
    names = [score.entry.name for score in shortlist(scores, most=2)]
    assert names == [by_recording, "tilt_gravity", "sensor_offset_angle"]


def test_the_best_law_of_one_parameter_at_each_sensor_is_tried_whatever_scores_better() -> None:
    # A wheel that reads 4 % more: a ripple that bends the same way scores twice as high.
    ranked = [("tilt_gravity", 900.0), ("constant_torque", 800.0), ("linear_spring", 700.0),
              ("sensor_ripple_angle", 500.0), ("sensor_gain_angle", 250.0),
              ("sensor_offset_pressure_1", 90.0), ("sensor_offset_angle", 80.0),
              ("sensor_gain_pressure_1", 70.0), ("sensor_gain_pressure_2", 7.0)]  # fmt: skip
    rows = tuple(made_score(name, gain) for name, gain in ranked)
    chosen = [s.entry.name for s in shortlist(Scores(rows, np.eye(9)), most=3)]
    assert {"sensor_gain_angle", "sensor_offset_pressure_1"} < set(chosen)
    assert len(chosen) == 4


def test_shortlist_takes_look_alikes_and_the_best_of_other_places() -> None:
    ranked = [
        ("tilt_gravity", 900.0),
        ("constant_torque", 800.0),
        ("linear_spring", 700.0),
        ("stribeck_friction", 690.0),
        ("ripple", 680.0),
        ("local_catch", 670.0),
        ("valve_offset", 50.0),
        ("chamber_leakage_1", 3.0),
    ]
    confusion = np.eye(len(ranked))
    confusion[0, 1] = confusion[1, 0] = 0.99
    scores = Scores(tuple(made_score(name, gain) for name, gain in ranked), confusion)
    names = [score.entry.name for score in shortlist(scores, most=3)]
    assert names[0] == "tilt_gravity"
    # The look-alike, and the best of another component although others at the joint score more.
    assert set(names[1:]) == {"constant_torque", "valve_offset"}


def test_what_cannot_be_tested_or_gains_too_little_is_not_refitted() -> None:
    collinear = made_score("tilt_gravity", 90.0, collinearity=0.999)
    scores = Scores((replace(collinear, sigma=1.5), made_score("ripple", 2.0)), np.eye(2))
    assert shortlist(scores, most=18) == ()
    # What parameters reproduce but for a thousandth is refitted where that is seen clearly.
    clear = replace(scores, scores=(collinear, scores.scores[1]))
    assert [score.entry.name for score in shortlist(clear, most=18)] == ["tilt_gravity"]


@pytest.mark.parametrize(("gain", "worth"), [(172.0, True), (130.0, False)])
def test_a_stiff_law_is_refitted_from_half_of_the_best_score_on(gain: float, worth: bool) -> None:
    ranked = [("command_play", 275.0), ("spool_hysteresis", 245.0), ("command_stiction", gain)]
    assert entries()["command_stiction"].stiff
    scores = Scores(tuple(made_score(*each) for each in ranked), np.eye(3))
    names = [score.entry.name for score in shortlist(scores, most=18)]
    assert ("command_stiction" in names) == worth


def test_location_of_an_effect_is_that_of_its_ports() -> None:
    assert where(entries()["cross_leakage"]) == ("chamber_1", "chamber_2")
    friction = Hypothesis(coulomb_friction("joint.torque", level=0.0), "level", 0.5)
    assert where(friction) == ("joint",)
