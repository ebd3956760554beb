"""Plants and linear models on which the controllers are designed and verified."""

from __future__ import annotations

import math
from dataclasses import replace

import control as ct
import numpy as np
import pytest

from controllers.joint.schedule import JointSchedule, joint_schedule
from tests.machines import at_rest
from workbench.linearisation import LinearModel, linear_model, linearise
from workbench.linearisation.operating_map import operating_map
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.physics.hysteresis import muscle_hysteresis
from workbench.plants.arm import arm


@pytest.fixture(scope="session")
def plant() -> Model:
    return arm(load_kg=3)


@pytest.fixture(scope="session")
def plant_with_hysteresis(plant: Model) -> Model:
    # 10 N and 7 N per bar of half width in each muscle
    return plant.with_effect(muscle_hysteresis(level=10.0, level_per_pressure=7e-5))


@pytest.fixture(scope="session")
def linear(plant: Model) -> LinearModel:
    return at_rest(plant, angle=math.radians(30))


@pytest.fixture(scope="session")
def linear_by_opening(plant: Model) -> LinearModel:
    point = operating_point(plant, {"angle": math.radians(30)})
    return linearise(point, input="opening", verdict=False)


@pytest.fixture(scope="session")
def schedule() -> JointSchedule:
    angles = np.radians(np.linspace(1.0, 59.0, 7))
    return joint_schedule(
        operating_map(arm(load_kg=3), {"angle": angles, "mean_pressure": [2.8e5, 3.6e5]})
    )


TRUTH = {"b": 1.6e-4, "a1": 1.5, "a0": 100.0, "g": 3.6e7, "e": 6.5e5, "d": 0.8}


@pytest.fixture(scope="session")
def third_order() -> LinearModel:
    """A joint that is exactly of third order, pressures moving oppositely about 4 bar."""
    b, a1, a0, g, e, d = (TRUTH[k] for k in ("b", "a1", "a0", "g", "e", "d"))
    names = ("angle", "speed", "pressure_1", "pressure_2")
    A = np.array(
        [[0, 1, 0, 0], [-a0, -a1, b, -b], [0, -e / 2, -d, 0], [0, e / 2, 0, -d]], dtype=float
    )
    B, C = np.array([[0.0], [0.0], [g / 2], [-g / 2]]), np.eye(4)[[0, 2, 3]]
    bare = linear_model(
        ct.ss(A, B, C, 0, states=names, inputs="opening", outputs=[names[k] for k in (0, 2, 3)])
    )
    point = bare.operating_point
    sized = [replace(q, scale=s) for q, s in zip(point.model.states, (1, 1, 1e5, 1e5), strict=True)]
    model = replace(point.model, states=tuple(sized))
    x0 = np.array([0.5, 0.0, 4e5, 4e5])
    return replace(bare, operating_point=replace(point, model=model), x0=x0, y0=C @ x0)
