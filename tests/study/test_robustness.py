"""Draws, intervals, slopes and the search, each against what is known of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.study.small_study import TEXT
from workbench.study.execution import Workers, store_of
from workbench.study.read import load_study
from workbench.study.robustness import robustness, scaled, straight_line, unit_draws
from workbench.study.study import Box, Study


def test_draws_fill_the_cube_and_repeat() -> None:
    points = unit_draws(3, 64, 5)
    assert points.shape == (64, 3) and np.array_equal(points, unit_draws(3, 64, 5))
    assert not np.array_equal(points, unit_draws(3, 64, 6))
    # Of a Sobol sequence every quarter of an axis holds a quarter of the points.
    counts = [np.histogram(points[:, i], bins=4, range=(0, 1))[0] for i in range(3)]
    assert np.all(np.abs(np.array(counts) - 16) <= 1)


def test_scaled_to_the_box() -> None:
    box = Box({"load": (2.0, 4.0), "supply_pressure": (4e5, 7e5)}, ("step",))
    assert scaled(box, np.array([[0.5, 1.0]])).tolist() == [[3.0, 7e5]]


def test_a_straight_line_is_found(rng: np.random.Generator) -> None:
    points = unit_draws(2, 32, 1)
    values = 0.4 + points @ [2.0, -1.0] + rng.normal(0.0, 1e-3, 32)
    middle, slopes, explained = straight_line(points, values)
    assert slopes == pytest.approx([2.0, -1.0], abs=5e-3) and explained > 0.999
    assert middle == pytest.approx(0.9, abs=5e-3)
    assert straight_line(points, np.full(32, 0.7))[1].tolist() == [0.0, 0.0]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    path = tmp_path_factory.mktemp("study") / "box.toml"
    box = "[robustness]\ndraws = 4\nsearch = 5\n[robustness.box]\nload = [2, 5]\n"
    path.write_text(f"{TEXT}\n{box}supply_pressure = ['4.5 bar', '7 bar']\n", encoding="utf-8")
    return load_study(path)


def test_the_search_finds_no_better_plant_than_the_draws(study: Study, tmp_path: Path) -> None:
    store = store_of(study, tmp_path)
    (found,) = robustness(study, Workers(store))
    assert found.drawn == 4 and 4 < len(found.scores) <= 9
    assert found.worst_score == found.scores.max() >= found.scores[:4].max()
    assert all(2.0 <= p[0] <= 5.0 and 4.5e5 <= p[1] <= 7e5 for p in found.points)
    worst = int(np.argmax(found.scores))
    assert list(found.worst.values()) == found.points[worst].tolist()
    names = {p.requirement: p for p in found.probabilities}
    assert set(names) == {"settling_time at most 0.6 s", "chatter at most 1 V/s"}
    assert names["chatter at most 1 V/s"].met == 0
    assert set(found.effects) == {"load", "supply_pressure"}
    # All of it is kept: a second time nothing is run.
    before = sorted(p.stat().st_mtime_ns for p in store.folder.glob("*.json"))
    (again,) = robustness(study, Workers(store_of(study, tmp_path)))
    assert np.array_equal(again.scores, found.scores)
    assert sorted(p.stat().st_mtime_ns for p in store.folder.glob("*.json")) == before
