"""The disturbance observer leaves no offset between estimate and measurement."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from controllers.mpc.disturbance_observer import design_disturbance_observer
from workbench.errors import WorkbenchError
from workbench.linearisation.zero_order_hold import zero_order_hold

SENSORS = ("angle", "pressure_1", "pressure_2")


def design(model: Any, **disturbances: float) -> Any:
    return design_disturbance_observer(
        model,
        sensors=SENSORS,
        actuators=("opening",),
        disturbances=disturbances,
        sensor_noise=(2e-5, 600.0, 600.0),
        state_noise=0.1,
        sample_time=0.002,
    )


def test_estimate_agrees_with_a_plant_that_differs(third_order: Any) -> None:
    observer = design(third_order, speed=30.0, pressure_1=1e7, pressure_2=1e7)
    # The plant is 20 % stiffer, leaks twice as much and is pushed.
    A = third_order.A.copy()
    A[1, 0] *= 1.2
    A[2, 2] *= 2.0
    phi, gamma = zero_order_hold(A, np.column_stack([third_order.B, [0, 10.0, 3e4, 0]]), 0.002)
    x, z = np.zeros(4), np.zeros(7)
    for _ in range(20000):
        measured = tuple(float(v) for v in third_order.C @ x + third_order.y0)
        estimate = observer.correct(z, measured)
        z = observer.predict(estimate, np.array([0.001]))
        x = phi @ x + gamma @ [0.001, 1.0]
    np.testing.assert_allclose(estimate[:4], x, rtol=1e-4, atol=1e-6)


def test_rest_is_explained(third_order: Any) -> None:
    observer = design(third_order, speed=30.0, pressure_1=1e7, pressure_2=1e7)
    E = np.zeros((4, 3))
    E[[1, 2, 3], [0, 1, 2]] = 1.0
    measured = (0.6, 4.5e5, 3.2e5)
    estimate = observer.at_rest(measured, third_order.A, E)
    np.testing.assert_allclose(third_order.C @ estimate[:4] + observer.rest, measured, rtol=1e-9)
    np.testing.assert_allclose(observer.predict(estimate, np.zeros(1)), estimate, atol=1e-6)


def test_too_many_disturbances_are_refused(third_order: Any) -> None:
    with pytest.raises(WorkbenchError, match="told apart"):
        design(third_order, angle=1.0, speed=30.0, pressure_1=1e7, pressure_2=1e7)


def test_unknown_state_is_named(third_order: Any) -> None:
    with pytest.raises(WorkbenchError, match="presure_1"):
        design(third_order, presure_1=1e7)
