"""What is refitted, by its score, by where the mismatch is and by what recordings show."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from workbench.diagnosis.selection.shortlist import MOST_AT_FIRST, shortlist, to_refit
from workbench.physics.library import Hypothesis, library
from workbench.plants.arm import arm


def _chosen(entries: tuple[Hypothesis, ...]) -> list[str]:
    """Names of what is refitted first where the joint lacks something and its laws score best."""
    model = arm()
    task: Any = SimpleNamespace(
        base=SimpleNamespace(model=model),
        location=SimpleNamespace(alone={"joint": 100.0, "chamber_1": 1.0}),
        priors=[q for q in model.parameters if q.fitted],
        longer=lambda _: 1.0,
    )
    rated = [
        SimpleNamespace(entry=e, gain=50.0 * (e.group == "process"), testable=True) for e in entries
    ]
    ordered = tuple(sorted(rated, key=lambda s: -s.gain))
    scores: Any = SimpleNamespace(scores=ordered, look_alikes=lambda *_, **__: ())
    chosen, later = to_refit(task, scores, MOST_AT_FIRST, model, quiet=False)
    names = [s.entry.name for s in (*chosen, *later)]
    assert len(set(names)) == len(names)
    return [s.entry.name for s in chosen]


def test_a_late_sensor_is_tried_wherever_the_mismatch_is_and_whatever_it_scores() -> None:
    assert "sensor_delay_angle" in _chosen(library(arm()))


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
