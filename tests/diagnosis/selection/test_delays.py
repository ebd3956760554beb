"""The cost of an event's delay, filtered in parts, beside that of the whole recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from workbench.computing.counted import done
from workbench.diagnosis.estimation.prediction_error import PredictionError, disturbances
from workbench.diagnosis.estimation.process_noise import extended_start
from workbench.diagnosis.estimation.simulated_recordings import pushes, simulated
from workbench.diagnosis.selection.delays import Delays
from workbench.physics.library import library
from workbench.physics.recorded_facts import RecordedFacts
from workbench.plants.servo_axis import servo_axis

STEP, SAMPLES = 0.005, 6000


def test_what_is_filtered_once_changes_no_cost() -> None:
    axis = servo_axis()
    seen = simulated(axis, pushes(SAMPLES, largest=200.0), sample_time=STEP)
    laws = {
        h.name: h for h in library(axis, RecordedFacts(duration=SAMPLES * STEP, sample_time=STEP))
    }
    jump = laws["offset_jump_axis_force"].effect
    model = axis.with_effect(jump.with_parameters({"amount": 30.0, "time": 10.0, "width": 0.02}))
    begun = extended_start(seen, axis, model)
    # The noise of two sensors samples apart is a state of the filter too.
    begun = replace(begun, correlated_noise=np.array([[2e-5, 0.05]]))
    clock = [q.name for q in model.states].index(f"{jump.name}.clock")
    filter_ = PredictionError(model, begun, (), disturbances(model, 0.1))
    of = Delays(filter_, begun, {clock: float(begun.start[clock])}, (9.9, 10.1))
    tried = np.linspace(-19.0, 9.0, 12)
    before = done()["filtered_samples"]
    quick = [of.cost(delay) for delay in tried]
    used = done()["filtered_samples"] - before
    whole = [of.cost_from(np.array([begun.start[clock] + delay])) for delay in tried]
    assert quick == pytest.approx(whole, abs=0.05)
    assert max(whole) - min(whole) > 1e3
    assert used < 0.55 * len(tried) * SAMPLES
