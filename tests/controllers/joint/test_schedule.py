"""The schedule: straight lines between joint models."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers.joint.model import joint_model
from controllers.joint.schedule import JointSchedule, joint_schedule
from workbench.errors import WorkbenchError
from workbench.linearisation import linearise
from workbench.linearisation.operating_map import operating_map
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.plants.arm import arm


def test_difference_at_rest_is_that_of_the_plant(schedule: JointSchedule, plant: Model) -> None:
    # between grid points, at mean pressures off the map: forces are straight lines over pressure
    for angle, mean in ((12.0, 3.0e5), (25.0, 4.1e5), (47.0, 3.3e5)):
        point = operating_point(plant, {"angle": math.radians(angle), "mean_pressure": mean})
        y = dict(zip([q.name for q in plant.outputs], point.y, strict=True))
        found = schedule.at(math.radians(angle), mean).difference
        # 13 degrees apart, straight lines miss the curve by less than 3 kPa (0.03 bar)
        assert found == pytest.approx(y["pressure_1"] - y["pressure_2"], abs=6e3)


def test_numbers_are_those_of_a_joint_model_between_the_points(
    schedule: JointSchedule, plant: Model
) -> None:
    point = operating_point(plant, {"angle": math.radians(35), "mean_pressure": 3.2e5})
    own = joint_model(linearise(point, input="opening", verdict=False))
    found = schedule.at(math.radians(35), 3.2e5)
    for name in ("b", "a0", "g", "e"):
        assert getattr(found, name) == pytest.approx(getattr(own, name), rel=0.12)


def test_no_bump_across_a_point(schedule: JointSchedule) -> None:
    at = float(schedule.angles[2])
    before, after = schedule.at(at - 1e-9, 3.5e5), schedule.at(at + 1e-9, 3.5e5)
    np.testing.assert_allclose(before, after, rtol=1e-6, atol=1e-2)


def test_missing_points_continue_and_inertia_moves_only_what_it_should(
    schedule: JointSchedule,
) -> None:
    angles = np.radians(np.linspace(1.0, 59.0, 7))
    heavier = operating_map(arm(load_kg=4), {"angle": angles, "mean_pressure": [2.8e5, 3.6e5]})
    other = joint_schedule(heavier)
    both = schedule.with_inertia_of(other).at(0.5, 3.5e5)
    own, far = schedule.at(0.5, 3.5e5), other.at(0.5, 3.5e5)
    assert (both.b, both.a0) == (far.b, far.a0)
    assert (both.g, both.difference) == (own.g, own.difference)
    models = {key: value for key, value in heavier.models.items() if key != (6, 1)}
    filled = joint_schedule(replace(heavier, models=models))
    assert filled.high[-1][6] == pytest.approx(other.high[-1][6], rel=0.2)
    with pytest.raises(WorkbenchError, match="two mean pressures"):
        joint_schedule(replace(heavier, axes={"angle": angles, "mean_pressure": np.array([3e5])}))
    with pytest.raises(WorkbenchError, match="evenly spaced"):
        uneven = {"angle": np.array([0.1, 0.2, 0.5]), "mean_pressure": np.array([2.8e5, 3.6e5])}
        joint_schedule(replace(heavier, axes=uneven))
    with pytest.raises(WorkbenchError, match="over angle and"):
        joint_schedule(replace(heavier, axes={"angle": angles}))
