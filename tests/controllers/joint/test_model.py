"""The third-order model against its truth, and against the plant's statics."""

from __future__ import annotations

import math
from typing import Any

import pytest

from controllers.joint.model import joint_model
from tests.controllers.conftest import TRUTH
from workbench.errors import WorkbenchError
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.operating_point import operating_point


def test_an_exact_joint_is_recovered(third_order: Any) -> None:
    joint = joint_model(third_order)
    for name, value in TRUTH.items():
        assert getattr(joint, name) == pytest.approx(value, rel=1e-6), name
    assert joint.misfit < 1e-6
    assert joint.angle == 0.5


def test_voltage_and_opening_give_the_same_joint(
    linear: LinearModel, linear_by_opening: LinearModel
) -> None:
    one, other = joint_model(linear), joint_model(linear_by_opening)
    for name in TRUTH:
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-6), name


def test_statics_agree_with_the_plant(plant: Model, linear: LinearModel) -> None:
    joint = joint_model(linear)
    point = operating_point(plant, {"angle": math.radians(30)})
    names = [q.name for q in plant.states]

    def acceleration(**moved: float) -> float:
        x = point.x.copy()
        for name, by in moved.items():
            x[names.index(name)] += by
        return float(plant.rates(x, point.u)[names.index("speed")])

    per_difference = (
        acceleration(pressure_1=500.0, pressure_2=-500.0)
        - acceleration(pressure_1=-500.0, pressure_2=500.0)
    ) / 2000.0
    per_angle = (acceleration(angle=1e-4) - acceleration(angle=-1e-4)) / 2e-4
    # The fit is exact in the joint's equation; differences of 1e-4 rad leave 1e-6 of curvature.
    assert joint.b == pytest.approx(per_difference, rel=1e-3)
    assert joint.a0 == pytest.approx(-per_angle, rel=1e-3)


def test_swapped_pressures_are_refused(linear: LinearModel) -> None:
    with pytest.raises(WorkbenchError, match="order of the two pressures"):
        joint_model(linear, sensors=("angle", "pressure_2", "pressure_1"))


def test_unknown_sensor_is_named(linear: LinearModel) -> None:
    with pytest.raises(WorkbenchError, match="angel"):
        joint_model(linear, sensors=("angel", "pressure_1", "pressure_2"))
