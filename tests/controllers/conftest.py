"""Plants and linear models on which the controllers are designed and verified."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controllers.joint.schedule import JointSchedule, joint_schedule
from workbench.linearisation import LinearModel, linearise
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
    return linearise(operating_point(plant, {"angle": math.radians(30)}), verdict=False)


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


@dataclass(frozen=True)
class Matrices:
    """A linear model of bare matrices: what a design may use of one, and nothing else."""

    A: Any
    B: Any
    C: Any
    D: Any
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    x0: Any
    u0: Any
    y0: Any
    operating_point: Any

    @property
    def state_scales(self) -> Any:
        scales = {q.name: q.scale for q in self.operating_point.model.states}
        return np.array([scales[name] for name in self.state_names])

    def discretise(self, sample_time: float) -> tuple[Any, ...]:
        import control as ct

        held = ct.c2d(ct.ss(self.A, self.B, self.C, self.D), sample_time, "zoh")
        return held.A, held.B, held.C, held.D


TRUTH = {"b": 1.6e-4, "a1": 1.5, "a0": 100.0, "g": 3.6e7, "e": 6.5e5, "d": 0.8}


@pytest.fixture(scope="session")
def third_order() -> Matrices:
    """A joint that is exactly of third order, pressures moving oppositely about 4 bar."""
    b, a1, a0, g, e, d = (TRUTH[k] for k in ("b", "a1", "a0", "g", "e", "d"))
    # states angle, speed, pressure_1, pressure_2
    A = np.array(
        [
            [0, 1, 0, 0],
            [-a0, -a1, b, -b],
            [0, -e / 2, -d, 0],
            [0, e / 2, 0, -d],
        ],
        dtype=float,
    )
    B = np.array([[0.0], [0.0], [g / 2], [-g / 2]])
    C = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    names = ("angle", "speed", "pressure_1", "pressure_2")
    scales = (1.0, 1.0, 1e5, 1e5)
    states = [SimpleNamespace(name=n, scale=s) for n, s in zip(names, scales, strict=True)]
    return Matrices(
        A,
        B,
        C,
        np.zeros((3, 1)),
        names,
        ("opening",),
        ("angle", "pressure_1", "pressure_2"),
        np.array([0.5, 0.0, 4e5, 4e5]),
        np.zeros(1),
        np.array([0.5, 4e5, 4e5]),
        SimpleNamespace(model=SimpleNamespace(states=states)),
    )
