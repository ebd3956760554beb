"""Steps between 15 and 45 degrees with 3 kg on the full plant, at 500 Hz.

Designed once from the linear model at 30 degrees; the plant has saturation, noise, quantisation,
and in half the runs muscle hysteresis that no design knows.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from controllers import AnglePD, design_mpc, design_pid, design_sliding_mode
from tests.controllers.families import assert_settles, moves
from workbench.linearisation import LinearModel
from workbench.model import Model
from workbench.verification import metrics, verify

STEPS = moves((0.2, 1.7, 3.2), 15, 45, 30, 15, duration=4.7)


@pytest.mark.parametrize("hysteresis", [False, True], ids=["nominal", "hysteresis"])
@pytest.mark.parametrize("design", [design_pid, design_sliding_mode, design_mpc])
def test_steps_settle_without_limit_cycle(
    design: Any, hysteresis: bool, linear: LinearModel, plant: Model, plant_with_hysteresis: Model
) -> None:
    assert_settles(design(linear), plant_with_hysteresis if hysteresis else plant, STEPS, 0.5)


@pytest.mark.parametrize("design", [design_pid, design_sliding_mode, design_mpc])
def test_the_same_object_runs_on_the_linear_model(
    design: Any, linear: LinearModel, linear_by_opening: LinearModel
) -> None:
    controller = design(linear)
    scenario = STEPS.without_imperfections()
    by_voltage = verify(controller, linear, scenario)
    by_opening = verify(controller, linear_by_opening, scenario)
    assert metrics(by_voltage)["steady_error"].value < math.radians(0.05)
    # The two models are one model, so both runs are one run but for the table of the curve.
    np.testing.assert_allclose(by_voltage["angle"], by_opening["angle"], atol=2e-4)


def test_linear_run_predicts_the_plant(linear: LinearModel, plant: Model) -> None:
    # The inner loop keeps the plant close to the linear model even over 30 degrees.
    controller = design_pid(linear)
    on_plant = verify(controller, plant, STEPS)["angle"]
    on_model = verify(controller, linear, STEPS)["angle"]
    assert np.abs(on_plant - on_model).max() < math.radians(3.5)


def test_plain_pd_on_the_angle_limit_cycles(plant_with_hysteresis: Model) -> None:
    law = AnglePD(0.8, 0.2, derivative_filter=0.005)
    run = verify(law, plant_with_hysteresis, moves((0.2,), 15, 45, duration=6.0))
    swing = float(np.std(run["angle"][run.time > 3.0]))
    # 2 to 3 degrees rms; it neither dies out nor grows to the stops.
    assert math.radians(1.5) < swing < math.radians(4.0)
    assert metrics(run)["oscillation"].value > math.radians(2.0)
