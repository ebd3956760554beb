"""The map over operating points and parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.linearisation import linearise
from workbench.linearisation.operating_map import OperatingMap, operating_map
from workbench.model import Model
from workbench.operating_point import operating_point
from workbench.plants.arm import arm
from workbench.plants.servo_axis import servo_axis

ANGLES = np.radians(np.arange(0, 61, 10))
BANDS = {0.0: (5.0, 6.6), 3.0: (1.7, 2.3), 8.0: (1.1, 1.5)}


def at_load(model: Model, load: float) -> OperatingMap:
    return operating_map(model, {"angle": ANGLES, "load": [load], "mean_pressure": [3e5]})


@pytest.mark.parametrize("load", BANDS)
def test_frequencies_of_the_arm(load: float) -> None:
    found = at_load(arm(), load)
    lower, upper = BANDS[load]
    assert (found.frequency_hz > lower).all() and (found.frequency_hz < upper).all()


@pytest.mark.parametrize("load", BANDS)
def test_damping_of_the_arm(load: float) -> None:
    free = at_load(arm().without("bearing_friction"), load)
    assert (free.damping > 0.01).all() and (free.damping < 0.2).all()
    # Dry friction over an oscillation of 1 rad/s adds to it; beside the stops 0 kg reach 0.21.
    rubbing = at_load(arm(), load)
    assert (rubbing.damping > free.damping).all() and (rubbing.damping < 0.22).all()


def test_frequency_is_that_of_a_spring_and_the_inertia() -> None:
    # Independent route: torque at closed chambers, isentropic and isothermal, gives two springs.
    plant = arm(3.0)
    point = operating_point(plant, {"angle": math.radians(30), "mean_pressure": 3e5})
    at = {"angle": [math.radians(30)], "mean_pressure": [3e5]}
    frequency = operating_map(plant, at).frequency_hz[0, 0]

    def torque(angle: float, exponent: float) -> float:
        x = point.x.copy()
        x[plant_states.index("angle")] = angle
        volumes = [plant.signals(s, point.u) for s in (point.x, x)]
        for i in (1, 2):
            before, after = (v[f"chamber_{i}.volume"] for v in volumes)
            x[plant_states.index(f"pressure_{i}")] *= (before / after) ** exponent
        return plant.signals(x, point.u)["joint.torque"]

    plant_states = [q.name for q in plant.states]
    middle, step = math.radians(30), 1e-4
    springs = [
        -(torque(middle + step, n) - torque(middle - step, n)) / (2 * step) for n in (1.0, 1.4)
    ]
    slow, fast = (math.sqrt(spring / 0.466) / (2 * math.pi) for spring in springs)
    assert slow < frequency < fast * 1.01


def test_the_map_is_symmetric_about_the_middle() -> None:
    found = operating_map(arm(3.0), {"angle": ANGLES, "mean_pressure": [2.5e5]})
    assert found.frequency_hz == pytest.approx(found.frequency_hz[::-1], rel=1e-6)
    gain = found.table(lambda m: (m.D - m.C @ np.linalg.solve(m.A, m.B))[0, 0])[:, 0]
    assert gain == pytest.approx(gain[::-1], rel=1e-2)


def test_an_entry_is_what_linearise_gives() -> None:
    axes = {"angle": [0.2, 0.4], "load": [0.0, 5.0], "mean_pressure": [2e5, 3e5]}
    found = operating_map(arm(), axes)
    point = operating_point(arm(5.0), {"angle": 0.4, "mean_pressure": 2e5})
    alone = linearise(point, input="opening")
    assert found.table(lambda linear: linear.A)[1, 1, 0] == pytest.approx(
        alone.A, rel=1e-5, abs=1e-5
    )
    assert found.models[1, 1, 0].input_names == ("opening",)


def test_without_mean_pressure_the_points_are_equilibria() -> None:
    found = operating_map(arm(3.0), {"angle": ANGLES}, input="plant")
    assert all(model.operating_point.is_equilibrium for model in found.models.values())


def test_what_cannot_be_held_is_missing_with_a_reason() -> None:
    axes = {"angle": [0.0, 0.5], "load": [0.0, 8.0], "mean_pressure": [1e5]}
    found = operating_map(arm(plane="vertical"), axes)
    assert np.isfinite(found.frequency_hz[:, 0, 0]).all()
    assert (
        np.isnan(found.frequency_hz[0, 1, 0])
        and np.isnan(found.table(lambda linear: linear.A)[0, 1, 0]).all()
    )
    assert "no operating point" in found.reasons[0, 1, 0]


def test_wrong_grids_are_refused() -> None:
    with pytest.raises(WorkbenchError, match="not finite"):
        operating_map(arm(), {"angle": [math.nan]})
    with pytest.raises(WorkbenchError, match="load"):
        operating_map(servo_axis(), {"position": [0.1], "load": [3.0]})
    with pytest.raises(WorkbenchError, match="one or more axes"):
        operating_map(servo_axis(), {})
    with pytest.raises(WorkbenchError, match="nowhere|anywhere"):
        operating_map(arm(8.0, plane="vertical"), {"angle": [0.0], "mean_pressure": [0.5e5]})
