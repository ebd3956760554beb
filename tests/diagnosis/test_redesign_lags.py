"""A design on a model in which latency and sensor lags were found predicts over them."""

from __future__ import annotations

import pytest

from workbench.diagnosis.redesign import found_lags, redesign
from workbench.evaluation.tolerance import tolerant_study
from workbench.plants.arm.arm import ARM

TIMES = {"valve_delay.time": 0.008, "sensor_lag_pressures.time": 0.006}


def test_latency_and_lags_that_were_found_are_predicted_over() -> None:
    plant = tolerant_study().plant
    late = plant.varied(effects=["valve_delay", "sensor_lag_pressures"]).build()
    late = late.with_parameters(TIMES)
    assert found_lags(late)["valve_delay"] == ("latency", 0.008)
    nominal, own = (redesign(m, ARM, "scheduled-pid").tracking for m in (plant.build(), late))
    assert (nominal.latency, nominal.sensor_lag, nominal.lead) == (0.0, 0.0, 0.0)
    assert (own.latency, own.sensor_lag) == (0.008, 0.006)
    # The spool is a lag of 2.3 ms, half a sample 1 ms.
    assert own.lead == pytest.approx(0.0033, abs=3e-4)
    # What is predicted over is no part of the joint's model.
    assert own.schedule.at(0.5, 3.2e5).g == pytest.approx(nominal.schedule.at(0.5, 3.2e5).g)
