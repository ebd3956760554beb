"""The open-loop experiment: the nominal arm in the band, and what each part of the model does.

The bands are those of the paper's Figure 8 and of the variants without one part each.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.errors import WorkbenchError
from workbench.experiments import (
    OpenLoopExperiment,
    TransitFigures,
    open_loop_experiment,
    pulse_train,
)
from workbench.model import REGULARISED, Model
from workbench.plants.arm import arm
from workbench.plants.arm.laws import constant_volume, printed_volume
from workbench.simulation import simulate


def run(model: Model) -> OpenLoopExperiment:
    return open_loop_experiment(model, duration=20.0)


@pytest.fixture(scope="module")
def nominal() -> OpenLoopExperiment:
    return run(arm(3.0))


def touch_deg(figures: TransitFigures) -> float:
    return math.degrees(figures.touch_speed)


def test_nominal_arm_is_inside_the_band(nominal: OpenLoopExperiment) -> None:
    figures = nominal.figures
    assert len(figures.transits) == 9
    for transit in figures.transits:
        assert 0.5 <= transit.duration <= 1.4
        assert 1.9 <= transit.ripple_frequency <= 2.6
        assert 1 <= transit.dips <= 3
        assert math.degrees(transit.touch_speed) < 100.0
    assert nominal.trajectory.violations == ()
    assert nominal.trajectory.error < 1e-3


def test_nominal_figures_are_the_measured_ones(nominal: OpenLoopExperiment) -> None:
    # Measured on this plant; a change of its laws shows here before it leaves the wide band.
    figures = nominal.figures
    assert figures.transit_time == pytest.approx(0.61, abs=0.02)
    assert figures.ripple_frequency == pytest.approx(2.27, abs=0.04)
    assert figures.dips == 1
    assert touch_deg(figures) == pytest.approx(47.0, abs=3.0)


def test_touch_speed_from_angles_is_the_speed_of_the_state(nominal: OpenLoopExperiment) -> None:
    run = nominal.trajectory
    angle, speed = run["angle"], run["speed"]
    upper = np.radians(60.0)
    touches = []
    for transit in nominal.figures.transits:
        if transit.direction > 0:
            k = int(np.argmax((run.time > transit.start) & (angle >= upper))) - 1
            late = (upper - angle[k]) / speed[k]
            touches.append(speed[k] + late * (speed[k] - speed[k - 1]) / 0.002)
            assert transit.touch_speed == pytest.approx(touches[-1], rel=0.02)
    assert len(touches) >= 4


def test_linear_valve_hits_the_stop_without_ripple() -> None:
    figures = run(arm(3.0, valve_curve="linear")).figures
    assert figures.dips == 0
    assert math.isnan(figures.ripple_frequency)
    assert touch_deg(figures) == pytest.approx(430.0, abs=10.0)


def test_constant_volume_hits_the_stop_without_ripple() -> None:
    figures = run(arm(3.0).with_effect(constant_volume())).figures
    assert figures.dips == 0
    # The stated 290 deg/s does not say which constant volume it was.
    assert touch_deg(figures) == pytest.approx(290.0, abs=15.0)


def test_printed_volume_never_reaches_the_stops() -> None:
    experiment = run(arm(3.0).with_effect(printed_volume()))
    settled = np.degrees(experiment.trajectory["angle"][2000:])
    assert 0.5 < settled.min() < settled.max() < 59.5
    assert math.isnan(experiment.figures.touch_speed)
    assert experiment.figures.reason


def test_everything_as_printed_simulates_and_does_not_touch_the_stops_either() -> None:
    experiment = run(arm(3.0, variant="as_printed"))
    settled = np.degrees(experiment.trajectory["angle"][5000:])
    assert 0.0 < settled.min() < settled.max() < 60.0
    assert experiment.trajectory.error < 1e-3


def test_flattening_alone_hardly_matters(nominal: OpenLoopExperiment) -> None:
    without = run(arm(3.0).without("end_flattening")).figures
    assert without.ripple_frequency == pytest.approx(nominal.figures.ripple_frequency, abs=0.05)
    assert without.dips == nominal.figures.dips


@pytest.mark.parametrize(("load", "dips"), [(0.0, 4), (8.0, 0)])
def test_ripple_follows_the_load(load: float, dips: int) -> None:
    figures = run(arm(load)).figures
    assert figures.dips == dips
    if dips:
        assert 5.0 <= figures.ripple_frequency <= 7.0  # the mode of the bare arm


def test_regularised_form_stays_close_over_the_experiment(nominal: OpenLoopExperiment) -> None:
    voltage = nominal.trajectory.inputs
    smooth = simulate(arm(3.0), voltage, sample_time=0.002, form=REGULARISED, check=False)
    apart = np.degrees(np.abs(smooth["angle"] - nominal.trajectory["angle"]))
    assert 0.0 < apart.max() < 0.2


def test_pulses_change_on_the_grid() -> None:
    voltage = pulse_train(duration=400.0)
    edges = np.flatnonzero(np.diff(voltage)) + 1
    assert np.all(edges % 1000 == 0)
    assert set(voltage) == {4.1, 5.9}


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"amplitude_V": 7.0}, "0 to 5 V"),
        ({"period": float("nan")}, "period is nan"),
        ({"duration": -1.0}, "duration is -1"),
        ({"sample_time": 0.1}, "sample time"),
    ],
)
def test_mistakes_are_clear(arguments: dict[str, float], text: str) -> None:
    with pytest.raises(WorkbenchError, match=text):
        pulse_train(**arguments)
