"""Starts that the first measurements do not tell."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.diagnosis.estimation.free_run import free_run
from workbench.diagnosis.estimation.made_up import made_up
from workbench.diagnosis.estimation.observe import observe
from workbench.diagnosis.estimation.start import fitted_start
from workbench.errors import WorkbenchError
from workbench.plants.cascaded_tanks import cascaded_tanks
from workbench.recordings.recording import Recording, Signal
from workbench.simulation import simulate


def test_the_level_of_a_tank_that_is_not_read_is_found() -> None:
    tanks = cascaded_tanks()
    pump = 2.0 + np.sin(0.05 * np.arange(120))
    run = simulate(
        tanks, pump, sample_time=4.0, start={"upper_level": 9.0, "lower_level": 4.0}, check=False
    )
    noise = np.random.default_rng(0).normal(0.0, 0.03, 120)
    recording = Recording(
        "tanks",
        run.time,
        (
            Signal("pump", pump, "V", role="command"),
            Signal("level", run.outputs[:, 0] + noise, "V"),
        ),
    )
    seen = observe(tanks, recording)
    assert abs(seen.start[0] - 9.0) > 1.5  # the first measurement says nothing of it
    found = fitted_start(tanks, seen, samples=50)
    # 50 measurements with 0.03 V of noise, the effect of the start on them being of order one.
    assert found.start == pytest.approx([9.0, 4.0], abs=0.1)
    assert free_run(tanks, found).rmse["level"] < 0.035


def test_a_start_that_is_known_stays() -> None:
    tanks = cascaded_tanks()
    seen = made_up(tanks, np.full(60, 3.0), sample_time=4.0)
    sure = fitted_start(tanks, seen, samples=20)
    assert sure.start[1] == pytest.approx(tanks.initial_state()[1], abs=0.05)
    assert np.array_equal(sure.start_rms, seen.start_rms)


def test_the_number_of_samples_has_a_range() -> None:
    tanks = cascaded_tanks()
    seen = made_up(tanks, np.full(60, 3.0), sample_time=4.0)
    with pytest.raises(WorkbenchError, match="samples is 61; the valid range is 2 to 60"):
        fitted_start(tanks, seen, samples=61)
