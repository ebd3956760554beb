"""Inertia and gravity of the arm: stated figures and an independent route."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.numbers_of import on_symbols
from workbench.errors import WorkbenchError
from workbench.plants.arm import arm
from workbench.plants.arm.joint import ArmBody

BODY = ArmBody()


def test_inertia_for_three_loads() -> None:
    values = [BODY.inertia(load) for load in (0, 3, 8)]
    assert values == pytest.approx([0.056, 0.466, 1.150], abs=5e-4)


def test_eight_plates_held_horizontal() -> None:
    assert float(BODY.gravity_torque(0.0, 8)) == pytest.approx(30.8, abs=0.05)


def test_gravity_torque_is_the_slope_of_the_potential_energy() -> None:
    def energy(angle: float, load: float) -> float:
        heights = [
            mass * (x * np.sin(angle) + y * np.cos(angle))
            for mass, x, y in ((0.987, 0.205, 0.0176), (load, 0.367, -0.024))
        ]
        return 9.81 * sum(heights)

    h = 1e-6
    for load in (0.0, 3.0, 8.0):
        for angle in (-0.1, 0.0, 0.4, 1.05):
            slope = (energy(angle + h, load) - energy(angle - h, load)) / (2 * h)
            # central difference: 1e-10 of the energy over the step
            assert float(BODY.gravity_torque(angle, load)) == pytest.approx(slope, abs=1e-7)


def test_plate_inertia_against_the_parallel_axis_theorem() -> None:
    distance = np.hypot(0.367, 0.024)
    assert BODY.inertia(1) - BODY.inertia(0) == pytest.approx(distance**2 + 0.0015)


def test_horizontal_plane_has_no_gravity() -> None:
    weighed = [{q.name for q in arm(8, plane=p).effects} for p in ("horizontal", "vertical")]
    assert weighed[1] - weighed[0] == {"gravity"}


def test_arrays_and_expressions_agree() -> None:
    angles = np.linspace(-0.1, 1.1, 13)
    torque = on_symbols(BODY.gravity_torque, angles, np.full(13, 5.0))
    assert np.allclose(torque, BODY.gravity_torque(angles, 5.0), rtol=1e-13)
    assert float(on_symbols(BODY.inertia, 5.0)) == pytest.approx(BODY.inertia(5.0))


@pytest.mark.parametrize("load", [12, -1, float("nan"), "heavy"])
def test_load_outside_the_range_is_refused(load: object) -> None:
    with pytest.raises(WorkbenchError, match="0 to 8"):
        BODY.inertia(load)


def test_unknown_plane_is_refused() -> None:
    with pytest.raises(WorkbenchError, match="did you mean 'vertical'"):
        arm(plane="vertcal")  # type: ignore[arg-type]
